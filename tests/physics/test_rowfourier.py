"""One banded matrix per frequency is the blur of a shift path, written out."""

import numpy as np
import pytest

from rsvideo.physics.row_fourier import RowFourier, row_fourier
from rsvideo.solvers.banded import BandedHermitian

ROWS, COLS, SAMPLES = 11, 23, 5


def path(seed=0):
    """Shifts of every scanline's samples, some beyond every side of the frame."""
    return np.random.default_rng(seed).uniform([-4.7, -2.6], [3.3, 3.4], (ROWS, SAMPLES, 2))


def waves(op: RowFourier, seed=1):
    """A latent image with nothing at or above half the sampling rate along its rows, and its value between columns."""
    rng = np.random.default_rng(seed)
    count = op.period // 2
    size, phase = rng.random((op.latent_rows, count)), rng.uniform(0, 2 * np.pi, (op.latent_rows, count))

    def at(row, x):
        return float(np.sum(size[row] * np.cos(2 * np.pi * np.arange(count) * x / op.period + phase[row])))

    return np.array([[at(j, x) for x in range(op.period)] for j in range(op.latent_rows)], np.float32), at


def matrix(op: RowFourier, offsets, f, weights=None):
    """A_f(i, j) = sum_k s_ik exp(2 pi i f dx_ik) w(j - i - dy_ik), with w linear interpolation and s_ik = 1/K by default."""
    weights = np.full((ROWS, SAMPLES), 1 / SAMPLES) if weights is None else weights
    A = np.zeros((ROWS, op.latent_rows), complex)
    for i in range(ROWS):
        for (dx, dy), share in zip(offsets[i], weights[i], strict=True):
            for j in range(op.latent_rows):
                w = max(0.0, 1 - abs(j - op.top - i - dy))
                A[i, j] += np.exp(2j * np.pi * f * dx / op.period) * w * share
    return A


def noise(rows, op, seed):
    rng = np.random.default_rng(seed)
    return (rng.normal(size=(rows, op.frequencies)) + 1j * rng.normal(size=(rows, op.frequencies))).astype(np.complex64)


def test_forward_is_the_mean_over_the_path_sampled_between_the_pixels():
    offsets = path()
    op = row_fourier(offsets, COLS)
    latent, at = waves(op)
    blurred = op.image(op.forward(op.spectrum(latent)))
    for i in range(ROWS):
        for column in (0, 7, COLS - 1):
            expected = 0.0
            for dx, dy in offsets[i]:
                y, x = op.top + i + dy, op.left + column + dx
                below = int(np.floor(y))
                expected += ((below + 1 - y) * at(below, x) + (y - below) * at(below + 1, x)) / SAMPLES
            assert blurred[i, op.left + column] == pytest.approx(expected, abs=2e-5)


def test_positive_x_takes_the_sample_from_the_right_and_positive_y_from_below():
    offsets = np.broadcast_to([2.0, 1.0], (ROWS, SAMPLES, 2))
    op = row_fourier(offsets, COLS)
    latent = np.random.default_rng(2).random((op.latent_rows, op.period)).astype(np.float32)
    blurred = op.image(op.forward(op.spectrum(latent)))
    inside = slice(op.left, op.left + COLS)
    right, below = slice(op.left + 2, op.left + 2 + COLS), slice(op.top + 1, op.top + 1 + ROWS)
    np.testing.assert_allclose(blurred[:, inside], latent[below, right], atol=1e-5)


def test_all_that_the_path_sees_lies_in_the_latent_image_and_no_period_wraps_into_the_frame():
    offsets = path(3)
    op = row_fourier(offsets, COLS)
    dx, dy = offsets[..., 0], offsets[..., 1] + np.arange(ROWS)[:, None]
    assert op.top + np.floor(dy).min() >= 0
    assert op.top + np.ceil(dy).max() < op.latent_rows
    assert op.left + dx.min() >= 0
    assert op.left + COLS - 1 + dx.max() < op.period


def test_adjoint_is_the_conjugate_transpose():
    op = row_fourier(path(), COLS)
    x, y = noise(op.latent_rows, op, 4), noise(ROWS, op, 5)
    one, other = np.vdot(y, op.forward(x)), np.vdot(op.adjoint(y), x)
    assert abs(one - other) < 1e-6 * np.linalg.norm(x) * np.linalg.norm(y)


@pytest.mark.parametrize("f", [0, 3, 16, -1])
def test_samples_of_unequal_weight_are_the_dense_matrix_of_their_weighted_sum(f):
    weights = np.random.default_rng(6).dirichlet(np.ones(SAMPLES), ROWS)
    op = row_fourier(path(), COLS, weights=weights)
    f = f % op.frequencies
    x = noise(op.latent_rows, op, 4)
    np.testing.assert_allclose(op.forward(x)[:, f], matrix(op, path(), f, weights) @ x[:, f], atol=1e-5)


def test_equal_weights_change_nothing():
    plain, weighted = row_fourier(path(), COLS), row_fourier(path(), COLS, weights=np.full((ROWS, SAMPLES), 1 / SAMPLES))
    np.testing.assert_array_equal(weighted.re, plain.re)
    np.testing.assert_array_equal(weighted.im, plain.im)


@pytest.mark.parametrize("f", [0, 1, 15, 16, -1])  # the first and last of blocks of 16, and half the sampling rate
def test_gram_is_the_dense_normal_matrix(f):
    offsets = path()
    op = row_fourier(offsets, COLS)
    f = f % op.frequencies
    re, im = op.gram()
    A = matrix(op, offsets, f)
    banded = BandedHermitian(re=re, im=im, frequencies=op.frequencies)
    np.testing.assert_allclose(banded.dense(f), A.conj().T @ A, atol=1e-6)
