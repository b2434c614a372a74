"""Denoising by groups of similar patches on the device: one block of threads a reference patch.

The twin of `rsvideo.solvers.collaborative_filter`, of images (channels, rows, cols). A block keeps a patch's surroundings, or a group,
in shared memory. Groups overlap, and what they add to a pixel comes in no order; sums are kept as whole numbers, which do not depend
on it.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from numba import cuda, float32, int32, int64

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
_SURROUNDINGS, _CANDIDATES, _STACK = _LOOKED_AT**2, (2 * REACH + 1) ** 2, GROUP * _AREA  # sizes of arrays in shared memory
_FAR = 3e38
_sought, _of_colour = (cuda.jit(device=True)(rule.py_func) for rule in (sought, of_colour))
_HALF = float(np.sqrt(0.5))
_ONE = float(1 << 40)  # a weight of 1; the sums of one pixel stay below 2^23 of it


@no_type_check
@cuda.jit(cache=True)
def _search(guide, ys, xs, offsets):
    """The nearest patches of each reference patch, ties in raster order; the patch itself, at the head, is there on entry."""
    near = cuda.shared.array(_SURROUNDINGS, float32)
    distance = cuda.shared.array(_CANDIDATES, float32)
    least = cuda.shared.array(_MATCH_THREADS, float32)
    place = cuda.shared.array(_MATCH_THREADS, int32)
    t, threads = cuda.threadIdx.x, cuda.blockDim.x
    iy, ix = cuda.blockIdx.y, cuda.blockIdx.x
    y, x = ys[iy], xs[ix]
    top, left = max(0, y - REACH), max(0, x - REACH)
    down, across = min(guide.shape[0] - PATCH, y + REACH) - top + 1, min(guide.shape[1] - PATCH, x + REACH) - left + 1
    for v in range(t // 32, down + PATCH - 1, max(1, threads // 32)):
        for u in range(t % 32, across + PATCH - 1, min(32, threads)):
            near[v * _LOOKED_AT + u] = guide[top + v, left + u]
    cuda.syncthreads()
    for n in range(t, down * across, threads):
        v, u = n // across, n % across
        dy, dx = top + v - y, left + u - x
        if (dy == 0 and dx == 0) or not _sought(dy, dx):
            distance[n] = float32(_FAR)
            continue
        total = float32(0)
        for a in range(PATCH):
            for b in range(PATCH):
                d = near[(v + a) * _LOOKED_AT + u + b] - near[(y - top + a) * _LOOKED_AT + x - left + b]
                total += d * d
        distance[n] = total
    for k in range(1, offsets.shape[2]):
        best, at = float32(_FAR), int32(0)
        for n in range(t, down * across, threads):
            if distance[n] < best:
                best, at = distance[n], int32(n)
        least[t], place[t] = best, at
        cuda.syncthreads()
        half = threads // 2
        while half > 0:
            if t < half and (least[t + half] < least[t] or (least[t + half] == least[t] and place[t + half] < place[t])):
                least[t], place[t] = least[t + half], place[t + half]
            cuda.syncthreads()
            half //= 2
        n = place[0]
        if n % threads == t:  # whose candidate it was
            distance[n] = float32(_FAR)
            offsets[iy, ix, k, 0] = n // across + top - y
            offsets[iy, ix, k, 1] = n % across + left - x
        cuda.syncthreads()


@no_type_check
@cuda.jit(device=True)
def _gather(plane, to, y, x, count, group):
    for n in range(cuda.threadIdx.x, count * _AREA, cuda.blockDim.x):
        k, a, b = n // _AREA, n % _AREA // PATCH, n % PATCH
        group[n] = plane[y + to[k, 0] + a, x + to[k, 1] + b]
    cuda.syncthreads()


@no_type_check
@cuda.jit(device=True)
def _cosine(group, count, dct, back):
    """The cosine transform of all patches along both sides, or its transpose, which is its inverse."""
    line = cuda.local.array(PATCH, float32)
    for side in range(2):
        step = 1 if side == 0 else PATCH
        for n in range(cuda.threadIdx.x, count * PATCH, cuda.blockDim.x):
            start = n * PATCH if side == 0 else n // PATCH * _AREA + n % PATCH
            for b in range(PATCH):
                line[b] = group[start + b * step]
            for j in range(PATCH):
                total = float32(0)
                for b in range(PATCH):
                    total += (dct[b, j] if back else dct[j, b]) * line[b]
                group[start + j * step] = total
        cuda.syncthreads()


@no_type_check
@cuda.jit(device=True)
def _haar(group, count):
    """The Haar transform along the group; each thread has coefficients of its own."""
    for i in range(cuda.threadIdx.x, _AREA, cuda.blockDim.x):
        h = count // 2
        while h >= 1:
            for k in range(h):
                u, v = group[k * _AREA + i], group[(k + h) * _AREA + i]
                group[k * _AREA + i] = float32(_HALF) * (u + v)
                group[(k + h) * _AREA + i] = float32(_HALF) * (u - v)
            h //= 2


@no_type_check
@cuda.jit(device=True)
def _haar_back(group, count):
    """The transpose of _haar, which is its inverse."""
    for i in range(cuda.threadIdx.x, _AREA, cuda.blockDim.x):
        h = 1
        while h < count:
            for k in range(h):
                u, v = group[k * _AREA + i], group[(k + h) * _AREA + i]
                group[k * _AREA + i] = float32(_HALF) * (u + v)
                group[(k + h) * _AREA + i] = float32(_HALF) * (u - v)
            h *= 2
    cuda.syncthreads()


@no_type_check
@cuda.jit(device=True)
def _shrink(group, pilot, count, sigma, wiener, sums):
    """Small coefficients become zero, but for the mean of the group; or each is shrunk as Wiener would. Answers the group's weight."""
    t, threads = cuda.threadIdx.x, cuda.blockDim.x
    least, variance = float32(THRESHOLD) * sigma, sigma * sigma
    energy = float32(0)
    for i in range(t, _AREA, threads):
        for n in range(i, count * _AREA, _AREA):
            if wiener:
                power = pilot[n] * pilot[n]
                h = power / (power + variance)
            else:
                h = float32(1) if abs(group[n]) > least else float32(0)
            energy += h * h
            if wiener or n > 0:
                group[n] *= h
    sums[t] = energy
    cuda.syncthreads()
    total = float32(0)
    for i in range(threads):
        total += sums[i]
    return float32(1) / max(total, float32(1))


