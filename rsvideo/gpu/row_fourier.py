"""The blur of shift trajectories on the device, of all tiles of a frame at once.

The twin of `rsvideo.physics.row_fourier`: the symbol A_f(i, base_i + o) is kept as (tiles, rows, width, frequencies) in complex64, so
that threads side by side read side by side. The tiles share one grid, the smallest that holds what each of them sees.
"""

import math
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float32
from numba import complex64, cuda, float32, int32, uint32

from rsvideo.gpu.arrays import Array, OutOfMemory, blocks_of, launch, xp
from rsvideo.physics.row_fourier import Extent, Grid

_THREADS = 128  # of a block at most, each with a frequency
_WARP = 32  # threads that run in step
_TURN = 2 * math.pi
_TOGETHER = 4  # offsets of a normal matrix's row that a thread sums up side by side
_MOST = 1 << 31  # entries that an int32 finds


@no_type_check
@cuda.jit(cache=True)
def _symbol(offsets, base, top, period, samples, width, frequencies, symbol):
    """A_f(i, base_i + o) = (1/K) sum_k exp(2 pi i f dx_ik / period) w(base_i + o - top - i - dy_ik), w over two rows; symbol is zero on
    entry. The two rows are written to when the path leaves them."""
    row = int32(cuda.blockIdx.z * cuda.gridDim.y + cuda.blockIdx.y)
    samples, width, frequencies = int32(samples), int32(width), int32(frequencies)
    share = float32(1) / float32(samples)
    lowest = int32(base[cuda.blockIdx.z, cuda.blockIdx.y] - top - cuda.blockIdx.y)
    f = int32(cuda.grid(1))
    while f < frequencies:
        begin = row * width * frequencies + f
        turn = f / period
        at = int32(int32(math.floor(offsets[uint32(2 * row * samples + 1)])) - lowest)
        low, high = complex64(0), complex64(0)
        for n in range(int32(row * samples), int32((row + 1) * samples)):
            dy = offsets[uint32(2 * n + 1)]
            whole = int32(math.floor(dy))
            if whole - lowest != at:
                symbol[uint32(begin + at * frequencies)] += low
                symbol[uint32(begin + (at + 1) * frequencies)] += high
                at = int32(whole - lowest)
                low, high = complex64(0), complex64(0)
            turned = offsets[uint32(2 * n)] * turn  # in double precision: many turns at the highest frequencies
            angle = float32(_TURN * (turned - math.floor(turned)))
            z = complex64(complex(math.cos(angle) * share, math.sin(angle) * share))
            part = dy - float32(whole)
            low += z * (float32(1) - part)
            high += z * part
        symbol[uint32(begin + at * frequencies)] += low
        symbol[uint32(begin + (at + 1) * frequencies)] += high
        f = int32(f + cuda.gridsize(1))


@no_type_check
@cuda.jit(cache=True)
def _forward(symbol, base, channels, latent_rows, width, frequencies, x, out):
    """out[i] = sum_o A[i, o] x[base_i + o]; x (tiles, channels, latent rows, frequencies), out with rows; all flat."""
    rows, t, i = int32(cuda.gridDim.y), int32(cuda.blockIdx.z), int32(cuda.blockIdx.y)
    latent_rows, width, step = int32(latent_rows), int32(width), int32(frequencies)
    f = int32(cuda.grid(1))
    while f < step:
        for c in range(int32(t * channels), int32((t + 1) * channels)):
            at = (t * rows + i) * width * step + f
            of = (c * latent_rows + base[t, i]) * step + f
            total = complex64(0)
            for _ in range(width):
                total += symbol[uint32(at)] * x[uint32(of)]
                at, of = at + step, of + step
            out[uint32((c * rows + i) * step + f)] = total
        f = int32(f + cuda.gridsize(1))


@no_type_check
@cuda.jit(cache=True)
def _adjoint(symbol, base, readers, channels, width, frequencies, y, out):
    """out[j] = sum_i conj(A[i, j - base_i]) y[i], over the scanlines [readers_j0, readers_j1) that may see row j."""
    latent_rows, t, j = int32(cuda.gridDim.y), int32(cuda.blockIdx.z), int32(cuda.blockIdx.y)
    rows, width, step = int32(base.shape[1]), int32(width), int32(frequencies)
    f = int32(cuda.grid(1))
    while f < step:
        for c in range(int32(t * channels), int32((t + 1) * channels)):
            total = complex64(0)
            for i in range(readers[t, j, 0], readers[t, j, 1]):
                o = int32(j - base[t, i])
                if 0 <= o < width:
                    a = symbol[uint32(((t * rows + i) * width + o) * step + f)]
                    total += a.conjugate() * y[uint32((c * rows + i) * step + f)]
            out[uint32((c * latent_rows + j) * step + f)] = total
        f = int32(f + cuda.gridsize(1))


