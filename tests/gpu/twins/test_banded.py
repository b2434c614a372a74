"""Batches of banded systems on the device agree with the same systems written out, and with their block-tridiagonal twin."""

import numpy as np
import pytest

from rsvideo.gpu import arrays, banded
from rsvideo.gpu.arrays import to_host, xp
from rsvideo.gpu.banded import BandedHermitian
from rsvideo.lanes import LANES
from tests.gpu import block_tridiagonal

LARGE = not arrays.SIMULATED
BATCHES, FREQUENCIES, SIDES = (3, 65, 3) if LARGE else (3, 3, 2)  # an odd number of systems: two share a block where rows are short
SHAPES = [(300, 12), (1080, 41), (7, 20)] if LARGE else [(35, 4), (37, 2), (3, 19)]  # rows and widths; chunks are 32 rows, some cut
NEIGHBOUR = 0.7


def systems(rows: int, width: int, seed: int = 0) -> np.ndarray:
    """Positive definite: the diagonal outweighs the rest of its row."""
    rng = np.random.default_rng(seed)
    shape = BATCHES * FREQUENCIES, rows, width
    band = (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)
    band[..., 0] = 4 * width + np.abs(band[..., 0])
    for o in range(width):
        band[:, max(0, rows - o) :, o] = 0  # beyond the last column
    return band


def sides(rows: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    shape = BATCHES, SIDES, rows, FREQUENCIES
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


def whole(band: np.ndarray, diagonal: np.ndarray) -> np.ndarray:
    """N + diagonal(f) I + neighbour D^T D, written out."""
    D = np.diff(np.eye(band.shape[1]), axis=0)
    each = np.tile(diagonal, BATCHES)[:, None, None] * np.eye(band.shape[1])
    return block_tridiagonal.dense(band) + each + NEIGHBOUR * D.T @ D


@pytest.mark.parametrize(("rows", "width"), SHAPES)
@pytest.mark.parametrize("bytes_shared", [arrays.SHARED_BYTES, 500], ids=["in a window", "in place, by few rows"])
def test_solve_agrees_with_the_dense_solution(rows: int, width: int, bytes_shared: int, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(banded, "SHARED_BYTES", bytes_shared)
    band, b = systems(rows, width), sides(rows)
    diagonal = np.random.default_rng(2).random(FREQUENCIES).astype(np.float32)
    factor = BandedHermitian(band=xp.asarray(band)).factor(xp.asarray(diagonal), NEIGHBOUR)
    x = to_host(factor.solve(xp.asarray(b)))
    by_system = b.transpose(0, 3, 2, 1).reshape(BATCHES * FREQUENCIES, rows, SIDES)
    expected = np.linalg.solve(whole(band, diagonal), by_system)
    found = x.transpose(0, 3, 2, 1).reshape(expected.shape)
    np.testing.assert_allclose(found, expected, atol=2e-6 * np.abs(expected).max())


def test_solve_agrees_with_the_block_tridiagonal_twin() -> None:
    rows, width = SHAPES[0]
    band, b = systems(rows, width), sides(rows)
    nothing = xp.zeros(FREQUENCIES, xp.float32)
    x = to_host(BandedHermitian(band=xp.asarray(band)).factor(nothing, 0.0).solve(xp.asarray(b)))
    twin = block_tridiagonal.solved(xp.asarray(band), xp.asarray(b.transpose(0, 3, 2, 1).reshape(-1, rows, SIDES)), xp)
    np.testing.assert_allclose(x.transpose(0, 3, 2, 1).reshape(-1, rows, SIDES), to_host(twin), atol=1e-6)


def test_the_factor_is_that_of_the_processor() -> None:
    from rsvideo.solvers import banded as twin

    rows, width = SHAPES[0]
    band = systems(rows, width)
    padded = np.zeros((twin.blocks(len(band)) * LANES, rows, width), np.complex64)
    padded[: len(band)] = band
    padded[len(band) :, :, 0] = 1
    lanes = padded.reshape(-1, LANES, rows, width).transpose(0, 2, 3, 1)
    there = twin.BandedHermitian(re=lanes.real.copy(), im=lanes.imag.copy(), frequencies=len(band)).factor(np.zeros(len(band), np.float32))
    expected = (there.re + 1j * there.im).transpose(0, 3, 1, 2).reshape(padded.shape)[: len(band)]
    nothing = xp.zeros(FREQUENCIES, xp.float32)
    found = to_host(BandedHermitian(band=xp.asarray(band)).factor(nothing, 0.0).factor).reshape(band.shape)
    np.testing.assert_allclose(1 / found[..., 0], expected[..., 0], rtol=1e-5)
    np.testing.assert_allclose(found[..., 1:], expected[..., 1:], atol=1e-6)
