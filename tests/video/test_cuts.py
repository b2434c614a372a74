"""Cuts are found where two scenes join, and nowhere else."""

from dataclasses import replace

import numpy as np
import pytest
import skimage.data

from rsvideo.video.cuts import cuts
from rsvideo.video.stream import Colour, Picture
from tests.pipeline.moving import H264

ROWS, COLS = 72, 128


def picture(index: int, codes: np.ndarray) -> Picture:
    return Picture(planes=(codes,), index=index, pts=index, duration=1, time=index / 24)


def pan(scene: str, frames: int, first: int = 0, speed: int = 9) -> list[Picture]:
    """A camera that moves over a photograph, by `speed` px from frame to frame."""
    photograph = np.asarray(getattr(skimage.data, scene)())
    return [picture(first + k, photograph[60 : 60 + ROWS, 20 + speed * k : 20 + speed * k + COLS].copy()) for k in range(frames)]


def found(pictures: list[Picture], colour: Colour = H264) -> list[int]:
    return list(cuts(pictures, colour))


def test_a_cut_is_found_where_two_scenes_join() -> None:
    assert found(pan("camera", 8) + pan("coins", 7, first=8)) == [8]
    assert found(pan("camera", 6, speed=4) + pan("coins", 9, first=6, speed=4) + pan("moon", 6, first=15, speed=4)) == [6, 15]


@pytest.mark.parametrize("speed", [0, 4, 12, 20])
def test_a_pan_holds_no_cut(speed: int) -> None:
    assert found(pan("camera", 14, speed=speed)) == []


def test_a_single_picture_holds_no_cut() -> None:
    assert found(pan("camera", 1)) == []
    assert found([]) == []


def test_flicker_and_noise_are_no_cuts() -> None:
    rng = np.random.default_rng(0)
    lights = [
        picture(k, np.clip(p.planes[0] * (1 + 0.1 * np.sin(2 * k)), 0, 255).astype(np.uint8)) for k, p in enumerate(pan("camera", 12))
    ]
    assert found(lights) == []
    assert found([picture(k, rng.integers(0, 256, (ROWS, COLS)).astype(np.uint8)) for k in range(12)]) == []


def test_the_index_counts_the_whole_clip() -> None:
    assert found(pan("camera", 5, first=100) + pan("coins", 5, first=105)) == [105]


def test_the_range_of_codes_does_not_matter() -> None:
    eight = pan("camera", 6) + pan("coins", 6, first=6)
    ten = [replace(p, planes=(p.planes[0].astype(np.uint16) * 4,)) for p in eight]
    light = [replace(p, planes=(p.planes[0].astype(np.float32) / 255,)) for p in eight]
    assert found(ten, replace(H264, depth=10, pixel_format="yuv420p10le")) == [6]
    assert found(light, replace(H264, depth=32, pixel_format="grayf32le", subsampling="4:0:0")) == [6]
