"""What the path is refined by: its derivatives are true, and the true path is better than its neighbours."""

import numpy as np
import pytest
import skimage.data

from rsvideo.physics import simulate
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise_level import noise_level
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial
from rsvideo.restoration.energy import energy
from rsvideo.restoration.refinement import Prior, refine
from rsvideo.restoration.scene import Scene, halved
from rsvideo.restoration.sparsity import objective, sparsity, texture_weight
from rsvideo.restoration.verdict import across

ROWS, COLS = 144, 200
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
CAMERA = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS))
SHIFT = np.array([[0.0, 0.0], [4.0, -2.0], [1.0, 1.5], [-0.4, 0.3]])
TURN = np.hstack([SHIFT, [[0.0], [0.02], [-0.006], [0.0]]])
NOISE = 0.002


def path(coefficients):
    return Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=coefficients)


def scene(coefficients) -> Scene:
    """A photograph as a camera on that path records it."""
    sharp = (skimage.data.astronaut()[30:250, 90:340].mean(axis=2) / 255) ** 2.2
    frame = simulate.blur(sharp[..., None], camera=CAMERA, trajectory=path(coefficients), samples=24)[..., 0]
    frame = (frame + NOISE * np.random.default_rng(0).standard_normal(frame.shape)).astype(np.float32)
    valid = np.ones_like(frame)
    return Scene(frame=frame, valid=valid, camera=CAMERA, samples=16, tiles=2, noise=NOISE)


@pytest.fixture(scope="module")
def shifted() -> Scene:
    return scene(SHIFT)


def image(seed, shape=(60, 70)):
    """Smooth where it is smooth, so that no gradient is near zero by accident."""
    y, x = np.indices(shape)
    return np.sin(x / 5.0) + np.cos(y / 4.0) + 0.1 * np.random.default_rng(seed).normal(size=shape)


def test_the_derivative_of_sparsity_is_that_of_finite_differences():
    latent, direction = image(0), np.random.default_rng(1).normal(size=(60, 70))
    weight = np.random.default_rng(2).random((59, 69))
    value, gradient = sparsity(latent, weight)
    slope = float((gradient * direction).sum())
    errors = [abs(sparsity(latent + h * direction, weight)[0] - value - h * slope) for h in (1e-4, 1e-5)]
    assert np.log10(errors[0] / errors[1]) == pytest.approx(2, abs=0.2)


def test_sparsity_knows_no_contrast_and_prefers_few_strong_edges():
    ones = np.ones((59, 69))
    latent = image(0)
    assert sparsity(3 * latent, ones)[0] == pytest.approx(sparsity(latent, ones)[0], rel=1e-5)
    step, ramp = np.zeros((60, 70)), np.zeros((60, 70))
    step[:, 35:] = 1
    ramp[:, 30:40] = np.linspace(0, 1, 10)
    ramp[:, 40:] = 1
    assert sparsity(step, ones)[0] < 0.9 * sparsity(ramp, ones)[0]


def test_texture_weighs_near_one_and_a_flat_area_nothing():
    frame = np.zeros((120, 240), np.float32)
    frame[:, :120] = np.random.default_rng(0).random((120, 120))
    weight = texture_weight(frame, 0.01)
    assert weight[:, :80].min() > 0.9
    assert weight[:, 160:].max() == pytest.approx(0, abs=1e-4)


@pytest.mark.parametrize("sigma", [0.002, 0.02])
def test_the_noise_of_a_photograph_is_measured(sigma):
    sharp = (skimage.data.astronaut()[:256, :256].mean(axis=2) / 255).astype(np.float32)
    smooth = np.repeat(np.repeat(sharp[::8, ::8], 8, axis=0), 8, axis=1)
    noisy = smooth + sigma * np.random.default_rng(0).standard_normal(smooth.shape).astype(np.float32)
    assert noise_level(noisy) == pytest.approx(sigma, rel=0.25)


def same(frame: Scene) -> Scene:
    return frame