@no_type_check
@cuda.jit(cache=True)
def _gram(symbol, base, readers, width, frequencies, band):
    """The upper band of A^H A, (tiles, frequencies, latent rows, width), flat."""
    sums = cuda.local.array(_TOGETHER, complex64)
    latent_rows, t, j = int32(cuda.gridDim.y), int32(cuda.blockIdx.z), int32(cuda.blockIdx.y)
    rows, width, step = int32(base.shape[1]), int32(width), int32(frequencies)
    f = int32(cuda.grid(1))
    while f < step:
        to = ((t * step + f) * latent_rows + j) * width
        for o in range(int32(0), width, _TOGETHER):
            for k in range(_TOGETHER):
                sums[k] = 0
            for i in range(readers[t, j, 0], readers[t, j, 1]):
                p = int32(j - base[t, i])
                if 0 <= p < width - o:
                    at = ((t * rows + i) * width + p) * step + f
                    a = symbol[uint32(at)].conjugate()
                    for k in range(_TOGETHER):
                        if p + o + k < width:
                            sums[k] += a * symbol[uint32(at + (o + k) * step)]
            for k in range(_TOGETHER):
                if o + k < width:
                    band[uint32(to + o + k)] = sums[k]
        f = int32(f + cuda.gridsize(1))


@dataclass(frozen=True, kw_only=True, eq=False)
class RowFourier(Grid):
    """K(theta) of tiles side by side, which share one grid."""

    rows: int
    base: Array  # (tiles, rows): the first latent row that each scanline sees
    readers: Array  # (tiles, latent rows, 2): the first and the last scanline that may see each latent row, the last excluded
    offsets: Array  # (tiles, rows, samples, 2): where scanlines sample the latent image, x and y
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
        channels = latent.shape[1]
        out = xp.empty((self.tiles, channels, self.rows, self.frequencies), xp.complex64)
        how = channels, self.latent_rows, *self.symbol.shape[2:]
        launch(_forward, *self._laid_out(self.rows), self.symbol.reshape(-1), self.base, *how, latent.reshape(-1), out.reshape(-1))
        return out

    def adjoint(self, frame: Array) -> Array:
        """K^H b, spectrum to spectrum."""
        channels = frame.shape[1]
        out = xp.empty((self.tiles, channels, self.latent_rows, self.frequencies), xp.complex64)
        how = self.base, self.readers, channels, *self.symbol.shape[2:]
        launch(_adjoint, *self._laid_out(self.latent_rows), self.symbol.reshape(-1), *how, frame.reshape(-1), out.reshape(-1))
        return out

    def gram(self) -> Array:
        """The upper bands of A^H A, (tiles * frequencies, latent rows, width), as `rsvideo.gpu.banded` stores them."""
        width = self.symbol.shape[2]
        band = xp.empty((self.tiles * self.frequencies, self.latent_rows, width), xp.complex64)
        how = self.base, self.readers, width, self.frequencies
        launch(_gram, *self._laid_out(self.latent_rows), self.symbol.reshape(-1), *how, band.reshape(-1))
        return band

    def _laid_out(self, rows: int) -> tuple[tuple[int, int, int], tuple[int]]:
        return _laid_out(self.frequencies, rows, self.tiles)


def row_fourier(displacement: Float32[np.ndarray, "tiles rows samples 2"], reach: Extent) -> RowFourier:
    """The operator of tiles whose scanline i samples the latent image at offsets `displacement[t, i, k]` (x, y), within `reach`."""
    tiles, rows, samples, _ = displacement.shape
    entries = tiles * max(rows, reach.latent_rows) * reach.width * reach.frequencies
    if entries >= _MOST:
        raise OutOfMemory(8 * entries, 8 * entries)
    symbol = xp.zeros((tiles, rows, reach.width, reach.frequencies), xp.complex64)
    offsets, base = xp.asarray(np.ascontiguousarray(displacement)), xp.asarray(reach.base.astype(np.int32))
    how = reach.top, float(reach.period), samples, reach.width, reach.frequencies
    launch(_symbol, *_laid_out(reach.frequencies, rows, tiles), offsets.reshape(-1), base, *how, symbol.reshape(-1))
    return RowFourier(
        rows=rows,
        top=reach.top,
        latent_rows=reach.latent_rows,
        left=reach.left,
        period=reach.period,
        base=base,
        readers=xp.asarray(_readers(reach.base, reach.width, reach.latent_rows)),
        offsets=offsets,
        symbol=symbol,
    )


def _laid_out(frequencies: int, rows: int, tiles: int) -> tuple[tuple[int, int, int], tuple[int]]:
    """Blocks and threads, one a frequency."""
    threads = min(_THREADS, -(-frequencies // _WARP) * _WARP)
    return (blocks_of(frequencies, threads), rows, tiles), (threads,)


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
