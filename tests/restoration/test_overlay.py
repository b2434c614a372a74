"""Graphics over a picture are found, taken off, and laid back as they were."""

from dataclasses import replace

import numpy as np
import pytest
import skimage.data

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import still
from rsvideo.restoration.overlay import FEWEST, PICTURES, Overlay, spread

ROWS, COLS, COUNT = 120, 200, 12
SCENE = np.asarray(skimage.data.camera(), np.float32)[..., None] / 255
CAPTION = np.s_[90:104, 12:88]
TIMING = ShutterTiming.from_readout(exposure=0.01, readout=0.02, rows=ROWS)


def pictures(step: float = 3.0, count: int = COUNT) -> list[Frame]:
    """A camera that moves by so many px a frame, to the right and down, with noise."""
    rng, frames = np.random.default_rng(0), []
    for k in range(count):
        y, x = 180 + round(step * k / 2), 120 + round(step * k)
        pixels = SCENE[y : y + ROWS, x : x + COLS] + rng.normal(0, 0.004, (ROWS, COLS, 1)).astype(np.float32)
        frames.append(Frame(pixels=np.clip(pixels, 0, 1), clipped=np.zeros(pixels.shape, bool), index=k))
    return frames


def captioned(frame: Frame, digits: int = 0) -> Frame:
    """The frame with strokes of 2 px over it, the last few of which depend on `digits`."""
    pixels = frame.pixels.copy()
    for at in range(0, 78, 6):
        shown = at < 60 or (digits + at) % 4
        pixels[90:104, 12 + at : 14 + at] = 1.0 if shown else 0.0
        pixels[92:94, 12 + at : 16 + at] = 1.0
    return replace(frame, pixels=pixels)


def found(frames: list[Frame]) -> np.ndarray:
    overlay = Overlay.of(frames)
    return np.zeros((ROWS, COLS), bool) if overlay is None else overlay.covered


def test_a_caption_is_found_and_little_of_the_scene_that_moves_below_it() -> None:
    covered = found([captioned(frame) for frame in pictures()])
    assert covered[CAPTION].mean() > 0.9
    assert covered.mean() < 2.5 * 14 * 76 / (ROWS * COLS)


def test_digits_that_change_once_are_part_of_a_caption() -> None:
    covered = found([captioned(frame, digits=2 * (k > 6)) for k, frame in enumerate(pictures())])
    assert covered[90:104, 70:88].mean() > 0.9


@pytest.mark.parametrize(("inset", "own"), [(np.s_[70:110, 130:190], True), (np.s_[10:110, 20:180], False)])
def test_a_picture_in_the_picture_is_found_by_its_border_and_a_border_about_the_scene_is_none(inset: tuple[slice, ...], own: bool) -> None:
    """What a border encloses moves otherwise than the scene about it; where it is most of the picture, it is the scene."""
    frames = pictures()
    for frame, other in zip(frames, pictures(-2.0), strict=True):
        size = frame.pixels[inset].shape
        frame.pixels[inset] = 1.0
        inside = tuple(slice(part.start + 2, part.stop - 2) for part in inset)
        frame.pixels[inside] = other.pixels[: size[0] - 4, : size[1] - 4]
    covered = found(frames)
    assert covered[inset].mean() > 0.9 if own else covered[inset].mean() < 0.3


@pytest.mark.parametrize("step", [0.0, 1.0, 3.0, 9.0])
def test_nothing_is_found_over_a_scene_by_itself(step: float) -> None:
    assert not found(pictures(step)).any()


def test_nothing_is_told_where_the_camera_rests_or_pictures_are_few() -> None:
    assert not found([captioned(frame) for frame in pictures(0.0)]).any()
    assert not found([captioned(frame) for frame in pictures(count=FEWEST)]).any()
    assert found([captioned(frame) for frame in pictures(count=FEWEST + 1)]).any()


def test_a_camera_that_rests_behind_what_moves_is_not_taken_for_graphics() -> None:
    frames = pictures()
    for frame in frames:
        frame.pixels[:, : COLS // 2] = frames[0].pixels[:, : COLS // 2]
    assert not found(frames).any()


def test_black_bars_are_found_whole_and_a_dark_sky_is_none() -> None:
    bars, skies = pictures(), pictures()
    for k, (bar, sky) in enumerate(zip(bars, skies, strict=True)):
        bar.pixels[:14] = bar.pixels[-10:] = 0
        sky.pixels[: 14 + 3 * k] = 0  # as the camera moves
    covered = found(bars)
    assert covered[:14].all()
    assert covered[-10:].all()
    assert not covered[20:-16].any()
    assert not found(skies).any()


def test_a_cleared_frame_goes_on_from_what_is_about_its_graphics() -> None:
    frames = [captioned(frame) for frame in pictures()]
    overlay = Overlay.of(frames)
    assert overlay is not None
    cleared = overlay.cleared(frames[0])
    assert cleared.clipped[overlay.covered].all()
    assert not cleared.clipped[~overlay.covered].any()
    np.testing.assert_array_equal(cleared.pixels[~overlay.covered], frames[0].pixels[~overlay.covered])
    assert cleared.pixels[CAPTION].max() <= frames[0].pixels[~overlay.covered].max()
    assert (frames[0].pixels[CAPTION] == 1).any()  # it is not changed itself


@pytest.mark.parametrize("verdict", [Verdict.RESTORED, Verdict.SHARP])
def test_graphics_lie_over_the_result_as_they_were(verdict: Verdict) -> None:
    plain = pictures()
    frames = [captioned(frame) for frame in plain]
    overlay = Overlay.of(frames)
    assert overlay is not None
    cleared = overlay.cleared(frames[0])
    latent = np.full_like(cleared.pixels, 0.25) if verdict.changed else cleared.pixels
    path = still(TIMING.interval, degree=1, axes=3)
    result = FrameResult(frame=cleared, timing=TIMING, trajectory=path, latent=latent, verdict=verdict, seconds=0.0)
    done = overlay.over(result, overlay.lifted(frames[0]))
    np.testing.assert_array_equal(done.frame.pixels, frames[0].pixels)
    np.testing.assert_array_equal(done.frame.clipped, frames[0].clipped)
    strokes = frames[0].pixels != plain[0].pixels
    np.testing.assert_allclose(done.latent[strokes], frames[0].pixels[strokes], atol=1e-6)
    if verdict.changed:
        np.testing.assert_array_equal(done.latent[~overlay.covered], latent[~overlay.covered])
        assert (latent == 0.25).all()  # neighbours may need it without graphics
    else:
        np.testing.assert_array_equal(done.latent, frames[0].pixels)
    assert done.overlaid == overlay.share


def test_a_long_run_is_compared_by_pictures_that_are_evenly_spread() -> None:
    assert spread(5) == [0, 1, 2, 3, 4]
    assert len(spread(40)) == PICTURES
    assert (spread(40)[0], spread(40)[-1]) == (0, 39)
    assert np.ptp(np.diff(spread(40))) <= 1
