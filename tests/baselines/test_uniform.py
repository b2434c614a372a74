"""One kernel a frame: found, undone, and left alone where there is nothing to undo."""

from dataclasses import replace

import numpy as np
import pytest
import skimage.data

from rsvideo.baselines import uniform
from rsvideo.frame import Verdict
from rsvideo.physics import simulate
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.report.metrics import psnr
from rsvideo.restoration.settings import Settings
from tests.baselines.scenes import cards, frame, path, view

ROWS, COLS = 128, 144
LENS = Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS)
SETTINGS = Settings(prior="tv")
pytestmark = pytest.mark.usefixtures("small_kernels")
HOOK = np.array([[0.0, 0.0], [2.5, 1.0], [0.3, -1.2]])  # px: a bent path of 9 px


def shutter(direction=Direction.TOP_TO_BOTTOM):
    lines = ROWS if direction in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP) else COLS
    return ShutterTiming.from_readout(exposure=0.04, readout=0.0, rows=lines, direction=direction)


def photograph():
    return (skimage.data.astronaut()[0:200, 120:320] / 255) ** 2.2


def taken(coefficients=HOOK, *, scene=None):
    scene = photograph() if scene is None else scene
    rng, noise = np.random.default_rng(0), Noise.at_half(0.002)
    camera = Camera(timing=shutter(), intrinsics=LENS)
    return simulate.render(scene, camera=camera, trajectory=path(coefficients), noise=noise, rng=rng, samples=32)


def drawn(coefficients, size):
    """The path as a kernel: a light seen at a pixel's sample comes from that pixel, so at minus the pose."""
    kernel = np.zeros((size, size))
    for x, y in -path(coefficients).at(np.linspace(0, 0.04, 400)) + size // 2:
        i, j = int(y), int(x)
        for di, wy in ((0, 1 - y + i), (1, y - i)):
            for dj, wx in ((0, 1 - x + j), (1, x - j)):
                kernel[i + di, j + dj] += wy * wx
    return kernel / kernel.sum()


def likeness(one, other):
    """The normalised correlation of two kernels, shifted to where they agree best."""
    pad = np.pad(one, 3)
    n = len(other)
    shifts = [pad[y : y + n, x : x + n] for y in range(7) for x in range(7)]
    return max(float((s * other).sum() / np.linalg.norm(s) / np.linalg.norm(other)) for s in shifts)


@pytest.mark.slow
@pytest.mark.parametrize("channels", [3, 1], ids=["colour", "grey"])
def test_the_kernel_is_the_path_and_the_picture_gains(channels):
    case = taken(scene=cards(200, 200, channels=channels))
    result = uniform.restored(view(frame(case.blurred), shutter()), SETTINGS)
    assert result.verdict is Verdict.RESTORED
    assert result.psfs is not None
    assert result.psfs.shape[:2] == (1, 1)
    kernel = result.psfs[0, 0]
    assert likeness(kernel, drawn(HOOK, len(kernel))) > 0.9
    assert likeness(kernel[::-1, ::-1], drawn(HOOK, len(kernel))) < 0.85
    assert psnr(result.latent, case.truth) > psnr(case.blurred, case.truth) + 3
    np.testing.assert_array_equal(result.trajectory.at(np.array([0.0, 0.04])), 0)


def test_a_known_kernel_is_undone():
    case = taken()
    kernel = drawn(HOOK, 15)
    latent = uniform.deconvolved(case.blurred, case.blurred >= 1, kernel.astype(np.float32), SETTINGS, 0.002)
    assert psnr(latent, case.truth) > psnr(case.blurred, case.truth) + 6


def test_a_frame_read_sideways_has_its_kernel_and_its_picture_in_its_own_axes():
    case = taken()
    upright = uniform.restored(view(frame(case.blurred), shutter()), SETTINGS)
    pixels = np.ascontiguousarray(case.blurred.transpose(1, 0, 2))
    timing = replace(shutter(), rows=ROWS, direction=Direction.LEFT_TO_RIGHT)
    sideways = uniform.restored(view(frame(pixels), timing), SETTINGS)
    assert upright.psfs is not None
    assert sideways.psfs is not None
    np.testing.assert_allclose(sideways.psfs[0, 0], upright.psfs[0, 0].T, atol=1e-6)
    np.testing.assert_allclose(sideways.latent, upright.latent.transpose(1, 0, 2), atol=1e-5)


def test_a_sharp_frame_and_one_without_texture_are_left_as_they_were():
    sharp = taken(0 * HOOK).blurred
    flat = np.full_like(sharp, 0.5) + 0.002 * np.random.default_rng(0).standard_normal(sharp.shape).astype(np.float32)
    for pixels, verdict in ((sharp, Verdict.SHARP), (flat, Verdict.NO_TEXTURE)):
        result = uniform.restored(view(frame(pixels), shutter()), SETTINGS)
        assert result.verdict is verdict
        np.testing.assert_array_equal(result.latent, pixels)


@pytest.mark.slow
def test_a_kernel_that_touches_its_border_grows(monkeypatch):
    case = taken()
    large = uniform.restored(view(frame(case.blurred), shutter()), SETTINGS)
    monkeypatch.setattr(uniform, "SIZES", (7, 17))
    grown = uniform.restored(view(frame(case.blurred), shutter()), SETTINGS)
    np.testing.assert_array_equal(grown.psfs, large.psfs)
