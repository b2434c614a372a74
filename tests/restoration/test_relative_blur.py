"""Streaks that frames of one scene show of each other."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter
from skimage import data

from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.restoration import relative_blur
from rsvideo.restoration.relative_blur import Displaced, Streaks, streaks

ROWS, COLS = 240, 320
NOISE = 0.002
TRUE = np.array([[6.0, 1.0], [1.0, -5.0], [0.0, 0.0], [-3.0, 4.0], [8.0, 3.0], [2.0, 2.0]])  # px
ALLOWED = 0.45 + 0.07 * np.linalg.norm(TRUE, axis=1)  # px: patches end in a window, which fills the dark frequencies
STEPS = np.array([[3, 1], [-2, 4], [0, 2], [5, 0], [-1, -3]])  # px, of points from frame to frame
CAMERA = Camera(
    timing=ShutterTiming.from_readout(exposure=0.01, readout=0.0, rows=ROWS),
    intrinsics=Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS),
)


def filmed(true: np.ndarray, moved: np.ndarray, soft: float = 0.0) -> list[np.ndarray]:
    """Frames of a photograph that has moved by so many px, each blurred along its streak, with noise."""
    scene = data.camera().astype(float)[40:460, 60:500] / 255
    down, across = (2 * np.pi * np.fft.fftfreq(count) for count in scene.shape)
    rng, out = np.random.default_rng(1), []
    for streak, at in zip(true, moved, strict=True):
        phase = across * streak[0] + down[:, None] * streak[1]
        blurred = np.fft.ifft2(np.fft.fft2(scene) * np.sinc(phase / (2 * np.pi))).real
        if soft:
            blurred = gaussian_filter(blurred, soft)
        y, x = 60 - at[1], 60 - at[0]
        out.append((blurred[y : y + ROWS, x : x + COLS] + NOISE * rng.standard_normal((ROWS, COLS))).astype(np.float32))
    return out


def shown(true: np.ndarray, *, soft: float = 0.0, group: list[int] | None = None) -> Streaks:
    moved = np.vstack([np.zeros((1, 2), int), np.cumsum(STEPS[: len(true) - 1], axis=0)])
    return streaks(filmed(true, moved, soft), shifts(moved), group or [0] * len(true), CAMERA, 3)


def shifts(moved: np.ndarray) -> Displaced:
    return lambda k, j, places: np.broadcast_to(moved[j] - moved[k], places.shape).astype(float)


def apart(found: np.ndarray, true: np.ndarray) -> np.ndarray:
    """px between streaks, whichever way they run."""
    return np.minimum(np.linalg.norm(found - true, axis=1), np.linalg.norm(found + true, axis=1))


@pytest.mark.parametrize("soft", [0.0, 1.0])
def test_frames_show_each_other_s_streaks_whatever_lens_and_codec_soften(soft: float) -> None:
    found = shown(TRUE, soft=soft)
    assert (apart(found.pose[:, :2], TRUE) < ALLOWED).all()
    assert np.abs(found.pose[:, 2]).max() * COLS / 2 < 0.7
    assert np.abs(found.change).max() < 1.5
    assert (found.probability > 0.99).all()


def test_streaks_that_all_frames_have_do_not_show() -> None:
    found = shown(np.tile([[6.0, 1.0]], (6, 1)))
    assert np.linalg.norm(found.pose[:, :2], axis=1).max() < 0.5
    assert (found.probability < 0.1).all()


def test_frames_of_other_groups_are_not_compared() -> None:
    found = shown(TRUE, group=[0, 0, 0, 1, 2, 2])
    assert np.linalg.norm(found.pose[3]) < 1e-9
    assert found.variance[3] > 3 * found.variance[:2].max()
    assert found.probability[:3].min() > 0.98
    assert found.probability[3] == pytest.approx(0.5)  # not compared at all
    assert apart(found.pose[:3, :2], TRUE[:3]).max() < 1.0


def test_a_frame_smaller_than_a_patch_shows_nothing() -> None:
    found = streaks([np.zeros((40, 200), np.float32)] * 3, shifts(np.zeros((3, 2))), [0] * 3, CAMERA, 3)
    assert not found.pose.any()
    assert (found.variance > 100).all()
    assert not found.probability.any()


def test_streaks_are_in_px_of_the_camera_s_frame() -> None:
    moved = np.vstack([np.zeros((1, 2)), np.cumsum(STEPS, axis=0)]).astype(int)
    frames = filmed(TRUE, moved)
    lens = Intrinsics.centred(focal=600.0, rows=2 * ROWS, cols=2 * COLS)
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.0, rows=2 * ROWS)
    found = streaks(frames, shifts(2 * moved), [0] * 6, replace(CAMERA, timing=timing, intrinsics=lens), 3)
    assert (apart(found.pose[:, :2], 2 * TRUE) < 2 * ALLOWED).all()


def test_the_slope_of_a_logarithm_is_its_derivative() -> None:
    at, step = np.array([[3.0, -2.0], [0.0, 0.0], [7.0, 4.0]]), 1e-6
    _, slope = relative_blur._log_power(at)
    for axis in range(2):
        ahead, behind = (relative_blur._log_power(at + sign * step * np.eye(2)[axis])[0] for sign in (1, -1))
        np.testing.assert_allclose(slope[..., axis], (ahead - behind) / (2 * step), atol=2e-3)
