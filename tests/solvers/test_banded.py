"""Batches of banded systems agree with the same systems written out."""

import os
import subprocess
import sys

import numpy as np
import pytest

from rsvideo.lanes import LANES
from rsvideo.solvers.banded import BandedHermitian, blocks

ROWS, WIDTH, FREQUENCIES = 14, 4, LANES + 5
NOTHING = np.zeros(FREQUENCIES, np.float32)


def systems(seed=0) -> BandedHermitian:
    """Positive definite: the diagonal outweighs the rest of its row."""
    rng = np.random.default_rng(seed)
    shape = (blocks(FREQUENCIES), ROWS, WIDTH, LANES)
    re, im = rng.normal(size=shape).astype(np.float32), rng.normal(size=shape).astype(np.float32)
    re[:, :, 0] = 10 + np.abs(re[:, :, 0])
    im[:, :, 0] = 0
    return BandedHermitian(re=re, im=im, frequencies=FREQUENCIES)


def test_as_many_blocks_as_hold_the_batch():
    assert [blocks(n) for n in (1, LANES, LANES + 1)] == [1, 1, 2]


def test_written_out_the_matrix_is_hermitian_and_has_its_band():
    N = systems()
    full = N.dense(LANES + 2)
    np.testing.assert_array_equal(full, full.conj().T)
    assert full[3, 5] == N.re[1, 3, 2, 2] + 1j * N.im[1, 3, 2, 2]
    assert full[3, 3 + WIDTH] == 0


@pytest.mark.parametrize("f", [0, LANES - 1, LANES, FREQUENCIES - 1])
def test_solve_agrees_with_the_dense_solution(f):
    N = systems()
    rng = np.random.default_rng(1)
    rhs = (rng.normal(size=(ROWS, FREQUENCIES)) + 1j * rng.normal(size=(ROWS, FREQUENCIES))).astype(np.complex64)
    before = rhs.copy()
    x = N.factor(NOTHING).solve(rhs)
    np.testing.assert_allclose(x[:, f], np.linalg.solve(N.dense(f), rhs[:, f]), atol=1e-6)
    np.testing.assert_array_equal(rhs, before)


def test_one_factor_serves_many_right_hand_sides_and_the_matrix_stays():
    N = systems()
    re = N.re.copy()
    factor = N.factor(NOTHING)
    rhs = np.random.default_rng(2).normal(size=(ROWS, FREQUENCIES)).astype(np.complex64)
    np.testing.assert_array_equal(factor.solve(rhs), factor.solve(rhs))
    np.testing.assert_array_equal(N.re, re)


def test_several_right_hand_sides_are_solved_at_once():
    N = systems()
    rhs = np.random.default_rng(4).normal(size=(3, ROWS, FREQUENCIES)).astype(np.complex64)
    factor = N.factor(NOTHING)
    np.testing.assert_array_equal(factor.solve(rhs), np.stack([factor.solve(side) for side in rhs]))


@pytest.mark.parametrize("neighbour", [0.0, 0.7])
def test_a_factor_takes_in_a_diagonal_and_differences_of_rows_that_are_free_at_both_ends(neighbour):
    N = systems()
    re = N.re.copy()
    diagonal = np.random.default_rng(3).random(FREQUENCIES).astype(np.float32)
    D = np.diff(np.eye(ROWS), axis=0)
    factor = N.factor(diagonal, neighbour, scale=1.5)
    for f in (0, LANES - 1, LANES + 1):
        R = np.triu(BandedHermitian(re=factor.re, im=factor.im, frequencies=FREQUENCIES).dense(f))
        expected = 1.5 * N.dense(f) + diagonal[f] * np.eye(ROWS) + neighbour * D.T @ D
        np.testing.assert_allclose(R.conj().T @ R, expected, atol=1e-5)
    np.testing.assert_array_equal(N.re, re)


def test_lanes_beyond_the_batch_can_be_factored():
    nothing = np.zeros((blocks(FREQUENCIES), ROWS, WIDTH, LANES), np.float32)
    factor = BandedHermitian(re=nothing, im=nothing, frequencies=FREQUENCIES).factor(np.full(FREQUENCIES, 2, np.float32))
    assert np.isfinite(factor.re).all()
    np.testing.assert_allclose(factor.solve(np.ones((ROWS, FREQUENCIES), np.complex64)), 0.5, rtol=1e-6)


SOLVED = """
import hashlib, numpy as np
from rsvideo.solvers.banded import BandedHermitian, blocks
rng = np.random.default_rng(0)
band = 0.1 * rng.standard_normal((2, blocks(40), 60, 9, 16), dtype=np.float32)
band[0, :, :, 0] += 6
band[1, :, :, 0] = 0
solved = BandedHermitian(re=band[0], im=band[1], frequencies=40).factor(np.zeros(40, np.float32)).solve(rng.standard_normal((60, 40)))
print(hashlib.sha256(solved.tobytes()).hexdigest())
"""


@pytest.mark.slow
def test_loops_that_are_compiled_just_now_give_the_bits_that_cached_ones_give(tmp_path):
    env = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path)}
    compiled, cached = (
        subprocess.run([sys.executable, "-c", SOLVED], env=env, capture_output=True, text=True, timeout=120, check=True).stdout
        for _ in range(2)
    )
    assert compiled == cached
