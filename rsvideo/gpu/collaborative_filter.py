"""Denoising by groups of similar patches on the device: one block of threads a reference patch.

The twin of `rsvideo.solvers.collaborative_filter`, of images (channels, rows, cols). A block keeps a patch's surroundings, or a group,
in shared memory. Groups overlap, and what they add to a pixel comes in no order; sums are kept as whole numbers, which do not depend
on it.
"""

from dataclasses import dataclass
from itertools import product
from typing import no_type_check

import numpy as np
from numba import cuda, float32, int32, int64, uint32

from rsvideo.gpu.arrays import Array, launch, xp
from rsvideo.solvers.collaborative_filter import (
    DCT,
    GROUP,
    OPPONENT,
    PATCH,
    REACH,
    THRESHOLD,
    groups_hold,
    of_colour,
    places,
    sought,
)

_MATCH_THREADS = 128  # of a block; a power of two
_FILTER_THREADS = 64  # a divisor of a patch's area: each thread has coefficients of its own in all patches of a group
_AREA = PATCH * PATCH
_LOOKED_AT = 2 * REACH + PATCH  # px a side that a reference patch is compared with
_OFFSETS = [
    each for each in product(range(-REACH, REACH + 1), repeat=2) if any(each) and sought.py_func(*each)
]  # of candidates, in raster order
_SURROUNDINGS, _CANDIDATES, _STACK = _LOOKED_AT**2, len(_OFFSETS), GROUP * _AREA  # sizes of arrays in shared memory
_FAR = 3e38
_of_colour = cuda.jit(device=True)(of_colour.py_func)
_HALF = float(np.sqrt(0.5))
_ONE = float(1 << 40)  # a weight of 1; the sums of one pixel stay below 2^23 of it