@no_type_check
@cuda.jit(cache=True)
def _filter(image, pilot, offsets, ys, xs, dct, sigma, wiener, total, weight):
    """Filters every group; adds its patches to `total`, and its weight to `weight` where its patches begin."""
    group = cuda.shared.array(_STACK, float32)
    guess = cuda.shared.array(_STACK, float32)
    sums = cuda.shared.array(_FILTER_THREADS, float32)
    y, x, to = ys[cuda.blockIdx.y], xs[cuda.blockIdx.x], offsets[cuda.blockIdx.y, cuda.blockIdx.x]
    count = offsets.shape[2]
    coloured = _of_colour(cuda.blockIdx.y, len(ys)) and _of_colour(cuda.blockIdx.x, len(xs))
    for c in range(image.shape[0] if coloured else 1):
        _gather(image[c], to, y, x, count, group)
        _cosine(group, count, dct, False)
        _haar(group, count)
        if wiener:
            _gather(pilot[c], to, y, x, count, guess)
            _cosine(guess, count, dct, False)
            _haar(guess, count)
        w = _shrink(group, guess, count, sigma, wiener, sums)
        _haar_back(group, count)
        _cosine(group, count, dct, True)
        for n in range(cuda.threadIdx.x, count * _AREA, cuda.blockDim.x):
            k, a, b = n // _AREA, n % _AREA // PATCH, n % PATCH
            v, u = y + to[k, 0], x + to[k, 1]
            cuda.atomic.add(total, (c, v + a, u + b), int64(w * group[n] * float32(_ONE)))
            if n % _AREA == 0:
                cuda.atomic.add(weight, (c, v, u), int64(w * float32(_ONE)))
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
    launch(_search, (len(xs), len(ys)), (_MATCH_THREADS,), luminance, ys, xs, offsets)
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
    how = matches.offsets, ys, xs, xp.asarray(DCT), xp.float32(sigma), pilot is not None
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
