"""The latent update reaches the least of Eq. (15), the motion update that of Eq. (9), and Algorithm 1 alternates them."""

import itertools
from dataclasses import replace

import numpy as np
import pytest
import skimage.data

from rsvideo.paper.alternation import PaperSettings, alternate, update_motion
from rsvideo.paper.latent_image import LatentSettings, RowBlur, restore, restore_rows
from rsvideo.physics.blur import BlurOperator
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.row_fourier import row_fourier
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Polynomial
from rsvideo.solvers.conjugate_gradient import NormalMatrix, conjugate_gradient
from rsvideo.solvers.differences import Differences
from rsvideo.solvers.stopping import solve
from rsvideo.solvers.total_variation import objective, total_variation

ROWS, COLS, MU = 48, 64, 1e-3
LENS = Intrinsics.centred(focal=80.0, rows=ROWS, cols=COLS)
SHIFT = np.array([[0, 0], [3, 1.5], [-1, 1.2], [0.3, -0.3]])
TURN = np.hstack([SHIFT, [[0], [0.02], [-0.01], [0]]])


def scene(K):
    picture = skimage.data.camera()[60:, 120:].astype(float) / 255
    rows, cols = K.latent_shape
    return picture[: 2 * rows, : 2 * cols].reshape(rows, 2, cols, 2).mean(axis=(1, 3))


def taken(coefficients, way=Direction.TOP_TO_BOTTOM, slack=6):
    """A frame, the latent image behind it, and the operator between them."""
    lines = ROWS if way in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP) else COLS
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.02, rows=lines, direction=way)
    path = Polynomial(t0=0.0, t1=timing.interval[1], coefficients=coefficients)
    K = BlurOperator.covering(path, camera=Camera(timing=timing, intrinsics=LENS), slack=slack)
    latent = scene(K)
    return K.forward(latent), latent, K


def off(K, factor=0.9):
    return BlurOperator(
        camera=K.camera,
        trajectory=K.trajectory.with_coefficients(K.trajectory.coefficients * factor),
        samples=K.samples,
        margin=K.margin,
    )


def error(one, other):
    t = np.linspace(one.t0, one.t1, 65)
    return float(np.sqrt((((one.at(t) - other.at(t)) * [1, 1, 20][: one.at(t).shape[1]]) ** 2).sum(axis=1).mean()))


def test_by_rows_and_by_gradients_the_same_least_is_reached():
    """With what lies beyond the frame completed and every system solved exactly, or with weights and conjugate gradients."""
    b, _, K = taken(SHIFT)
    A = row_fourier(K.displacement, COLS)
    exact = restore_rows(b, A, mu=MU, settings=LatentSettings(steps=300, tolerance=0)).state.latent
    blur, D, rho = RowBlur(rows=A), Differences(periodic_cols=True), 50.0 * MU
    seen, W, P = np.zeros((ROWS, A.period)), np.zeros((ROWS, A.period)), np.ones(A.period)
    seen[:, A.left : A.left + COLS], W[:, A.left : A.left + COLS], P[-1] = b, 1, 0
    N = NormalMatrix(blur=blur, gradient=D, rho=rho, weights=W)

    def update(data, h, latent):
        rhs = blur.adjoint(W * data) + rho * h
        return solve(conjugate_gradient(N, rhs, latent), steps=8).state.x, data

    start = np.zeros(exact.shape)
    states = total_variation(seen, mu=MU, rho=rho, gradient=D, update=update, start=start, across=P)
    slow = solve(states, steps=200).state.latent

    def value(latent):
        r = W * (seen - blur.forward(latent))
        return 0.5 * float((r * r).sum()) + MU * float(np.abs(np.stack([P, np.ones_like(P)])[:, None] * D.forward(latent)).sum())

    assert value(exact) == pytest.approx(value(slow), rel=2e-3)
    apart = (exact - slow)[A.top : A.top + ROWS, A.left : A.left + COLS]
    assert np.sqrt((apart**2).mean()) < 2e-3  # single pixels at the frame's edge, where the least is flat, come in last


