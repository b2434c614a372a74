"""One density of poses a frame: what roll blurs, it undoes better than one kernel."""

import numpy as np
import pytest
import skimage.data
from scipy import ndimage

from rsvideo.baselines import nonuniform, uniform
from rsvideo.baselines.nonuniform import Density
from rsvideo.frame import Verdict
from rsvideo.physics import simulate
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.report.metrics import psnr
from rsvideo.restoration.scanlines import to_scanlines
from rsvideo.restoration.settings import Settings
from tests.baselines.scenes import cards, frame, path, view

ROWS, COLS = 128, 160
LENS = Intrinsics.centred(focal=400.0, rows=ROWS, cols=COLS)
CAMERA = Camera(timing=ShutterTiming.from_readout(exposure=0.04, readout=0.0, rows=ROWS), intrinsics=LENS)
SETTINGS = Settings(prior="tv")
pytestmark = pytest.mark.usefixtures("small_kernels")
STEP = 0.01  # rad
TURN = np.array([[0.0, 0.0, 0.0], [1.5, 1.0, 0.02], [0.8, -0.6, 0.012]])  # px, px, rad: bent, so that no kernel is its own mirror image


def taken(coefficients=TURN, scene=None):
    rng, noise = np.random.default_rng(0), Noise.at_half(0.002)
    scene = cards(190, 220, count=180) if scene is None else scene
    return simulate.render(scene, camera=CAMERA, trajectory=path(coefficients), noise=noise, rng=rng, samples=32)


def true_density(rolls=17, size=17):
    """The poses of TURN's path on a grid."""
    poses = path(TURN).at(np.linspace(0, 0.04, 500))
    at = np.stack([rolls // 2 + poses[:, 2] / STEP, size // 2 - poses[:, 1], size // 2 - poses[:, 0]])
    weights = np.zeros((rolls, size, size), np.float32)
    first = np.floor(at).astype(int)
    part = at - first
    for corner in np.ndindex(2, 2, 2):
        share = np.prod([p if c else 1 - p for c, p in zip(corner, part, strict=True)], axis=0)
        np.add.at(weights, tuple(first + np.array(corner)[:, None]), share)
    return Density(weights=weights / weights.sum(), roll_step=STEP)


def test_the_known_density_is_undone_and_better_than_its_middle_kernel_alone():
    case = taken()
    taken_by = to_scanlines(frame(case.blurred), CAMERA)
    density = true_density()
    latent = uniform.solved(nonuniform.tiled_frame(taken_by, density), SETTINGS, taken_by.noise)
    middle = density.weights.sum(axis=0)
    alone = uniform.deconvolved(case.blurred, case.blurred >= 1, middle, SETTINGS, taken_by.noise)
    assert psnr(latent, case.truth) > psnr(case.blurred, case.truth) + 4
    assert psnr(latent, case.truth) > psnr(alone, case.truth) + 2


@pytest.mark.parametrize("at", [(20.0, 20.0), (140.0, 100.0)])
def test_a_light_is_blurred_with_the_kernel_of_its_place(at):
    """The kernel's centroid and spread are those of the rendered light."""
    scene = np.zeros((190, 220, 1))
    scene[int(at[1]) + 31, int(at[0]) + 30] = 1.0
    light = simulate.blur(scene, camera=CAMERA, trajectory=path(TURN), samples=64)[..., 0]
    density = true_density()
    kernel = (nonuniform.kernels_from(density, LENS, at[0], at[1], 25) @ density.values()).reshape(25, 25)
    y, x = int(at[1]), int(at[0])
    seen = np.maximum(light[y - 12 : y + 13, x - 12 : x + 13], 0)
    one, other = (ndimage.gaussian_filter(k / k.sum(), 1.0) for k in (kernel, seen))
    assert float((one * other).sum() / np.linalg.norm(one) / np.linalg.norm(other)) > 0.95


@pytest.mark.slow
def test_a_frame_blurred_by_roll_gains_more_than_with_one_kernel():
    timing = ShutterTiming.from_readout(exposure=0.04, readout=0.0, rows=180)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=500.0, rows=180, cols=240))
    scene = ((skimage.data.coffee()[20:300, 100:480] / 255) ** 2.2).mean(axis=2, keepdims=True)
    trajectory = path(np.array([[0.0, 0.0, 0.0], [2.5, 1.5, 0.012]]))
    rng, noise = np.random.default_rng(0), Noise.at_half(0.002)
    case = simulate.render(scene, camera=camera, trajectory=trajectory, noise=noise, rng=rng, samples=32)
    one = uniform.restored(view(frame(case.blurred), timing), SETTINGS)
    many = nonuniform.restored(to_scanlines(frame(case.blurred), camera), SETTINGS)
    assert many.verdict is Verdict.RESTORED
    assert many.psfs is not None
    assert many.psfs.shape[:2] == (3, 3)
    np.testing.assert_allclose(many.psfs.sum(axis=(2, 3)), 1, atol=1e-4)
    assert psnr(many.latent, case.truth) > psnr(case.blurred, case.truth) + 0.8
    assert psnr(many.latent, case.truth) > psnr(one.latent, case.truth) + 1


def test_a_sharp_frame_and_one_without_texture_are_left_as_they_were():
    sharp = taken(0 * TURN, (skimage.data.astronaut()[0:200, 100:330] / 255) ** 2.2).blurred
    flat = np.full_like(sharp, 0.5) + 0.002 * np.random.default_rng(0).standard_normal(sharp.shape).astype(np.float32)
    for pixels, verdict in ((sharp, Verdict.SHARP), (flat, Verdict.NO_TEXTURE)):
        result = nonuniform.restored(to_scanlines(frame(pixels), CAMERA), SETTINGS)
        assert result.verdict is verdict
        np.testing.assert_array_equal(result.latent, pixels)


def test_a_density_on_a_finer_grid_is_the_same_density():
    density = true_density()
    finer = nonuniform.resampled(density, 2.0, 2.0, 1)
    for camera_x in (10.0, 150.0):
        coarse = (nonuniform.kernels_from(density, LENS, camera_x, 30.0, 31) @ density.values()).reshape(31, 31)
        twice = Intrinsics.centred(focal=800.0, rows=2 * ROWS, cols=2 * COLS)
        fine = (nonuniform.kernels_from(finer, twice, 2 * camera_x + 0.5, 60.5, 61) @ finer.values()).reshape(61, 61)
        means = [np.array(ndimage.center_of_mass(k)) - len(k) // 2 for k in (coarse, fine)]
        np.testing.assert_allclose(means[1], 2 * means[0], atol=0.2)
