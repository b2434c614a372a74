"""The blur of shift trajectories on the device, of all tiles of a frame at once.

The twin of `rsvideo.physics.row_fourier`: the symbol A_f(i, base_i + o) is kept as (tiles, rows, width, frequencies) in complex64, so
that threads side by side read side by side. The tiles share one grid, the smallest that holds what each of them sees.
"""

import math
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float
from numba import complex64, cuda, float32

from rsvideo.gpu.arrays import Array, blocks_of, launch, xp
from rsvideo.physics.row_fourier import Extent, Grid

_THREADS = 128  # of a block, each with a frequency
_TURN = 2 * math.pi


@no_type_check
@cuda.jit(cache=True)
def _symbol(dx, first, across, period, symbol):
    """A_f(i, base_i + o) = (1/K) sum_k exp(2 pi i f dx_ik) w(o - first_ik); symbol is zero on entry."""
    t, i = cuda.blockIdx.z, cuda.blockIdx.y
    samples, taps = across.shape[2], across.shape[3]
    share = float32(1) / float32(samples)
    for f in range(cuda.grid(1), symbol.shape[3], cuda.gridsize(1)):
        for k in range(samples):
            turns = dx[t, i, k] * f / period  # in double precision: many turns at the highest frequencies
            angle = float32(_TURN * (turns - math.floor(turns)))
            z = complex64(complex(math.cos(angle) * share, math.sin(angle) * share))
            for tap in range(taps):
                symbol[t, i, first[t, i, k] + tap, f] += z * across[t, i, k, tap]


@no_type_check
@cuda.jit(cache=True)
def _forward(symbol, base, x, out):
    """out[i] = sum_o A[i, o] x[base_i + o]; x (tiles, channels, latent rows, frequencies), out with rows."""
    t, i = cuda.blockIdx.z, cuda.blockIdx.y
    j = base[t, i]
    for f in range(cuda.grid(1), symbol.shape[3], cuda.gridsize(1)):
        for c in range(x.shape[1]):
            total = complex64(0)
            for o in range(symbol.shape[2]):
                total += symbol[t, i, o, f] * x[t, c, j + o, f]
            out[t, c, i, f] = total


@no_type_check
@cuda.jit(cache=True)
def _adjoint(symbol, base, readers, y, out):
    """out[j] = sum_i conj(A[i, j - base_i]) y[i], over the scanlines [readers_j0, readers_j1) that may see row j."""
    t, j = cuda.blockIdx.z, cuda.blockIdx.y
    for f in range(cuda.grid(1), symbol.shape[3], cuda.gridsize(1)):
        for c in range(y.shape[1]):
            total = complex64(0)
            for i in range(readers[t, j, 0], readers[t, j, 1]):
                o = j - base[t, i]
                if 0 <= o < symbol.shape[2]:
                    total += symbol[t, i, o, f].conjugate() * y[t, c, i, f]
            out[t, c, j, f] = total


@no_type_check
@cuda.jit(cache=True)
def _gram(symbol, base, readers, band):
    """The upper band of A^H A, (tiles, frequencies, latent rows, width)."""
    t, j, width = cuda.blockIdx.z, cuda.blockIdx.y, symbol.shape[2]
    for f in range(cuda.grid(1), symbol.shape[3], cuda.gridsize(1)):
        for o in range(width):
            total = complex64(0)
            for i in range(readers[t, j, 0], readers[t, j, 1]):
                p = j - base[t, i]
                if 0 <= p < width - o:
                    total += symbol[t, i, p, f].conjugate() * symbol[t, i, p + o, f]
            band[t, f, j, o] = total