@pytest.mark.parametrize("way", list(Direction))
def test_every_direction_of_readout_gives_the_same_image_turned(way):
    """Only the way time runs differs: a frame and its path, turned with the readout, restore to the turned image."""
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.02, rows=ROWS)
    b, _, K = taken(SHIFT)
    P = way.pose_from_scanlines[:2, :2]
    turned = way.image(np.ascontiguousarray(b))
    lens = Intrinsics.centred(focal=80.0, rows=turned.shape[0], cols=turned.shape[1])
    path = K.trajectory.with_coefficients(SHIFT @ P.T)
    other = BlurOperator.covering(path, camera=Camera(timing=replace(timing, direction=way), intrinsics=lens))
    settings = LatentSettings(steps=5)
    one, two = restore(b, K, mu=MU, settings=settings)[K.inside], restore(turned, other, mu=MU, settings=settings)[other.inside]
    np.testing.assert_allclose(way.image(one), two, atol=1e-5)


@pytest.mark.slow
@pytest.mark.parametrize("coefficients", [SHIFT, TURN], ids=["shift", "turn"])
def test_the_latent_image_is_nearer_the_truth_than_the_frame(coefficients):
    b, latent, K = taken(coefficients)
    found = restore(b, K, mu=1e-4, settings=LatentSettings(steps=60))
    rms = [float(np.sqrt(((x - latent[K.inside])[4:-4, 4:-4] ** 2).mean())) for x in (b, found[K.inside])]
    assert rms[1] < 0.45 * rms[0]


@pytest.mark.parametrize("way", list(Direction))
@pytest.mark.parametrize("coefficients", [SHIFT, TURN], ids=["shift", "turn"])
def test_given_the_true_latent_image_the_motion_is_found(coefficients, way):
    b, latent, K = taken(coefficients, way)
    start = off(K)
    found = update_motion(b, latent, start, steps=12)
    assert error(start.trajectory, K.trajectory) > 0.2
    assert error(found, K.trajectory) < 0.01


def test_the_truth_stays_where_it_is():
    b, latent, K = taken(SHIFT)
    assert error(update_motion(b, latent, K, steps=5), K.trajectory) < 1e-6


@pytest.mark.parametrize("coefficients", [SHIFT, TURN], ids=["shift", "turn"])
def test_a_round_of_algorithm_1_lowers_the_objective_by_both_updates(coefficients):
    b, _, K = taken(coefficients)
    start = off(K).trajectory
    settings = PaperSettings(latent=LatentSettings(steps=30))
    one = next(alternate(b, camera=K.camera, start=start, settings=settings))
    before = BlurOperator.covering(start, camera=K.camera, slack=settings.slack)
    flat = np.pad(b, [(m, m) for m in before.margin], mode="edge")
    at_start, after_latent = (objective(x, b, mu=one.mu, blur=before, gradient=Differences()) for x in (flat, one.latent))
    assert one.objective < after_latent < at_start
    assert one.change > 0


def test_mu_falls_by_tau_to_its_least_and_the_gauge_stays():
    b, _, K = taken(SHIFT)
    settings = PaperSettings(mu_0=1e-2, tau=0.5, mu_min=2e-3, motion_steps=1, latent=LatentSettings(steps=3))
    start = off(K).trajectory.shifted(np.array([0.5, 0.2]))
    rounds = list(itertools.islice(alternate(b, camera=K.camera, start=start, settings=settings), 4))
    assert [r.mu for r in rounds] == pytest.approx([1e-2, 5e-3, 2.5e-3, 2e-3])
    for r in rounds:
        np.testing.assert_array_equal(r.trajectory.coefficients[0], start.coefficients[0])
        assert r.sharp.shape == b.shape


def test_settings_out_of_range_are_refused():
    with pytest.raises(ValueError, match="tau must lie in"):
        PaperSettings(tau=1.5)
    with pytest.raises(ValueError, match="mu_min must lie in"):
        PaperSettings(mu_min=0.1)
