"""A blur of many pixels is solved for at half the resolution: the same scene, the same path, in px half as large."""

import numpy as np
import pytest

from rsvideo.frame import Frame, Verdict
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.simulate import render
from rsvideo.physics.trajectory import Polynomial, centred
from rsvideo.report.metrics import psnr
from rsvideo.restoration import resolution, single_frame
from rsvideo.restoration.scanlines import to_scanlines
from rsvideo.restoration.settings import Settings
from tests.pipeline.moving import Moving

ROWS, COLS = 201, 301  # odd: a last row and column are left out, and filled again
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.015, rows=ROWS)
CAMERA = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=400.0, rows=ROWS, cols=COLS), noise=Noise.at_half(2e-3))
DRAWN = Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=np.array([[0.0, 0, 0], [14.0, -6.0, 0.01], [2.0, 3.0, -0.004]]))
PATH = centred(DRAWN, TIMING.middle)
SETTINGS = Settings(quality="draft")


@pytest.fixture(scope="module")
def shot():
    rng = np.random.default_rng(0)
    return render(Moving(frames=1).light, camera=CAMERA, trajectory=PATH, noise=Noise.at_half(2e-3), rng=rng, samples=32)


@pytest.fixture(scope="module")
def view(shot):
    return to_scanlines(Frame(pixels=shot.blurred, clipped=np.zeros(shot.blurred.shape, bool)), CAMERA)


def codes(light: np.ndarray) -> np.ndarray:
    return (np.clip(light, 0, 1) ** (1 / 2.2)).astype(np.float32)


def test_a_long_blur_is_solved_for_at_half_the_resolution(view, shot, monkeypatch: pytest.MonkeyPatch) -> None:
    whole = single_frame.restored(view, SETTINGS, path=PATH)
    monkeypatch.setattr(resolution, "WHOLE_REACH", 12.0)
    monkeypatch.setattr(resolution, "SMALLEST", 80)
    assert resolution.too_long(view, 14.0)
    half = single_frame.restored(view, SETTINGS, path=PATH)
    assert half.verdict is Verdict.RESTORED
    assert half.latent.shape == view.pixels.shape
    assert half.trajectory is not None
    np.testing.assert_allclose(half.trajectory.coefficients, whole.trajectory.coefficients)
    assert not np.array_equal(half.latent, whole.latent)
    blurred, restored = (psnr(codes(image), codes(shot.truth)) for image in (view.pixels, half.latent))
    assert restored > blurred + 1.5


def test_half_a_view_is_what_half_the_camera_takes(view) -> None:
    half = resolution.halved(view)
    assert half.pixels.shape == (ROWS // 2, COLS // 2, 1)
    np.testing.assert_allclose(half.pixels[3, 5], view.pixels[6:8, 10:12].mean(axis=(0, 1)), rtol=1e-5)
    assert half.camera.timing.readout == pytest.approx(TIMING.readout, rel=0.02)
    assert half.camera.timing.exposure == TIMING.exposure
    assert CAMERA.noise
    assert half.camera.noise == Noise(read=CAMERA.noise.read / 2, shot=CAMERA.noise.shot / 4)  # of the mean of four pixels
    # pixel (i, j) of the half lies between pixels 2i and 2i + 1
    assert half.camera.intrinsics.cx == pytest.approx((CAMERA.intrinsics.cx - 0.5) / 2)


def test_a_smooth_picture_comes_back_where_it_was(view) -> None:
    y, x = np.mgrid[:ROWS, :COLS]
    smooth = (0.5 + 0.3 * np.sin(x / 19) * np.cos(y / 23)).astype(np.float32)[..., None]
    half = smooth[: ROWS // 2 * 2, : COLS // 2 * 2].reshape(ROWS // 2, 2, COLS // 2, 2, 1).mean(axis=(1, 3))
    back = resolution.doubled(half, view.pixels)
    assert back.shape == smooth.shape
    np.testing.assert_allclose(back[4:-4, 4:-4], smooth[4:-4, 4:-4], atol=2e-3)