@dataclass(frozen=True, kw_only=True, eq=False)
class RowFourier(Grid):
    """K(theta) of tiles side by side, which share one grid."""

    rows: int
    base: Array  # (tiles, rows): the first latent row that each scanline sees
    readers: Array  # (tiles, latent rows, 2): the first and the last scanline that may see each latent row, the last excluded
    symbol: Array  # (tiles, rows, width, frequencies)

    @property
    def tiles(self) -> int:
        """How many."""
        return self.symbol.shape[0]

    def spectrum(self, image: Array) -> Array:
        """The Fourier transform along rows, of (..., period) to (..., frequencies)."""
        return xp.fft.rfft(image, axis=-1)

    def image(self, spectrum: Array) -> Array:
        """The inverse of `spectrum`."""
        return xp.fft.irfft(spectrum, n=self.period, axis=-1)

    def forward(self, latent: Array) -> Array:
        """K l, spectrum to spectrum: (tiles, channels, latent rows, frequencies) to (tiles, channels, rows, frequencies)."""
        out = xp.empty((*latent.shape[:2], self.rows, self.frequencies), xp.complex64)
        launch(_forward, self._blocks(self.rows), (_THREADS,), self.symbol, self.base, latent, out)
        return out

    def adjoint(self, frame: Array) -> Array:
        """K^H b, spectrum to spectrum."""
        out = xp.empty((*frame.shape[:2], self.latent_rows, self.frequencies), xp.complex64)
        launch(_adjoint, self._blocks(self.latent_rows), (_THREADS,), self.symbol, self.base, self.readers, frame, out)
        return out

    def gram(self) -> Array:
        """The upper bands of A^H A, (tiles * frequencies, latent rows, width), as `rsvideo.gpu.banded` stores them."""
        width = self.symbol.shape[2]
        band = xp.empty((self.tiles, self.frequencies, self.latent_rows, width), xp.complex64)
        launch(_gram, self._blocks(self.latent_rows), (_THREADS,), self.symbol, self.base, self.readers, band)
        return band.reshape(-1, self.latent_rows, width)

    def _blocks(self, rows: int) -> tuple[int, int, int]:
        return blocks_of(self.frequencies, _THREADS), rows, self.tiles


def row_fourier(displacement: Float[np.ndarray, "tiles rows samples 2"], reach: Extent) -> RowFourier:
    """The operator of tiles whose scanline i samples the latent image at offsets `displacement[t, i, k]` (x, y), within `reach`."""
    tiles, rows = displacement.shape[:2]
    symbol = xp.zeros((tiles, rows, reach.width, reach.frequencies), xp.complex64)
    dx = xp.asarray(np.ascontiguousarray(displacement[..., 0], dtype=float))
    how = dx, xp.asarray(reach.first.astype(np.int32)), xp.asarray(reach.across.astype(np.float32)), float(reach.period)
    launch(_symbol, (blocks_of(symbol.shape[3], _THREADS), rows, tiles), (_THREADS,), *how, symbol)
    return RowFourier(
        rows=rows,
        top=reach.top,
        latent_rows=reach.latent_rows,
        left=reach.left,
        period=reach.period,
        base=xp.asarray(reach.base.astype(np.int32)),
        readers=xp.asarray(_readers(reach.base, reach.width, reach.latent_rows)),
        symbol=symbol,
    )


def _readers(base: np.ndarray, width: int, latent_rows: int) -> np.ndarray:
    """For each tile and latent row j, scanlines [first, last) among which are all with base_i <= j < base_i + width."""
    rows = base.shape[1]
    out = np.zeros((len(base), latent_rows, 2), np.int32)
    for t, begins in enumerate(base):
        latest, earliest = np.full(latent_rows, -1), np.full(latent_rows, rows)
        np.maximum.at(latest, begins, np.arange(rows))
        np.minimum.at(earliest, begins, np.arange(rows))
        from_here_on = np.minimum.accumulate(earliest[::-1])[::-1]
        out[t, :, 0] = from_here_on[np.maximum(np.arange(latent_rows) - width + 1, 0)]
        out[t, :, 1] = np.maximum.accumulate(latest) + 1
    return out
