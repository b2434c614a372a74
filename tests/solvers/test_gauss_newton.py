"""Gauss-Newton takes only steps that lower its objective, and finds what it should."""

import itertools
import math

import numpy as np
import pytest

from rsvideo.solvers.gauss_newton import gauss_newton, quadratic
from rsvideo.solvers.stopping import Status, solve

RNG = np.random.default_rng(0)


def problem(residual, jacobian):
    return (lambda x: quadratic(residual(x), jacobian(x)).value), (lambda x: quadratic(residual(x), jacobian(x)))


def test_a_linear_problem_takes_one_undamped_step():
    A, b = RNG.random((9, 3)), RNG.random(9)
    found = solve(gauss_newton(*problem(lambda x: A @ x - b, lambda _: A.T), np.zeros(3), damping=0.0), steps=1).state
    np.testing.assert_allclose(found.theta, np.linalg.lstsq(A, b)[0], rtol=1e-9)


def rosenbrock():
    return problem(lambda x: np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]]), lambda x: np.array([[-20 * x[0], -1.0], [10.0, 0.0]]))


def test_the_banana_valley_is_crossed_within_thirty_steps():
    found = solve(gauss_newton(*rosenbrock(), np.array([-1.2, 1.0])), steps=30, tolerance=1e-14)
    np.testing.assert_allclose(found.state.theta, 1, atol=1e-6)


def test_every_step_lowers_the_objective():
    states = list(itertools.islice(gauss_newton(*rosenbrock(), np.array([-1.2, 1.0])), 12))
    values = [s.objective for s in states]
    assert values == sorted(values, reverse=True)
    assert len(set(values)) == len(values)


def test_a_full_step_that_would_overshoot_is_shortened():
    """arctan from 3: Newton's own iteration diverges from any start beyond 1.39."""
    found = solve(gauss_newton(*problem(np.arctan, lambda x: np.diag(1 / (1 + x**2))), np.array([3.0])), steps=40, tolerance=1e-12)
    assert abs(found.state.theta[0]) < 1e-5


def test_at_a_minimum_the_method_stalls_and_stays():
    residual = lambda x: np.array([x[0], 1.0])  # noqa: E731
    found = solve(gauss_newton(*problem(residual, lambda _: np.array([[1.0, 0.0]])), np.zeros(1)), steps=5)
    assert found.status == Status.STALLED
    assert (found.state.theta[0], found.steps) == (0, 0)


def test_a_trial_that_is_not_finite_is_refused():
    residual = lambda x: np.array([x[0] - 1 if x[0] < 0.5 else math.nan])  # noqa: E731
    found = solve(gauss_newton(*problem(residual, lambda _: np.array([[1.0]])), np.zeros(1)), steps=3).state
    assert 0 < found.theta[0] < 0.5


def test_sums_over_many_pixels_keep_their_precision():
    r = np.full(1_000_000, 0.1, np.float32)
    assert quadratic(r, r[None]).value == pytest.approx(0.5 * 1e6 * float(np.float32(0.1)) ** 2, rel=1e-7)
