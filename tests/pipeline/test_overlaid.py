"""A clip with a caption over it: the scene is straightened, the caption stays."""

from dataclasses import replace

import numpy as np
import pytest

from rsvideo.config.method import Method
from rsvideo.frame import Frame
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline import methods, overlaid
from rsvideo.pipeline.chunk import movement, treated
from rsvideo.pipeline.methods import Treatment
from rsvideo.pipeline.pieces import Chunk
from rsvideo.progress import ignore
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.settings import Settings
from rsvideo.video.stream import Picture
from tests.pipeline.moving import H264, RATE, Moving, planes

FRAMES = 8
CLIP = Moving(frames=FRAMES)
CHUNK = Chunk(index=0, first=0, last=FRAMES - 1, warm_up=0)
TREATMENT = Treatment(method=Method.RECTIFY, settings=Settings(), block_rows=None, gyro=None, camera=CLIP.camera, timing_source="EXIF")
COLOUR = replace(H264, transfer=Transfer.BT709)


def pictures(*, captioned: bool) -> list[Picture]:
    out = []
    for k, rendering in enumerate(CLIP.renderings):
        luma, *chroma = planes(rendering.blurred)
        luma = luma.copy()
        for at in range(10 if captioned else 0):
            luma[70:84, 16 + 8 * at : 20 + 8 * at] = 235
        out.append(Picture(planes=(luma, *chroma), index=k, pts=k, duration=1, time=k / RATE))
    return out


def shown(given: list[Picture]) -> list[np.ndarray]:
    return [picture.planes[0].astype(float) for picture, _, _ in treated(TREATMENT, CHUNK, given, COLOUR, None, ignore)]


def moved(given: list[Picture]) -> Movement:
    return movement(TREATMENT, given, COLOUR, overlaid.found(TREATMENT, given, COLOUR), None, ignore)


@pytest.fixture(scope="module")
def both() -> tuple[list[np.ndarray], list[np.ndarray]]:
    return shown(pictures(captioned=True)), shown(pictures(captioned=False))


def test_a_caption_stays_as_it_was_while_the_scene_is_straightened(both: tuple[list[np.ndarray], list[np.ndarray]]) -> None:
    given = pictures(captioned=True)
    for picture, after in zip(given, both[0], strict=True):
        before = picture.planes[0].astype(float)
        assert np.abs(after - before)[70:84, 16:92].max() <= 2
    assert np.mean([np.abs(after - p.planes[0])[:60].mean() for p, after in zip(given, both[0], strict=True)]) > 3


def test_the_scene_moves_below_a_caption_as_it_would_without_it(both: tuple[list[np.ndarray], list[np.ndarray]]) -> None:
    for captioned, plain in zip(*both, strict=True):
        assert np.abs(captioned - plain)[:60].mean() < 2
    with_caption, without = (moved(pictures(captioned=captioned)) for captioned in (True, False))
    np.testing.assert_allclose(with_caption.steps[:-1, :2], without.steps[:-1, :2], atol=0.5)


def test_the_record_says_how_much_is_covered_and_a_scene_by_itself_has_nothing_over_it() -> None:
    frames = [result for _, result, _ in treated(TREATMENT, CHUNK, pictures(captioned=True), COLOUR, None, ignore)]
    assert {frame.overlaid for frame in frames} == {frames[0].overlaid}
    assert 0.05 < frames[0].overlaid < 0.25
    assert overlaid.found(TREATMENT, pictures(captioned=False), COLOUR) is None


def test_frames_with_nothing_over_them_are_treated_as_they_are() -> None:
    frames = CLIP.recorded
    taken: list[Frame] = []

    def untouched(scene):
        for frame in scene:
            taken.append(frame)
            yield methods.untouched(TREATMENT, frame, verdict=methods.Verdict.SHARP)

    results = list(overlaid.treated(frames, None, untouched))
    assert all(a is b for a, b in zip(taken, frames, strict=True))
    assert {result.overlaid for result in results} == {0.0}
