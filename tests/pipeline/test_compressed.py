"""The exposure of clips that a codec compresses as cameras do."""

from dataclasses import replace
from pathlib import Path

import pytest

from rsvideo.pipeline import clip_facts, clip_frames
from rsvideo.restoration import exposure
from rsvideo.restoration.clip_motion import gather
from rsvideo.restoration.settings import Settings
from rsvideo.video.stream import Stream
from tests.pipeline.moving import RATE, Moving


@pytest.mark.slow
@pytest.mark.parametrize(("scene", "seconds"), [("coffee", 0.025), ("camera", 0.015)])
def test_what_compression_takes_of_an_exposure_its_bits_give_back(scene: str, seconds: float, tmp_path: Path) -> None:
    moving = Moving(frames=12, rows=180, cols=240, exposure=seconds, readout=0.015, scene=scene)
    taken = clip_facts.gather(moving.clip(tmp_path / "in.mp4", bits=0.25)).source
    assert isinstance(taken, Stream)
    run = gather(clip_frames.decoded(taken, 0, taken.frames), moving.camera.exposed(0.25 / RATE), Settings())
    as_shown, counted = exposure.measured(run, 1 / RATE), exposure.measured(replace(run, bits=taken.bits), 1 / RATE)
    assert isinstance(as_shown, exposure.Exposure)
    assert isinstance(counted, exposure.Exposure)
    assert as_shown.sharp < 0.93 * seconds
    assert abs(counted.sharp - seconds) < 0.6 * abs(as_shown.sharp - seconds)
