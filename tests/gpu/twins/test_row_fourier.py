"""The blur on the device is the processor's, and of several tiles the sum that defines it."""

import numpy as np
import pytest

from rsvideo.gpu import arrays, row_fourier
from rsvideo.gpu.arrays import to_host, xp
from rsvideo.physics import row_fourier as twin
from rsvideo.physics.row_fourier import RowFourier, extent

LARGE = not arrays.SIMULATED
ROWS, COLS, SAMPLES, CHANNELS = (240, 320, 30, 3) if LARGE else (6, 9, 4, 2)


def path(tiles: int, seed: int = 0) -> np.ndarray:
    """Shifts of every scanline's samples, some beyond every side; each tile's has an extent of its own."""
    rng = np.random.default_rng(seed)
    shifts = rng.uniform([-4.7, -1.6], [3.3, 2.4], (tiles, ROWS, SAMPLES, 2))
    return (shifts + np.arange(tiles)[:, None, None, None] * np.array([1.5, -1.2])).astype(np.float32)


def noise(*shape: int, seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return (rng.normal(size=shape) + 1j * rng.normal(size=shape)).astype(np.complex64)


@pytest.fixture(scope="module")
def pair() -> tuple[row_fourier.RowFourier, RowFourier]:
    """The same blur of one tile on both."""
    offsets = path(1)
    return row_fourier.row_fourier(offsets, extent(offsets, COLS)), twin.row_fourier(offsets[0], COLS)


def lanes(re: np.ndarray, im: np.ndarray, frequencies: int) -> np.ndarray:
    """(frequencies, rows, width) of what the processor keeps in lanes."""
    return (re + 1j * im).transpose(0, 3, 1, 2).reshape(-1, *re.shape[1:3])[:frequencies]


def test_the_symbol_and_the_normal_matrix_are_the_processors(pair: tuple[row_fourier.RowFourier, RowFourier]) -> None:
    ours, theirs = pair
    symbol = lanes(theirs.re, theirs.im, theirs.frequencies).transpose(1, 2, 0)
    np.testing.assert_allclose(to_host(ours.symbol)[0], symbol, atol=1e-5 if LARGE else 2e-7)
    np.testing.assert_allclose(to_host(ours.gram()), lanes(*theirs.gram(), theirs.frequencies), atol=2e-6)


def test_forward_and_adjoint_are_the_processors(pair: tuple[row_fourier.RowFourier, RowFourier]) -> None:
    ours, theirs = pair
    x, y = noise(1, CHANNELS, ours.latent_rows, ours.frequencies), noise(1, CHANNELS, ROWS, ours.frequencies, seed=2)
    forward, adjoint = to_host(ours.forward(xp.asarray(x))), to_host(ours.adjoint(xp.asarray(y)))
    for c in range(CHANNELS):
        np.testing.assert_allclose(forward[0, c], theirs.forward(x[0, c]), atol=2e-5 if LARGE else 1e-6)
        np.testing.assert_allclose(adjoint[0, c], theirs.adjoint(y[0, c]), atol=2e-5 if LARGE else 1e-6)


def test_adjoint_is_the_conjugate_transpose_of_all_tiles() -> None:
    offsets = path(2)
    op = row_fourier.row_fourier(offsets, extent(offsets, COLS))
    x, y = noise(2, CHANNELS, op.latent_rows, op.frequencies), noise(2, CHANNELS, ROWS, op.frequencies, seed=2)
    one, other = complex(np.vdot(y, to_host(op.forward(xp.asarray(x))))), complex(np.vdot(to_host(op.adjoint(xp.asarray(y))), x))
    assert abs(one - other) < 1e-6 * np.linalg.norm(x) * np.linalg.norm(y)


@pytest.mark.parametrize("f", [0, 3, -1])
def test_each_tile_is_the_dense_matrix_of_its_own_path(f: int) -> None:
    offsets = path(2)
    reach = extent(offsets, COLS)
    op = row_fourier.row_fourier(offsets, reach)
    f = f % op.frequencies
    x = noise(2, 1, op.latent_rows, op.frequencies)
    out, band = to_host(op.forward(xp.asarray(x))), to_host(op.gram()).reshape(2, op.frequencies, op.latent_rows, -1)
    for t in range(2):
        A = np.zeros((ROWS, op.latent_rows), complex)
        for i in range(ROWS):
            for dx, dy in offsets[t, i]:
                weight = np.maximum(0.0, 1 - np.abs(np.arange(op.latent_rows) - op.top - i - dy))
                A[i] += np.exp(2j * np.pi * f * dx / op.period) * weight / SAMPLES
        np.testing.assert_allclose(out[t, 0, :, f], A @ x[t, 0, :, f], atol=1e-5)
        N = A.conj().T @ A
        for o in range(reach.width):
            np.testing.assert_allclose(band[t, f, : op.latent_rows - o, o], np.diagonal(N, o), atol=1e-6)