@pytest.mark.parametrize(
    ("coefficients", "seen", "share"),
    [(SHIFT, same, 0.04), (TURN, same, 0.1), (2 * TURN, halved, 0.12)],
    ids=["shift", "rotation", "at half the resolution"],
)
def test_the_gradient_of_the_objective_is_that_of_finite_differences(coefficients, seen, share):
    """Up to interpolation and what is completed beyond the frame's sides, and each tile's."""
    frame = seen(scene(coefficients))
    unit = np.array([1, 1, 1 / 100])[: coefficients.shape[1]]
    rng = np.random.default_rng(1)
    away = coefficients + 0.4 * rng.normal(size=coefficients.shape) * unit
    gradient = objective(frame, path(away), frame.ridge)[1]
    size = np.linalg.norm(gradient * unit)
    for _ in range(3):
        d = rng.normal(size=coefficients.shape)
        d[0] = 0  # a gauge
        d = d / np.linalg.norm(d) * unit
        h = 0.05  # px
        rise = objective(frame, path(away + h * d), frame.ridge)[0] - objective(frame, path(away - h * d), frame.ridge)[0]
        assert rise / (2 * h) == pytest.approx(float((gradient * d).sum()), abs=share * size)


def test_the_true_path_is_sparser_than_one_that_is_a_pixel_longer_or_shorter(shifted: Scene):
    rms = np.linalg.norm(SHIFT[1:])
    longer, true, shorter = (objective(shifted, path(SHIFT * (1 + d / rms)), shifted.ridge)[0] for d in (1, 0, -1))
    assert true < longer
    assert true < shorter


def test_the_true_path_of_a_long_blur_is_the_sparsest_at_half_the_resolution_too():
    long = 2 * TURN
    frame = halved(scene(long))
    longer, true, shorter = (objective(frame, path(long * factor), frame.ridge)[0] for factor in (1.2, 1, 0.8))
    assert true < longer
    assert true < shorter


def test_restored_across_its_blur_a_picture_is_less_sparse_than_along_it(shifted: Scene):
    along = path(SHIFT)
    t = np.linspace(*TIMING.interval, 9)
    np.testing.assert_allclose((across(along).at(t) * along.at(t)).sum(axis=1), 0, atol=1e-12)
    assert objective(shifted, across(along), shifted.ridge)[0] > objective(shifted, along, shifted.ridge)[0] + 0.05


def test_the_energy_of_the_paper_is_lower_at_the_truth_than_run_backwards_or_too_long(shifted: Scene):
    true = energy(shifted, path(SHIFT))
    back = SHIFT * np.array([1, -1, 1, -1])[:, None]
    assert true < energy(shifted, path(1.3 * SHIFT))
    assert true < energy(shifted, path(back))


def test_refinement_comes_nearer_to_the_truth_and_keeps_the_gauge(shifted: Scene):
    start = SHIFT * 1.15 + np.array([[0.7, -0.3], [0, 0], [0.3, -0.3], [0, 0]])
    faint = Prior(mean=start[1:], curvature=1e-3 * np.eye(6), weight=1.0)
    found = refine(shifted, path(start), faint, ridge=shifted.search_ridge, steps=6)
    before, after = (np.linalg.norm((c - SHIFT)[1:]) for c in (start, found.trajectory.coefficients))
    assert after < 0.5 * before
    np.testing.assert_array_equal(found.trajectory.coefficients[0], start[0])
    assert found.moved == pytest.approx(np.linalg.norm((found.trajectory.coefficients - start)[1:]))


def test_a_strong_prior_holds_the_path_at_its_mean(shifted: Scene):
    start = SHIFT * 1.15
    firm = Prior(mean=start[1:], curvature=np.eye(6), weight=1e3)
    found = refine(shifted, path(start), firm, ridge=shifted.ridge, steps=4)
    assert found.moved < 0.01


def test_the_derivative_of_the_prior_is_exact():
    rng = np.random.default_rng(0)
    root = rng.normal(size=(6, 6))
    prior = Prior(mean=rng.normal(size=(3, 2)), curvature=root @ root.T, weight=0.3)
    at, d = rng.normal(size=(3, 2)), rng.normal(size=(3, 2))
    rise = prior.at(at + d)[0] - prior.at(at - d)[0]  # exact for a parabola
    assert rise / 2 == pytest.approx(float((prior.at(at)[1] * d).sum()))
    assert prior.at(prior.mean)[0] == 0
