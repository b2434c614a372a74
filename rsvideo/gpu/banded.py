"""Batches of Hermitian positive definite banded systems on the device: one block of threads factors and solves one system.

The twin of `rsvideo.solvers.banded`, in another layout: (systems, rows, width) in complex64, entry (j, o) of the upper band stands
for (j, j + o). A factor R of N = R^H R holds 1 / R_jj in place of R_jj.

Factor: a window of `width` rows of the band, those that row j still changes, lies in shared memory; each row is read once and
written once. Where the window is too large, the band itself is worked on. Solve: a few rows of R at a time lie in shared memory,
with the part of x that they meet, for all right-hand sides at once; R is read once forwards and once backwards.
"""

import math
from dataclasses import dataclass
from typing import no_type_check

from numba import complex64, cuda, float32

from rsvideo.gpu.arrays import SHARED_BYTES, Array, launch, xp

_CHUNK = 16  # rows of a factor that are solved with at a time
_WARP = 32  # threads that run in step
_NARROW = 32  # rows and columns of a window, up to which half the threads do
_BYTES = 8  # of a complex64


@no_type_check
@cuda.jit(device=True)
def _entry(band, j, o, rows, width, diagonal, neighbour):
    """(j, j + o) of N + diagonal I + neighbour D_y^T D_y, with D_y the forward difference of rows, free at both ends."""
    value = band[j * width + o]
    if o == 0:
        value = value + (diagonal + neighbour)
        if 0 < j < rows - 1:
            value = value + neighbour
    elif o == 1 and j < rows - 1:
        value = value - neighbour
    return value


@no_type_check
@cuda.jit(device=True)
def _cholesky(band, rows, width, diagonal, neighbour, window, held, row, factor):
    """Each row is scaled, then its outer product leaves those behind it; `window` holds `held` rows in turn, `row` the scaled one."""
    x, y, across, down = cuda.threadIdx.x, cuda.threadIdx.y, cuda.blockDim.x, cuda.blockDim.y
    for j in range(y, min(held, rows), down):
        for o in range(x, width, across):
            window[j * width + o] = _entry(band, j, o, rows, width, diagonal, neighbour)
    cuda.syncthreads()
    slot = 0  # of row j in the window
    for j in range(rows):
        at = slot * width
        scale = float32(1) / math.sqrt(window[at].real)
        for o in range(y * across + x, width, across * down):
            row[o] = window[at + o] * scale if o > 0 else complex64(scale)
        cuda.syncthreads()
        for o in range(y * across + x, width, across * down):
            factor[j * width + o] = row[o]
            if j + held < rows:
                window[at + o] = _entry(band, j + held, o, rows, width, diagonal, neighbour)
        live = min(width, rows - j)
        for p in range(y + 1, live, down):
            target = slot + p if slot + p < held else slot + p - held
            for o in range(x, live - p, across):
                window[target * width + o] -= row[p].conjugate() * row[p + o]
        cuda.syncthreads()
        slot = slot + 1 if slot + 1 < held else 0


@no_type_check
@cuda.jit(cache=True)
def _factor_in_window(band, rows, diagonal, neighbour, factor):
    s, width = cuda.blockIdx.x, band.shape[1] // rows
    shared = cuda.shared.array(0, complex64)
    row, window = shared[:width], shared[width : width + width * width]
    _cholesky(band[s], rows, width, diagonal[s % len(diagonal)], neighbour, window, width, row, factor[s])


@no_type_check
@cuda.jit(cache=True)
def _factor_in_place(band, rows, diagonal, neighbour, factor):
    s, width = cuda.blockIdx.x, band.shape[1] // rows
    row = cuda.shared.array(0, complex64)
    _cholesky(band[s], rows, width, diagonal[s % len(diagonal)], neighbour, factor[s], rows, row, factor[s])


@no_type_check
@cuda.jit(device=True)
def _stage(factor, first, last, width, held):
    """Rows [first, last) of a factor into shared memory, all threads together."""
    threads = cuda.blockDim.x * cuda.blockDim.y
    for n in range(cuda.threadIdx.y * cuda.blockDim.x + cuda.threadIdx.x, (last - first) * width, threads):
        held[n] = factor[first * width + n]


