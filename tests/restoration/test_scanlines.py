"""Whichever way a frame is read, along its scanlines it is one that is read from top to bottom, and it comes back as it was."""

from dataclasses import replace

import numpy as np
import pytest

from rsvideo.frame import Frame, Verdict
from rsvideo.physics.camera import Camera, Intrinsics, turned
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Polynomial
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.scanlines import LEAST_NOISE, path_along_scanlines, path_in_image, result, to_scanlines
from rsvideo.restoration.scene import halved, scene_of
from rsvideo.restoration.settings import Settings

ROWS, COLS = 96, 128
LENS = Intrinsics(fx=310.0, fy=280.0, cx=66.0, cy=41.0, rows=ROWS, cols=COLS)
POSE = np.array([3.0, -2.0, 0.02])


def camera(direction: Direction, noise: float | None = None) -> Camera:
    lines = ROWS if direction in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP) else COLS
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.02, rows=lines, direction=direction)
    return Camera(timing=timing, intrinsics=LENS, noise=noise)


def frame(sigma: float = 0.02, channels: int = 3) -> Frame:
    rng = np.random.default_rng(0)
    smooth = np.linspace(0.2, 0.7, COLS)[None, :, None] + np.zeros((ROWS, 1, channels))
    pixels = (smooth + sigma * rng.standard_normal(smooth.shape)).astype(np.float32)
    return Frame(pixels=pixels, clipped=pixels > 0.72, time=2.0, index=7)


@pytest.mark.parametrize("direction", list(Direction))
def test_a_frame_comes_back_as_it_was(direction: Direction) -> None:
    given = frame()
    view = to_scanlines(given, camera(direction))
    assert len(view.pixels) == view.camera.timing.rows == view.camera.intrinsics.rows
    assert view.camera.timing.direction is Direction.TOP_TO_BOTTOM
    np.testing.assert_array_equal(view.frame.pixels, given.pixels)
    np.testing.assert_array_equal(view.frame.clipped, given.clipped)
    assert (view.frame.time, view.frame.index) == (2.0, 7)


@pytest.mark.parametrize("direction", list(Direction))
def test_what_is_found_along_the_scanlines_leaves_in_the_frames_axes(direction: Direction) -> None:
    given, taken_by = frame(), camera(direction)
    view = to_scanlines(given, taken_by)
    path = Polynomial(t0=0.0, t1=0.03, coefficients=np.outer([0.0, 1.0], POSE))
    found = result(
        view, trajectory=path_along_scanlines(path, direction), latent=view.pixels, verdict=Verdict.RESTORED, psfs=None, seconds=0.0
    )
    np.testing.assert_array_equal(found.latent, given.pixels)
    np.testing.assert_array_equal(found.trajectory.coefficients, path.coefficients)
    assert (found.frame, found.timing) == (given, taken_by.timing)


def test_a_frame_read_from_top_to_bottom_is_not_copied() -> None:
    given = frame()
    assert to_scanlines(given, camera(Direction.TOP_TO_BOTTOM)).pixels is given.pixels


@pytest.mark.parametrize("direction", list(Direction))
def test_the_camera_is_turned_with_the_frame(direction: Direction) -> None:
    """A pixel moves alike whether it is looked up in the image or along the scanlines."""
    marked = np.zeros((ROWS, COLS))
    marked[20, 110] = 1
    (line,), (along,) = np.nonzero(direction.scanlines(marked))
    upright = camera(direction).along_scanlines().intrinsics
    moved = turned(upright, np.array(float(along)), np.array(float(line)), direction.poses_along_scanlines(POSE))
    np.testing.assert_allclose(direction.poses_in_image(moved), turned(LENS, np.array(110.0), np.array(20.0), POSE), atol=1e-9)


@pytest.mark.parametrize("direction", list(Direction))
def test_a_path_and_a_movement_turn_back_to_themselves(direction: Direction) -> None:
    path = Polynomial(t0=0.0, t1=0.03, coefficients=np.outer([0.0, 1.0, 0.5], POSE))
    np.testing.assert_array_equal(path_in_image(path_along_scanlines(path, direction), direction).coefficients, path.coefficients)
    movement = Movement(within=[path, None], steps=np.outer([1.0, 0.0], POSE), tied=[True, False])
    back = movement.along_scanlines(direction).in_image(direction)
    np.testing.assert_array_equal(back.steps, movement.steps)
    assert back.within[1] is None
    assert back.within[0] is not None
    np.testing.assert_array_equal(back.within[0].coefficients, path.coefficients)


@pytest.mark.parametrize("channels", [1, 3])
def test_noise_is_measured_unless_the_camera_gives_it(channels: int) -> None:
    given = frame(sigma=0.02, channels=channels)
    down = Direction.TOP_TO_BOTTOM
    assert to_scanlines(given, camera(down)).noise == pytest.approx(0.02, rel=0.25)
    assert to_scanlines(given, camera(down, noise=0.003)).noise == 0.003
    assert to_scanlines(given, camera(down, noise=0.0)).noise == LEAST_NOISE
    measured, stated = (scene_of(to_scanlines(given, camera(down, noise=noise)), Settings()) for noise in (None, 0.02))
    assert stated.noise == pytest.approx(measured.noise, rel=0.25)
    assert halved(stated).noise == pytest.approx(halved(measured).noise, rel=0.4)
    assert scene_of(to_scanlines(given, camera(down, noise=0.001)), Settings()).noise < 0.1 * stated.noise


def test_noise_in_codes_is_refused() -> None:
    with pytest.raises(ValueError, match=r"noise must lie in \[0, 1\) of white, got 3; is it in 8-bit codes"):
        replace(camera(Direction.TOP_TO_BOTTOM), noise=3.0)
