"""Batches of Hermitian positive definite banded systems on the device: one block of threads factors and solves one system.

The twin of `rsvideo.solvers.banded`, in another layout: (systems, rows, width) in complex64, entry (j, o) of the upper band stands
for (j, j + o). A factor R of N = R^H R holds 1 / R_jj in place of R_jj.

Factor: the rows of R that a row meets lie in shared memory, and a few rows of N that come next; each is read once and written once.
Where they are too many, the factor itself is worked on. Solve: a few rows of R at a time lie in shared memory, with the part of x
that they meet, for all right-hand sides at once; R is read once downwards and once upwards.

A device spends more time on whole numbers than on complex ones where they are 64 bits wide and may be negative. So loops count in
int32, by `while` where their step is the number of threads, for `range` divides by it, and what finds an entry is uint32.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import no_type_check

from numba import complex64, cuda, float32, int32, uint32

from rsvideo.gpu.arrays import SHARED_BYTES, Array, launch, xp

_CHUNK = 32  # rows that are worked on at a time, at most
_FEW = 12 << 10  # bytes of shared memory, so that many systems are worked on side by side; more where the fewest rows need more
_WARP = 32  # threads that run in step
_TOGETHER = 16  # numbers that a thread asks the memory for before it waits for the first
_SIDES = 4  # right-hand sides of which it asks for a row together
_AT_ONCE = 2  # systems of a block, where their rows are short
_BYTES = 8  # of a complex64


@no_type_check
@cuda.jit(device=True)
def _cholesky(band, rows, width, diagonal, neighbour, window, held, chunk, pivot, wanted, factor):
    """Row by row, each less what those before it leave in it; `window` holds `held` rows in turn, of which `chunk` are new at a time.

    Of N + diagonal I + neighbour D_y^T D_y, with D_y the forward difference of rows, free at both ends.
    """
    batch = cuda.local.array(_TOGETHER, complex64)
    t, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    end = int32(held * width)
    mine = int32(0)  # where row j lies in the window
    for first in range(int32(0), rows, chunk):
        last = min(int32(first + chunk), rows)
        count = int32((last - first) * width)
        for begins in range(int32(0), count, int32(_TOGETHER * threads)):
            for k in range(_TOGETHER):
                n = begins + k * threads + t
                if n < count:
                    batch[k] = band[uint32(first * width + n)]
            cuda.syncthreads()  # or the compiler would store each number before it asks for the next ones
            for k in range(_TOGETHER):
                n = begins + k * threads + t
                if n < count:
                    to = mine + n
                    window[uint32(to if to < end else to - end)] = batch[k]
        cuda.syncthreads()
        for j in range(first, last):
            inner = 0 < j < rows - 1
            o = t
            while o < width:
                value = window[uint32(mine + o)]
                re, im = value.real, value.imag
                if o == 0:
                    re = re + diagonal + (neighbour + neighbour if inner else neighbour)
                elif o == 1 and j < rows - 1:
                    re = re - neighbour
                at = mine
                for p in range(int32(1), min(j, int32(width - 1 - o)) + 1):
                    at = int32(at - width) if at > 0 else int32(end - width)
                    a, b = window[uint32(at + p)], window[uint32(at + p + o)]
                    re = re - a.real * b.real - a.imag * b.imag
                    im = im - a.real * b.imag + a.imag * b.real
                window[uint32(mine + o)] = complex64(complex(re, im))
                if o == 0:
                    pivot[0] = re
                o = int32(o + threads)
            cuda.syncthreads()
            scale = float32(1) / math.sqrt(pivot[0])
            o = t
            while o < width:
                value = window[uint32(mine + o)]
                value = complex64(complex(value.real * scale, value.imag * scale)) if o > 0 else complex64(scale)
                window[uint32(mine + o)] = value
                if wanted:
                    factor[uint32(j * width + o)] = value
                o = int32(o + threads)
            cuda.syncthreads()
            mine = int32(mine + width)
            mine = mine if mine < end else int32(0)


@no_type_check
@cuda.jit(device=True)
def _system(systems):
    """Which one the thread works on, and whether its work is wanted: where one is left, half of a block works in vain."""
    s = cuda.blockIdx.x * cuda.blockDim.y + cuda.threadIdx.y
    return min(s, systems - 1), s < systems


@no_type_check
@cuda.jit(cache=True)
def _factor_in_window(band, rows, chunk, diagonal, neighbour, factor):
    s, wanted = _system(band.shape[0])
    width, y = int32(band.shape[1] // rows), cuda.threadIdx.y
    pivots, shared = cuda.shared.array(_AT_ONCE, float32), cuda.shared.array(0, complex64)
    held = int32(width - 1 + chunk)
    window, pivot = shared[y * held * width : (y + 1) * held * width], pivots[y : y + 1]
    own = diagonal[s % len(diagonal)]
    _cholesky(band[s], int32(rows), width, own, neighbour, window, held, int32(chunk), pivot, wanted, factor[s])


@no_type_check
@cuda.jit(cache=True)
def _factor_in_place(band, rows, chunk, diagonal, neighbour, factor):
    s, width = cuda.blockIdx.x, int32(band.shape[1] // rows)
    pivot = cuda.shared.array(1, float32)
    own = diagonal[s % len(diagonal)]
    _cholesky(band[s], int32(rows), width, own, neighbour, factor[s], int32(rows), int32(chunk), pivot, True, factor[s])


@no_type_check
@cuda.jit(device=True)
def _fetch(upwards, right, begin, step, rows, sides, first, last, slot, ring, z):
    """Rows [first, last) of those to come, of all sides, into the ring from `slot` on."""
    batch = cuda.local.array(_SIDES, complex64)
    t, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    row = int32(first + t)
    while row < last:
        at = slot + row - first
        at = int32(at if at < ring else at - ring)
        of = int32(begin + (rows - 1 - row if upwards else row) * step)
        for c in range(int32(0), sides, _SIDES):
            for k in range(_SIDES):
                if c + k < sides:
                    batch[k] = right[uint32(of + (c + k) * rows * step)]
            for k in range(_SIDES):
                if c + k < sides:
                    z[uint32((c + k) * ring + at)] = batch[k]
        row = int32(row + threads)


@no_type_check
@cuda.jit(device=True)
def _hold(upwards, factor, rows, width, first, last, held):
    """What rows [first, last) of those to come leave in those that follow, (last - first, width), of a factor of `rows`."""
    batch = cuda.local.array(_TOGETHER, complex64)
    t, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    down, across = int32(threads // width), int32(threads % width)  # from a thread's entry to its next one
    row, o, count = int32(first + t // width), int32(t % width), int32((last - first) * width)
    for some in range(int32(0), count, int32(_TOGETHER * threads)):
        for k in range(_TOGETHER):
            j = rows - 1 - row - o if upwards else row
            if some + k * threads + t < count and j >= 0:
                batch[k] = factor[uint32(j * width + o)]
            row, o = int32(row + down), int32(o + across)
            row, o = (row, o) if o < width else (int32(row + 1), int32(o - width))
        cuda.syncthreads()  # or the compiler would store each number before it asks for the next ones
        for k in range(_TOGETHER):
            n, value = some + k * threads + t, batch[k]
            if n < count:
                held[uint32(n)] = value if upwards else complex64(complex(value.real, -value.imag))


@no_type_check
@cuda.jit(device=True)
def _substitute(upwards, factor, rows, width, chunk, sides, right, begin, step, held, z, wanted, x):
    """R^H x = right row by row downwards, or R x = right upwards: each row of x leaves those that follow it.

    Row n of those to come is row n of the system, or n from its end. Of side c it lies at begin + (c * rows + row) * step.
    """
    t, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    ring = int32(chunk + width)  # rows of x that are at hand, in turn
    _fetch(upwards, right, begin, step, rows, sides, int32(0), min(int32(width - 1), rows), int32(0), ring, z)
    begins = int32(0)  # where row n = first lies in the ring
    for first in range(int32(0), rows, chunk):
        last = min(int32(first + chunk), rows)
        _hold(upwards, factor, rows, width, first, last, held)
        behind = int32(begins + width - 1)
        behind = behind if behind < ring else int32(behind - ring)
        until = int32(last + width - 1)
        _fetch(upwards, right, begin, step, rows, sides, int32(first + width - 1), min(until, rows), behind, ring, z)
        cuda.syncthreads()
        slot = begins
        for n in range(first, last):
            at, live = int32((n - first) * width), min(width, int32(rows - n))
            scale = held[uint32(at)].real
            o = int32(t + 1)
            while o < live:
                r = held[uint32(at + o)]
                behind = int32(slot + o)
                behind = behind if behind < ring else int32(behind - ring)
                row = int32(0)
                for _ in range(sides):
                    done, value = z[uint32(row + slot)], z[uint32(row + behind)]
                    re, im = done.real * scale, done.imag * scale
                    re, im = value.real - r.real * re + r.imag * im, value.imag - r.real * im - r.imag * re
                    z[uint32(row + behind)] = complex64(complex(re, im))
                    row = int32(row + ring)
                o = int32(o + threads)
            cuda.syncthreads()
            slot = int32(slot + 1)
            slot = slot if slot < ring else int32(0)
        n = int32(first + t)
        while n < last and wanted:
            scale = held[uint32((n - first) * width)].real
            slot = begins + n - first
            slot = slot if slot < ring else slot - ring
            for c in range(sides):
                value = z[uint32(c * ring + slot)]
                to = uint32(begin + (c * rows + (rows - 1 - n if upwards else n)) * step)
                x[to] = complex64(complex(value.real * scale, value.imag * scale))
            n = int32(n + threads)
        cuda.syncthreads()
        begins = int32(begins + chunk)
        begins = begins if begins < ring else int32(begins - ring)


@no_type_check
@cuda.jit(cache=True)
def _solve(factor, rows, chunk, sides, frequencies, right, x):
    """x = (R^H R)^-1 right, both flat (batches, sides, rows, frequencies); system = batch * frequencies + frequency."""
    s, wanted = _system(factor.shape[0])
    width, y = int32(factor.shape[1] // rows), cuda.threadIdx.y
    rows, chunk, sides, step = int32(rows), int32(chunk), int32(sides), int32(frequencies)
    begin = int32(s // step * sides * rows * step + s % step)
    shared = cuda.shared.array(0, complex64)
    each, some = chunk * width + (chunk + width) * sides, chunk * width
    held, z = shared[y * each : y * each + some], shared[y * each + some : (y + 1) * each]
    _substitute(False, factor[s], rows, width, chunk, sides, right, begin, step, held, z, wanted, x)
    _substitute(True, factor[s], rows, width, chunk, sides, x, begin, step, held, z, wanted, x)


@dataclass(frozen=True, kw_only=True, eq=False)
class BandedFactor:
    """The Cholesky factors of a batch of banded systems."""

    factor: Array  # (systems, rows * width), complex64
    rows: int

    def solve(self, right: Array) -> Array:
        """N^-1 right of (batches, sides, rows, frequencies), complex64: the systems of each batch, one a frequency, serve all its sides."""
        systems, width = self.factor.shape[0], self.factor.shape[1] // self.rows
        _, sides, rows, frequencies = right.shape
        blocks, threads = _laid_out(systems, width, most=_WARP)
        chunk, shared = _fitting(lambda chunk: threads[1] * (chunk * width + (chunk + width) * sides))
        x = xp.empty_like(right)
        flat = right.reshape(-1), x.reshape(-1)
        launch(_solve, blocks, threads, self.factor, rows, chunk, sides, frequencies, *flat, shared=shared)
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
        blocks, threads = _laid_out(systems, width, most=4 * _WARP)
        chunk, shared = _fitting(lambda chunk: threads[1] * (width - 1 + chunk) * width)
        how = rows, chunk, diagonal, xp.float32(neighbour), factor
        if shared <= SHARED_BYTES - _BYTES:
            launch(_factor_in_window, blocks, threads, band, *how, shared=shared)
        else:
            launch(_factor_in_place, (systems,), (4 * _WARP,), band, *how)
        return BandedFactor(factor=factor, rows=rows)


def _laid_out(systems: int, width: int, most: int) -> tuple[tuple[int], tuple[int, int]]:
    """Blocks and threads, which share out a row among them; those that run in step work on two systems where a row is short."""
    if width <= _WARP // _AT_ONCE + 1:
        return (-(-systems // _AT_ONCE),), (_WARP // _AT_ONCE, _AT_ONCE)
    return (systems,), (min(most, -(-width // _WARP) * _WARP), 1)


def _fitting(entries: Callable[[int], int]) -> tuple[int, int]:
    """Rows at a time, whose complex entries in shared memory are few, and the bytes of these."""
    chunk = _CHUNK
    while chunk > 1 and _BYTES * entries(chunk) > min(_FEW, SHARED_BYTES):
        chunk //= 2
    return chunk, _BYTES * entries(chunk)