@no_type_check
@cuda.jit(cache=True)
def _solve(factor, rows, chunk, right, x):
    """x = (R^H R)^-1 right, both (batches, sides, rows, frequencies); system = batch * frequencies + frequency."""
    s, t, threads = cuda.blockIdx.x, cuda.threadIdx.x, cuda.blockDim.x
    width, sides, frequencies = factor.shape[1] // rows, right.shape[1], right.shape[3]
    f, R, b, y = s % frequencies, factor[s], right[s // frequencies], x[s // frequencies]
    ring = chunk + width  # rows of x that are at hand, in turn
    shared = cuda.shared.array(0, complex64)
    held, z = shared[: chunk * width], shared[chunk * width : chunk * width + ring * sides]
    for c in range(cuda.threadIdx.y, sides, cuda.blockDim.y):
        for j in range(t, min(width - 1, rows), threads):
            z[c * ring + j] = b[c, j, f]
    for first in range(0, rows, chunk):  # R^H y = b: each row of y leaves those behind it
        last = min(first + chunk, rows)
        _stage(R, first, last, width, held)
        for c in range(cuda.threadIdx.y, sides, cuda.blockDim.y):
            for j in range(first + width - 1 + t, min(last + width - 1, rows), threads):
                z[c * ring + j % ring] = b[c, j, f]
        cuda.syncthreads()
        slot = first % ring  # of row j
        for j in range(first, last):
            at = (j - first) * width
            for c in range(cuda.threadIdx.y, sides, cuda.blockDim.y):
                done = z[c * ring + slot] * held[at].real
                for o in range(t + 1, min(width, rows - j), threads):
                    behind = slot + o if slot + o < ring else slot + o - ring
                    z[c * ring + behind] -= held[at + o].conjugate() * done
            cuda.syncthreads()
            slot = slot + 1 if slot + 1 < ring else 0
        for c in range(cuda.threadIdx.y, sides, cuda.blockDim.y):
            for j in range(first + t, last, threads):
                y[c, j, f] = z[c * ring + j % ring] * held[(j - first) * width].real
        cuda.syncthreads()
    for first in range((rows - 1) // chunk * chunk, -1, -chunk):  # R x = y: first what lies behind the rows at hand, then among them
        last = min(first + chunk, rows)
        _stage(R, first, last, width, held)
        cuda.syncthreads()
        for c in range(cuda.threadIdx.y, sides, cuda.blockDim.y):
            for j in range(first + t, last, threads):
                done, at, slot = y[c, j, f], (j - first) * width, last % ring
                for o in range(last - j, min(width, rows - j)):
                    done -= held[at + o] * z[c * ring + slot]
                    slot = slot + 1 if slot + 1 < ring else 0
                z[c * ring + j % ring] = done
        cuda.syncthreads()
        slot = (last - 1) % ring
        for j in range(last - 1, first - 1, -1):
            for c in range(cuda.threadIdx.y, sides, cuda.blockDim.y):
                done = z[c * ring + slot] * held[(j - first) * width].real
                for o in range(t + 1, min(width, j - first + 1), threads):
                    before = slot - o if slot >= o else slot - o + ring
                    z[c * ring + before] -= held[(j - o - first) * width + o] * done
            cuda.syncthreads()
            slot = slot - 1 if slot > 0 else ring - 1
        for c in range(cuda.threadIdx.y, sides, cuda.blockDim.y):
            for j in range(first + t, last, threads):
                done = z[c * ring + j % ring] * held[(j - first) * width].real
                z[c * ring + j % ring] = done
                y[c, j, f] = done
        cuda.syncthreads()


@dataclass(frozen=True, kw_only=True, eq=False)
class BandedFactor:
    """The Cholesky factors of a batch of banded systems."""

    factor: Array  # (systems, rows * width), complex64
    rows: int

    def solve(self, right: Array) -> Array:
        """N^-1 right of (batches, sides, rows, frequencies), complex64: the systems of each batch, one a frequency, serve all its sides."""
        systems, width = self.factor.shape[0], self.factor.shape[1] // self.rows
        sides = right.shape[1]
        chunk = _CHUNK
        while chunk > 1 and _solve_bytes(chunk, width, sides) > SHARED_BYTES:
            chunk //= 2
        x = xp.empty_like(right)
        shared = _solve_bytes(chunk, width, sides)
        threads = _WARP if width <= _NARROW else 2 * _WARP, sides  # along a row, and for each right-hand side
        launch(_solve, (systems,), threads, self.factor, self.rows, chunk, right, x, shared=shared)
        return x


@dataclass(frozen=True, kw_only=True, eq=False)
class BandedHermitian:
    """A batch of Hermitian banded matrices by their upper bands."""

    band: Array  # (systems, rows, width), complex64

    def factor(self, diagonal: Array, neighbour: float) -> BandedFactor:
        """The factors of N + diagonal(f) I + neighbour D_y^T D_y; the diagonal, float32, serves all batches."""
        systems, rows, width = self.band.shape
        band = self.band.reshape(systems, rows * width)
        factor = xp.empty_like(band)
        within = _BYTES * (width + width * width) <= SHARED_BYTES
        kernel, shared = (_factor_in_window, width + width * width) if within else (_factor_in_place, width)
        threads = _WARP, 4 if width <= _NARROW else 8  # along a row of the window, and down its rows
        launch(kernel, (systems,), threads, band, rows, diagonal, xp.float32(neighbour), factor, shared=_BYTES * shared)
        return BandedFactor(factor=factor, rows=rows)


def _solve_bytes(chunk: int, width: int, sides: int) -> int:
    """Of shared memory, for so many rows of a factor and the part of x that they meet."""
    return _BYTES * (chunk * width + (chunk + width) * sides)
