"""Differences, proximal maps, conjugate gradients and ADMM do what their equations say."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsvideo.solvers.conjugate_gradient import NormalMatrix, conjugate_gradient
from rsvideo.solvers.differences import Differences
from rsvideo.solvers.operator import LinearOperator
from rsvideo.solvers.prox import box, hard_threshold, soft_threshold
from rsvideo.solvers.stopping import Status, solve
from rsvideo.solvers.total_variation import objective, total_variation

RNG = np.random.default_rng(0)


class Dense:
    """A matrix on images of one shape."""

    def __init__(self, matrix, shape):
        self.matrix, self.shape = matrix, shape

    def forward(self, x, /):
        return (self.matrix @ x.ravel()).reshape(self.shape)

    def adjoint(self, y, /):
        return (self.matrix.T @ y.ravel()).reshape(self.shape)


def as_matrix(forward, shape):
    columns = []
    for n in range(int(np.prod(shape))):
        unit = np.zeros(shape)
        unit.flat[n] = 1
        columns.append(forward(unit).ravel())
    return np.array(columns).T


@pytest.mark.parametrize("periodic", [True, False])
def test_adjoint_is_the_transpose(periodic):
    D = Differences(periodic_cols=periodic)
    assert isinstance(D, LinearOperator)
    x, g = RNG.random((6, 9)), RNG.random((2, 6, 9))
    assert np.vdot(D.forward(x), g) == pytest.approx(np.vdot(x, D.adjoint(g)), rel=1e-12)


def test_differences_count_to_the_right_and_down():
    D = Differences()
    x, y = D.forward(np.array([[1.0, 3.0], [10.0, 20.0]]))
    np.testing.assert_array_equal(x, [[2, 0], [10, 0]])
    np.testing.assert_array_equal(y, [[9, 17], [0, 0]])
    assert Differences(periodic_cols=True).forward(np.array([[1.0, 3.0]]))[0, 0, 1] == -2


@given(st.floats(-3, 3), st.floats(0.01, 2))
def test_each_prox_is_the_least_of_its_objective(v, t):
    x = np.linspace(-4, 4, 8001)
    for prox, penalty in (
        (soft_threshold(np.array([v]), t), t * np.abs(x)),
        (hard_threshold(np.array([v]), t), t * (np.abs(x) > 1e-9)),
        (box(np.array([v]), -t, t), np.where(np.abs(x) <= t + 1e-9, 0, np.inf)),
    ):
        values = penalty + 0.5 * (x - v) ** 2
        at_prox = np.interp(prox[0], x, 0.5 * (x - v) ** 2) + np.interp(prox[0], x, np.where(np.isinf(penalty), 0, penalty))
        assert at_prox <= values.min() + 1e-3


def test_conjugate_gradients_end_within_as_many_steps_as_unknowns():
    shape = (4, 5)
    A = RNG.random((20, 20))
    N = NormalMatrix(blur=Dense(A, shape), gradient=Differences(), rho=0.3, scale=2.0, weights=RNG.random(shape), eps=0.1)
    rhs = RNG.random(shape)
    found = solve(conjugate_gradient(N, rhs, np.zeros(shape)), steps=25, tolerance=1e-11)
    D = as_matrix(Differences().forward, shape)
    assert N.weights is not None
    matrix = 2.0 * A.T @ np.diag(N.weights.ravel()) @ A + 0.3 * D.T @ D + 0.1 * np.eye(20)
    np.testing.assert_allclose(found.state.x.ravel(), np.linalg.solve(matrix, rhs.ravel()), rtol=1e-7)
    assert found.status == Status.CONVERGED
    assert found.steps <= 22


def test_the_residual_that_conjugate_gradients_report_is_true():
    shape = (4, 5)
    N = NormalMatrix(blur=Dense(RNG.random((20, 20)), shape), gradient=Differences(), rho=0.3)
    rhs = RNG.random(shape)
    state = solve(conjugate_gradient(N, rhs, RNG.random(shape)), steps=5).state
    assert state.change == pytest.approx(np.linalg.norm(rhs - N(state.x)) / np.linalg.norm(rhs), rel=1e-9)


def restored(b, blur, *, mu, steps, valid=None, rho=0.5):
    """By exact l-updates; pixels that are not valid are completed from K l."""
    shape, D = b.shape, Differences()
    matrix = as_matrix(blur.forward, shape)
    gradient = as_matrix(D.forward, shape)
    inverse = np.linalg.inv(matrix.T @ matrix + rho * gradient.T @ gradient)

    def update(data, h, _):
        latent = (inverse @ (matrix.T @ data.ravel() + rho * h.ravel())).reshape(shape)
        return latent, data if valid is None else np.where(valid, b, blur.forward(latent))

    states = total_variation(b, mu=mu, rho=rho, gradient=D, update=update, start=np.zeros(shape))
    return solve(states, steps=steps, tolerance=1e-12).state.latent


def test_total_variation_of_a_step_is_the_known_answer():
    """Both halves of an unblurred step of n columns move towards each other by mu / n."""
    b = np.repeat([[0.0] * 4 + [1.0] * 4], 3, axis=0)
    expected = np.repeat([[0.02] * 4 + [0.98] * 4], 3, axis=0)
    L = restored(b, Dense(np.eye(24), b.shape), mu=0.08, steps=3000)
    np.testing.assert_allclose(L, expected, atol=1e-6)


@pytest.mark.parametrize("incomplete", [True, False])
def test_no_image_near_the_one_found_has_a_lower_objective(incomplete):
    shape, mu = (5, 6), 0.01
    blur = Dense(np.eye(30) + 0.3 * np.eye(30, k=1), shape)
    b = RNG.random(shape)
    valid = RNG.random(shape) > 0.3 if incomplete else np.ones(shape, bool)
    L = restored(b, blur, mu=mu, steps=6000, valid=valid)

    def value(latent):
        return objective(latent, b, mu=mu, blur=blur, gradient=Differences(), weights=valid.astype(float))

    found = value(L)
    for seed in range(40):
        away = np.random.default_rng(seed).normal(size=shape) * 10.0 ** -(seed % 4)
        assert value(L + away) > found - 1e-9


def test_the_penalty_changes_the_steps_and_not_the_image():
    shape = (5, 6)
    blur = Dense(np.eye(30) + 0.3 * np.eye(30, k=1), shape)
    b = RNG.random(shape)
    low, high = (restored(b, blur, mu=0.01, steps=6000, rho=rho) for rho in (0.1, 1.0))
    np.testing.assert_allclose(low, high, atol=1e-6)


def test_a_pixel_that_is_completed_says_nothing():
    shape = (5, 6)
    blur = Dense(np.eye(30) + 0.3 * np.eye(30, k=1), shape)
    b, valid = RNG.random(shape), np.ones(shape, bool)
    valid[2, 3] = False
    other = b.copy()
    other[2, 3] = 50.0
    one, two = (restored(x, blur, mu=0.01, steps=6000, valid=valid) for x in (b, other))
    np.testing.assert_allclose(one, two, atol=1e-6)


def test_the_change_of_a_state_is_how_far_its_step_went():
    b = RNG.random((3, 4))
    states = total_variation(
        b, mu=0.1, rho=0.5, gradient=Differences(), update=lambda data, _, latent: (latent + 1, data), start=np.zeros((3, 4))
    )
    assert [state.change for _, state in zip(range(3), states, strict=False)] == [np.inf, 1.0, 0.5]