@no_type_check
@cuda.jit(cache=True)
def _search(guide, ys, xs, candidates, offsets):
    """The nearest patches of each reference patch, ties in raster order; the patch itself, at the head, is there on entry."""
    near = cuda.shared.array(_SURROUNDINGS, float32)
    distance = cuda.shared.array(_CANDIDATES, float32)
    least = cuda.shared.array(_MATCH_THREADS, float32)
    place = cuda.shared.array(_MATCH_THREADS, int32)
    t, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    iy, ix = cuda.blockIdx.y, cuda.blockIdx.x
    rows, cols, y, x = int32(guide.shape[0]), int32(guide.shape[1]), ys[iy], xs[ix]
    n = t
    while n < _SURROUNDINGS:
        v = min(max(y - REACH + n // _LOOKED_AT, 0), rows - 1)  # beyond the image its borders, which no candidate is compared with
        u = min(max(x - REACH + n % _LOOKED_AT, 0), cols - 1)
        near[uint32(n)] = guide[uint32(v), uint32(u)]
        n = int32(n + threads)
    cuda.syncthreads()
    own = int32(REACH * _LOOKED_AT + REACH)
    n = t
    while n < _CANDIDATES:
        dy, dx = int32(candidates[uint32(2 * n)]), int32(candidates[uint32(2 * n + 1)])
        total = float32(_FAR)
        if 0 <= y + dy <= rows - PATCH and 0 <= x + dx <= cols - PATCH:
            there = int32(own + dy * _LOOKED_AT + dx)
            total = float32(0)
            for a in range(PATCH):
                for b in range(PATCH):
                    d = near[uint32(there + a * _LOOKED_AT + b)] - near[uint32(own + a * _LOOKED_AT + b)]
                    total += d * d
        distance[uint32(n)] = total
        n = int32(n + threads)
    for k in range(1, offsets.shape[2]):
        best, at = float32(_FAR), int32(0)
        n = t
        while n < _CANDIDATES:
            if distance[uint32(n)] < best:
                best, at = distance[uint32(n)], n
            n = int32(n + threads)
        least[t], place[t] = best, at
        cuda.syncthreads()
        half = int32(threads // 2)
        while half > 0:
            if t < half:
                other, where = least[uint32(t + half)], place[uint32(t + half)]
                if other < best or (other == best and where < at):
                    best, at = other, where
                    least[t], place[t] = best, at
            cuda.syncthreads()
            half //= 2
        n = place[0]
        if n % threads == t:  # whose candidate it was
            distance[uint32(n)] = float32(_FAR)
            offsets[iy, ix, k, 0] = candidates[uint32(2 * n)]
            offsets[iy, ix, k, 1] = candidates[uint32(2 * n + 1)]
        cuda.syncthreads()


@no_type_check
@cuda.jit(device=True)
def _gather(plane, to, y, x, count, group):
    n, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    while n < count * _AREA:
        k, a, b = n // _AREA, n % _AREA // PATCH, n % PATCH
        group[uint32(n)] = plane[uint32(y + to[uint32(k), 0] + a), uint32(x + to[uint32(k), 1] + b)]
        n = int32(n + threads)
    cuda.syncthreads()


@no_type_check
@cuda.jit(device=True)
def _cosine(group, count, back):
    """The cosine transform of all patches along both sides, or its transpose, which is its inverse."""
    line = cuda.local.array(PATCH, float32)
    for side in range(2):
        step = int32(1 if side == 0 else PATCH)
        n, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
        while n < count * PATCH:
            start = int32(n * PATCH if side == 0 else n // PATCH * _AREA + n % PATCH)
            for b in range(PATCH):
                line[b] = group[uint32(start + b * step)]
            for j in range(PATCH):
                total = float32(0)
                for b in range(PATCH):
                    total += (DCT[b, j] if back else DCT[j, b]) * line[b]
                group[uint32(start + j * step)] = total
            n = int32(n + threads)
        cuda.syncthreads()


@no_type_check
@cuda.jit(device=True)
def _haar(group, count):
    """The Haar transform along the group; each thread has coefficients of its own."""
    i, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    while i < _AREA:
        h = int32(count // 2)
        while h >= 1:
            for k in range(h):
                u, v = group[uint32(k * _AREA + i)], group[uint32((k + h) * _AREA + i)]
                group[uint32(k * _AREA + i)] = float32(_HALF) * (u + v)
                group[uint32((k + h) * _AREA + i)] = float32(_HALF) * (u - v)
            h = int32(h // 2)
        i = int32(i + threads)


@no_type_check
@cuda.jit(device=True)
def _haar_back(group, count):
    """The transpose of _haar, which is its inverse."""
    i, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    while i < _AREA:
        h = int32(1)
        while h < count:
            for k in range(h):
                u, v = group[uint32(k * _AREA + i)], group[uint32((k + h) * _AREA + i)]
                group[uint32(k * _AREA + i)] = float32(_HALF) * (u + v)
                group[uint32((k + h) * _AREA + i)] = float32(_HALF) * (u - v)
            h = int32(h * 2)
        i = int32(i + threads)
    cuda.syncthreads()


@no_type_check
@cuda.jit(device=True)
def _shrink(group, pilot, count, sigma, wiener, sums):
    """Small coefficients become zero, but for the mean of the group; or each is shrunk as Wiener would. Answers the group's weight."""
    t, threads = int32(cuda.threadIdx.x), int32(cuda.blockDim.x)
    least, variance = float32(THRESHOLD) * sigma, sigma * sigma
    energy = float32(0)
    n = t  # threads are a divisor of a patch's area: each goes on with coefficients of its own
    while n < count * _AREA:
        value = group[uint32(n)]
        if wiener:
            power = pilot[uint32(n)] * pilot[uint32(n)]
            h = power / (power + variance)
        else:
            h = float32(1) if abs(value) > least else float32(0)
        energy += h * h
        if wiener or n > 0:
            group[uint32(n)] = value * h
        n = int32(n + threads)
    sums[t] = energy
    cuda.syncthreads()
    total = float32(0)
    for i in range(threads):
        total += sums[i]
    return float32(1) / max(total, float32(1))


@no_type_check
@cuda.jit(cache=True)
def _filter(image, pilot, offsets, ys, xs, sigma, wiener, total, weight):
    """Filters every group; adds its patches to `total`, and its weight to `weight` where its patches begin."""
    group = cuda.shared.array(_STACK, float32)
    guess = cuda.shared.array(_STACK, float32)
    sums = cuda.shared.array(_FILTER_THREADS, float32)
    y, x, to = ys[cuda.blockIdx.y], xs[cuda.blockIdx.x], offsets[cuda.blockIdx.y, cuda.blockIdx.x]
    count, threads = int32(offsets.shape[2]), int32(cuda.blockDim.x)
    coloured = _of_colour(cuda.blockIdx.y, len(ys)) and _of_colour(cuda.blockIdx.x, len(xs))
    for c in range(image.shape[0] if coloured else 1):
        _gather(image[c], to, y, x, count, group)
        _cosine(group, count, False)
        _haar(group, count)
        if wiener:
            _gather(pilot[c], to, y, x, count, guess)
            _cosine(guess, count, False)
            _haar(guess, count)
        w = _shrink(group, guess, count, sigma, wiener, sums)
        _haar_back(group, count)
        _cosine(group, count, True)
        n = int32(cuda.threadIdx.x)
        while n < count * _AREA:
            k, a, b = n // _AREA, n % _AREA // PATCH, n % PATCH
            v, u = y + to[uint32(k), 0], x + to[uint32(k), 1]
            cuda.atomic.add(total, (uint32(c), uint32(v + a), uint32(u + b)), int64(w * group[uint32(n)] * float32(_ONE)))
            if n % _AREA == 0:
                cuda.atomic.add(weight, (uint32(c), uint32(v), uint32(u)), int64(w * float32(_ONE)))
            n = int32(n + threads)
        cuda.syncthreads()


@dataclass(frozen=True, kw_only=True, eq=False)
class Matches:
    """Which patches of an image look like which."""

    offsets: Array  # (down, across, group, 2): rows and columns from each reference patch to its group, most alike first, px


def match(guide: Array) -> Matches:
    """The groups of an image (channels, rows, cols), found on its luminance."""
    luminance = _planes(guide)[0]
    rows, cols = luminance.shape
    ys, xs = _places(rows), _places(cols)
    offsets = xp.zeros((len(ys), len(xs), groups_hold(rows, cols), 2), xp.int8)
    candidates = xp.asarray(np.array(_OFFSETS, np.int8).ravel())
    launch(_search, (len(xs), len(ys)), (_MATCH_THREADS,), luminance, ys, xs, candidates, offsets)
    return Matches(offsets=offsets)


def denoise(image: Array, sigma: float, *, pilot: Array | None = None, matches: Matches | None = None) -> Array:
    """The image (1 or 3 channels, rows, cols), float32, without white noise of standard deviation `sigma`."""
    if sigma == 0:
        return image.astype(xp.float32)
    if matches is None:
        matches = match(image if pilot is None else pilot)
    planes = _planes(image)
    guess = planes if pilot is None else _planes(pilot)
    ys, xs = _places(planes.shape[1]), _places(planes.shape[2])
    total, weight = xp.zeros(planes.shape, xp.int64), xp.zeros(planes.shape, xp.int64)
    how = matches.offsets, ys, xs, xp.float32(sigma), pilot is not None
    launch(_filter, (len(xs), len(ys)), (_FILTER_THREADS,), planes, guess, *how, total, weight)
    clean = (total / _covered(weight)).astype(xp.float32)
    return xp.tensordot(xp.asarray(OPPONENT.T), clean, axes=1) if len(clean) == 3 else clean


def _covered(weight: Array) -> Array:
    """The sum over each pixel of the weights of the patches that cover it, given where they begin."""
    for axis in (1, 2):
        length = weight.shape[axis]
        sums = xp.cumsum(xp.pad(weight, [(PATCH, 0) if side == axis else (0, 0) for side in range(3)]), axis=axis)
        weight = xp.take(sums, xp.arange(PATCH, PATCH + length), axis=axis) - xp.take(sums, xp.arange(length), axis=axis)
    return weight


def _planes(image: Array) -> Array:
    """Luminance and two colour differences, the noise as large as before; or the one channel there is."""
    mixed = image.astype(xp.float32)
    return xp.ascontiguousarray(xp.tensordot(xp.asarray(OPPONENT), mixed, axes=1) if len(mixed) == 3 else mixed)


def _places(length: int) -> Array:
    return xp.asarray(places(length).astype(np.int32))
