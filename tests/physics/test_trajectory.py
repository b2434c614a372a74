"""Curves that are linear in their coefficients."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsvideo.physics.trajectory import Polynomial, Spline, Trajectory, VibratingSpline, centred, fit, path_error, still

T0, T1 = -0.01, 0.04


def vibrating(**parts):
    return VibratingSpline(**parts, frequencies=(40.0, 90.0), nodes=3)


KINDS = [(Polynomial, 1), (Polynomial, 5), (Spline, 4), (Spline, 9), (vibrating, 17)]
kinds = pytest.mark.parametrize(("kind", "terms"), KINDS, ids=[f"{kind.__name__}-{terms}" for kind, terms in KINDS])


def curve(kind, terms, seed=0, axes=3):
    return kind(t0=T0, t1=T1, coefficients=np.random.default_rng(seed).standard_normal((terms, axes)))


@kinds
def test_a_curve_is_a_trajectory(kind, terms):
    assert isinstance(curve(kind, terms), Trajectory)


@kinds
def test_the_basis_is_the_derivative_in_the_coefficients(kind, terms):
    p = curve(kind, terms)
    t = np.linspace(T0, T1, 13)
    for term in range(terms):
        for axis in range(3):
            step = np.zeros((terms, 3))
            step[term, axis] = 0.5
            change = (p.with_coefficients(p.coefficients + step).at(t) - p.with_coefficients(p.coefficients - step).at(t))[:, axis]
            np.testing.assert_allclose(change, p.basis(t)[:, term], atol=1e-12)


@kinds
def test_times_keep_their_shape(kind, terms):
    p = curve(kind, terms)
    t = np.linspace(T0, T1, 12).reshape(3, 2, 2)
    assert p.basis(t).shape == (3, 2, 2, terms)
    np.testing.assert_allclose(p.at(t), p.at(t.ravel()).reshape(3, 2, 2, 3), atol=1e-12)


def test_legendre_s_basis_is_orthonormal_over_the_interval():
    nodes, weights = np.polynomial.legendre.leggauss(16)
    B = curve(Polynomial, 7).basis(0.5 * ((T1 - T0) * nodes + T0 + T1))
    np.testing.assert_allclose(B.T @ (B * weights[:, None] / 2), np.eye(7), atol=1e-12)


def test_a_polynomial_of_degree_four_holds_the_paper_s_monomials():
    t = np.linspace(T0, T1, 50)
    poses = np.stack([3 * t**4 - t, 1 + t**2], axis=1)
    p = fit(still((T0, T1), degree=4, axes=2), t, poses)
    np.testing.assert_allclose(p.at(t), poses, atol=1e-12)


@pytest.mark.parametrize("terms", [4, 5, 9, 40])
def test_b_splines_are_positive_and_sum_to_one(terms):
    B = curve(Spline, terms).basis(np.linspace(T0, T1, 201))
    assert B.min() >= 0
    np.testing.assert_allclose(B.sum(axis=1), 1, atol=1e-12)


def test_a_spline_starts_and_ends_in_its_outer_coefficients():
    p = curve(Spline, 7)
    np.testing.assert_allclose(p.at(np.array([T0, T1])), p.coefficients[[0, -1]], atol=1e-12)


def test_a_spline_stays_at_its_ends_outside_the_interval():
    p = curve(Spline, 7)
    np.testing.assert_allclose(p.at(np.array([T0 - 1, T1 + 1])), p.coefficients[[0, -1]], atol=1e-12)


def test_a_spline_holds_any_cubic():
    t = np.linspace(T0, T1, 50)
    poses = np.stack([1e4 * t**3 - t, 1 + t**2], axis=1)
    p = fit(Spline(t0=T0, t1=T1, coefficients=np.zeros((8, 2))), t, poses)
    np.testing.assert_allclose(p.at(t), poses, atol=1e-10)


@kinds
@given(pose=st.tuples(*[st.floats(-1e3, 1e3)] * 3), time=st.floats(T0, T1))
def test_shifting_adds_a_pose_and_centring_takes_it_away(kind, terms, pose, time):
    p = curve(kind, terms)
    t = np.linspace(T0, T1, 9)
    moved = p.shifted(np.array(pose))
    np.testing.assert_allclose(moved.at(t), p.at(t) + np.array(pose), atol=1e-9)
    origin = centred(moved, time)
    np.testing.assert_allclose(origin.at(np.array([time]))[0], 0, atol=1e-9)
    np.testing.assert_allclose(origin.at(t) - origin.at(t[:1]), p.at(t) - p.at(t[:1]), atol=1e-9)


@kinds
def test_a_fit_returns_the_curve_that_was_sampled(kind, terms):
    p = curve(kind, terms)
    t = np.linspace(T0, T1, 60)
    np.testing.assert_allclose(fit(curve(kind, terms, seed=1), t, p.at(t)).coefficients, p.coefficients, atol=1e-9)


def test_a_fit_leaves_out_what_has_no_weight():
    p = curve(Polynomial, 3)
    t = np.linspace(T0, T1, 60)
    poses = p.at(t)
    poses[10] += 100
    weights = np.ones(60)
    weights[10] = 0
    np.testing.assert_allclose(fit(p, t, poses, weights).coefficients, p.coefficients, atol=1e-9)


def test_a_fit_weighs_squares():
    constant = still((0.0, 1.0), degree=0, axes=2)
    p = fit(constant, np.array([0.0, 1.0]), np.array([[0.0, 0.0], [4.0, 8.0]]), np.array([3.0, 1.0]))
    np.testing.assert_allclose(p.at(np.array([0.5]))[0], [1, 2], atol=1e-12)


def test_still_does_not_move():
    assert not still((T0, T1), degree=4, axes=3).at(np.linspace(T0, T1, 5)).any()


@pytest.mark.parametrize(("t0", "t1", "axes", "rule"), [(1.0, 1.0, 2, "t1 > t0"), (1.0, 0.0, 2, "t1 > t0"), (0.0, 1.0, 1, "2 or 3 axes")])
def test_an_impossible_curve_is_refused(t0, t1, axes, rule):
    with pytest.raises(ValueError, match=rule):
        Polynomial(t0=t0, t1=t1, coefficients=np.zeros((3, axes)))


def test_path_error_ignores_where_the_path_begins() -> None:
    path = np.random.default_rng(0).normal(size=(50, 2))
    off = path.copy()
    off[::2, 0] += 2
    assert path_error(path + 7, path) == pytest.approx(0)
    assert path_error(off, path) == pytest.approx(1)


def test_a_tone_of_a_vibrating_spline_changes_its_strength_evenly():
    t = np.linspace(T0, T1, 301)
    place = (t - T0) / (T1 - T0)
    wave = 3 * (1 - np.abs(2 * place - 1)) * np.sin(2 * np.pi * 90 * t)
    p = curve(vibrating, 17).with_coefficients(np.zeros((17, 2)))
    found = fit(p, t, np.stack([wave, 5 + 0 * t], axis=1))
    assert isinstance(found, VibratingSpline)
    np.testing.assert_allclose(found.at(t), np.stack([wave, 5 + 0 * t], axis=1), atol=1e-9)
    assert found.coefficients[5 + 6 + 2 + 1, 0] == pytest.approx(3)
    np.testing.assert_allclose(found.smooth.at(t)[:, 1], 5, atol=1e-9)
