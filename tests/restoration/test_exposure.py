"""How long a clip was exposed, from its blur."""

from dataclasses import replace

import numpy as np
import pytest

from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera
from rsvideo.restoration import exposure
from rsvideo.restoration.clip_motion import Run, gather
from rsvideo.restoration.exposure import Exposure, Unclear
from rsvideo.restoration.settings import Settings
from tests.pipeline.moving import RATE, Moving

MOVING = Moving(frames=8, rows=128, cols=192)


@pytest.mark.slow
@pytest.mark.parametrize("assumed", [0.008, 0.03])
def test_the_exposure_of_a_clip_shows_in_its_blur(assumed: float) -> None:
    found = exposure.measured(taken(MOVING.recorded, assumed), 1 / RATE)
    assert isinstance(found, Exposure)
    assert found.value == pytest.approx(MOVING.exposure, rel=0.1)


def test_a_clip_that_hardly_moves_does_not_show_its_exposure() -> None:
    found = exposure.measured(taken(Moving(frames=5, reach=0.5).recorded, 0.02), 1 / RATE)
    assert isinstance(found, Unclear)


def test_a_clip_that_does_not_move_at_all_shows_no_exposure() -> None:
    still = [replace(frame, pixels=MOVING.recorded[0].pixels) for frame in MOVING.recorded[:4]]
    assert isinstance(exposure.measured(taken(still, 0.02), 1 / RATE), Unclear)


def test_frames_whose_path_is_wrong_are_outvoted() -> None:
    """Three of eight frames prefer another exposure, the rest agree to a step."""
    tried = np.arange(20.0)
    dips = [8, 8, 9, 8, 7, 2, 2, 15]
    shown = exposure._shown(0.3 * np.array([1 - np.exp(-((tried - dip) ** 2) / 4) for dip in dips]))
    assert shown.sum() == pytest.approx(1)
    assert abs(float(shown @ tried) - 8) < 0.5
    assert float(np.sqrt(shown @ (tried - shown @ tried) ** 2)) < 1


def taken(frames: list[Frame], assumed: float) -> Run:
    """A run of frames with an assumed exposure, whose middles are where they are."""
    size = frames[0].pixels.shape
    moving = Moving(frames=1, rows=size[0], cols=size[1], exposure=assumed)
    shifted = [replace(frame, time=frame.time + (MOVING.exposure - assumed) / 2) for frame in frames]
    return gather(iter(shifted), Camera(timing=moving.timing, intrinsics=moving.camera), Settings())
