"""Denoising by groups of similar patches.

The idea is that of Dabov, Foi, Katkovnik and Egiazarian, "Image denoising by sparse 3-D transform-domain collaborative
filtering" (2007): patches that look alike are stacked, the stack is transformed in all three dimensions, small
coefficients are shrunk, and every patch goes back to where it came from, averaged with all others that cover a pixel.

Three things make it fast. Distances are summed for one offset and a whole row of patches at once. The transform along the
columns of a patch needs each pixel's neighbours to the right alone, so it is taken once per pixel, not once per patch, and so
is its inverse, since averaging is linear. And the groups are a value, `Matches`, that several calls can share.

An image is worked on in strips of rows whose number depends on the image alone. Each strip sums into its own array, and the
strips are added in order: threads never meet, and the result does not depend on how many there are.
"""

from dataclasses import dataclass
from itertools import product
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rsvideo.threads import loop, spread

PATCH = 8  # rows and columns of a patch; the transforms below are written out for it
GROUP = 16  # patches of a group, a power of two; fewer where the image has not so many
STRIDE = 4  # px between the reference patches
COLOUR_STRIDE = 2  # times STRIDE between those of a colour difference, which varies slowly; origin: by trial
REACH = 15  # px from a reference patch to the farthest candidate
CLOSE = 4  # px, beyond which candidates lie on every other row and column only; origin: by trial
THRESHOLD = 2.7  # standard deviations below which a coefficient is held to be noise

_AREA = PATCH * PATCH  # a group is flat: group[patch * _AREA + row * PATCH + column]
_STRIP = 12  # rows of reference patches that share one strip
_HALF = np.float32(np.sqrt(0.5))
_C1, _C2, _C3, _C4, _C5, _C6, _C7 = (np.float32(0.5 * np.cos(k * np.pi / 16)) for k in range(1, 8))
DCT = np.float32(0.5) * np.cos(np.pi * np.arange(8)[:, None] * (2 * np.arange(8)[None] + 1) / 16).astype(np.float32)
DCT[0] *= np.float32(np.sqrt(0.5))
OPPONENT = np.array([[1, 1, 1], [1, 0, -1], [1, -2, 1]], np.float32) / np.sqrt(np.array([[3], [2], [6]], np.float32))
_FAR = 3e38  # a distance beyond all others; fast arithmetic has no infinity


@dataclass(frozen=True, kw_only=True, eq=False)
class Matches:
    """Which patches of an image look like which: groups that hold for every channel, and for images that differ little.

    A group is the nearest GROUP patches however far they are: leaving out the unlike ones measures worse.
    """

    shape: tuple[int, int]
    """rows, cols of the image, px"""
    offsets: Int[np.ndarray, "down across group 2"]
    """(rows, cols) from each reference patch to its group, most alike first, itself at the head, px"""


@no_type_check
@njit(cache=True)
def sought(dy, dx):
    """Whether a patch so far away is a candidate: all near ones are, and every other row and column beyond them."""
    return max(abs(dy), abs(dx)) <= CLOSE or (dy % 2 == 0 and dx % 2 == 0)


@no_type_check
@njit(cache=True)
def of_colour(place, count):
    """Whether a colour difference has a reference patch at one of so many places along a side, too."""
    return place % COLOUR_STRIDE == 0 or place == count - 1


@no_type_check
@loop()
def _search(first, last, guide, ys, xs, offsets):
    """The nearest patches of each reference patch, ties in raster order; offsets is zero on entry."""
    rows, cols = guide.shape
    across, count = len(xs), offsets.shape[2]
    for iy in range(first, last):
        y = ys[iy]
        d = np.empty(cols, np.float32)
        best = np.full((across, count), np.float32(_FAR))
        best[:, 0] = -1  # the patch itself, whatever else equals it
        for dy in range(max(-REACH, -y), min(REACH, rows - PATCH - y) + 1):
            z = y + dy
            for dx in range(-REACH, REACH + 1):
                left, right = max(0, -dx), min(cols, cols - dx)
                if right - left < PATCH or (dy == 0 and dx == 0) or not sought(dy, dx):
                    continue
                a0, a1, a2, a3 = guide[y, left:right], guide[y + 1, left:right], guide[y + 2, left:right], guide[y + 3, left:right]
                a4, a5, a6, a7 = guide[y + 4, left:right], guide[y + 5, left:right], guide[y + 6, left:right], guide[y + 7, left:right]
                p, q = left + dx, right + dx
                b0, b1, b2, b3 = guide[z, p:q], guide[z + 1, p:q], guide[z + 2, p:q], guide[z + 3, p:q]
                b4, b5, b6, b7 = guide[z + 4, p:q], guide[z + 5, p:q], guide[z + 6, p:q], guide[z + 7, p:q]
                for i in range(right - left):  # one column of all eight rows
                    upper = (a0[i] - b0[i]) ** 2 + (a1[i] - b1[i]) ** 2 + (a2[i] - b2[i]) ** 2 + (a3[i] - b3[i]) ** 2
                    lower = (a4[i] - b4[i]) ** 2 + (a5[i] - b5[i]) ** 2 + (a6[i] - b6[i]) ** 2 + (a7[i] - b7[i]) ** 2
                    d[left + i] = upper + lower
                for i in range(left, right - 1):  # then two, four and eight columns
                    d[i] += d[i + 1]
                for i in range(left, right - 3):
                    d[i] += d[i + 2]
                for i in range(left, right - 7):
                    d[i] += d[i + 4]
                for ix in range(across):
                    x = xs[ix]
                    if x < left or x > right - PATCH or d[x] >= best[ix, count - 1]:
                        continue
                    k = count - 1
                    while best[ix, k - 1] > d[x]:
                        best[ix, k] = best[ix, k - 1]
                        offsets[iy, ix, k, 0] = offsets[iy, ix, k - 1, 0]
                        offsets[iy, ix, k, 1] = offsets[iy, ix, k - 1, 1]
                        k -= 1
                    best[ix, k] = d[x]
                    offsets[iy, ix, k, 0] = dy
                    offsets[iy, ix, k, 1] = dx


@no_type_check
@njit(cache=True, fastmath=True)
def _columns(channel, top, dct, table):
    """table[y, x] = the transform of the eight pixels to the right of (top + y, x)."""
    for y in range(table.shape[0]):
        for x in range(table.shape[1]):
            t = table[y, x]
            for j in range(PATCH):
                t[j] = 0
            for b in range(PATCH):
                v = channel[top + y, x + b]
                for j in range(PATCH):
                    t[j] += dct[j, b] * v


@no_type_check
@njit(cache=True, fastmath=True)
def _gather(table, offsets, y, x, count, group):
    for k in range(count):
        v, u = y + offsets[k, 0], x + offsets[k, 1]
        for a in range(PATCH):
            row = table[v + a, u]
            o = k * _AREA + a * PATCH
            for j in range(PATCH):
                group[o + j] = row[j]


@no_type_check
@njit(cache=True, fastmath=True)
def _haar(group, count):
    """The Haar transform along the group: sums of its halves in front, differences behind, then the front again."""
    h = count // 2
    while h >= 1:
        for i in range(h * _AREA):
            u, v = group[i], group[i + h * _AREA]
            group[i] = _HALF * (u + v)
            group[i + h * _AREA] = _HALF * (u - v)
        h //= 2


@no_type_check
@njit(cache=True, fastmath=True)
def _haar_back(group, count):
    """The transpose of _haar, which is its inverse."""
    h = 1
    while h < count:
        for i in range(h * _AREA):
            u, v = group[i], group[i + h * _AREA]
            group[i] = _HALF * (u + v)
            group[i + h * _AREA] = _HALF * (u - v)
        h *= 2


@no_type_check
@njit(cache=True, fastmath=True)
def _rows(group, count):
    """The cosine transform along the rows of all patches, its even and odd half apart."""
    for k in range(count):
        for i in range(k * _AREA, k * _AREA + PATCH):
            x0, x1, x2, x3 = group[i], group[i + PATCH], group[i + 2 * PATCH], group[i + 3 * PATCH]
            x4, x5, x6, x7 = group[i + 4 * PATCH], group[i + 5 * PATCH], group[i + 6 * PATCH], group[i + 7 * PATCH]
            s0, s1, s2, s3 = x0 + x7, x1 + x6, x2 + x5, x3 + x4
            d0, d1, d2, d3 = x0 - x7, x1 - x6, x2 - x5, x3 - x4
            group[i] = _C4 * (s0 + s1 + s2 + s3)
            group[i + PATCH] = _C1 * d0 + _C3 * d1 + _C5 * d2 + _C7 * d3
            group[i + 2 * PATCH] = _C2 * (s0 - s3) + _C6 * (s1 - s2)
            group[i + 3 * PATCH] = _C3 * d0 - _C7 * d1 - _C1 * d2 - _C5 * d3
            group[i + 4 * PATCH] = _C4 * (s0 - s1 - s2 + s3)
            group[i + 5 * PATCH] = _C5 * d0 - _C1 * d1 + _C7 * d2 + _C3 * d3
            group[i + 6 * PATCH] = _C6 * (s0 - s3) - _C2 * (s1 - s2)
            group[i + 7 * PATCH] = _C7 * d0 - _C5 * d1 + _C3 * d2 - _C1 * d3


@no_type_check
@njit(cache=True, fastmath=True)
def _rows_back(group, count):
    """The transpose of _rows, which is its inverse."""
    for k in range(count):
        for i in range(k * _AREA, k * _AREA + PATCH):
            y0, y1, y2, y3 = group[i], group[i + PATCH], group[i + 2 * PATCH], group[i + 3 * PATCH]
            y4, y5, y6, y7 = group[i + 4 * PATCH], group[i + 5 * PATCH], group[i + 6 * PATCH], group[i + 7 * PATCH]
            e0, e1 = _C4 * (y0 + y4), _C4 * (y0 - y4)
            e2, e3 = _C2 * y2 + _C6 * y6, _C6 * y2 - _C2 * y6
            s0, s1, s2, s3 = e0 + e2, e1 + e3, e1 - e3, e0 - e2
            d0 = _C1 * y1 + _C3 * y3 + _C5 * y5 + _C7 * y7
            d1 = _C3 * y1 - _C7 * y3 - _C1 * y5 - _C5 * y7
            d2 = _C5 * y1 - _C1 * y3 + _C7 * y5 + _C3 * y7
            d3 = _C7 * y1 - _C5 * y3 + _C3 * y5 - _C1 * y7
            group[i] = s0 + d0
            group[i + PATCH] = s1 + d1
            group[i + 2 * PATCH] = s2 + d2
            group[i + 3 * PATCH] = s3 + d3
            group[i + 4 * PATCH] = s3 - d3
            group[i + 5 * PATCH] = s2 - d2
            group[i + 6 * PATCH] = s1 - d1
            group[i + 7 * PATCH] = s0 - d0


@no_type_check
@njit(cache=True, fastmath=True)
def _threshold(group, count, least):
    """Small coefficients become zero, but for the mean of the group; answers how many are left."""
    mean = group[0]
    kept = np.float32(0)
    for i in range(count * _AREA):
        keep = np.float32(1) if abs(group[i]) > least else np.float32(0)
        kept += keep
        group[i] *= keep
    group[0] = mean
    return max(kept, np.float32(1))


@no_type_check
@njit(cache=True, fastmath=True)
def _wiener(group, pilot, count, variance):
    """Each coefficient times h = p^2 / (p^2 + variance), p the pilot's; answers the sum of h^2."""
    energy = np.float32(0)
    for i in range(count * _AREA):
        power = pilot[i] * pilot[i]
        h = power / (power + variance)
        energy += h * h
        group[i] *= h
    return max(energy, np.float32(1))


@no_type_check
@njit(cache=True, fastmath=True)
def _back(table, weight, dct, total, share):
    """Adds the patches of a strip, still transformed along their columns, and their weights to `total` and `share`."""
    lines, places, _ = table.shape
    across = np.zeros((lines, places + PATCH - 1), np.float32)
    for y in range(lines):
        for x in range(places):
            for j in range(PATCH):
                v = table[y, x, j]
                for b in range(PATCH):
                    total[y, x + b] += v * dct[j, b]
        for b in range(PATCH):
            for x in range(places):
                across[y, x + b] += weight[y, x]
    for y in range(lines - PATCH + 1):
        for a in range(PATCH):
            for x in range(places + PATCH - 1):
                share[y + a, x] += across[y, x]


@no_type_check
@loop()
def _filter(first, last, image, pilot, offsets, ys, xs, sigma, wiener, tops, ends, dct, total, share):
    """Filters every group; total and share are (strips, channels, lines, cols), zero on entry."""
    channels, _, cols = image.shape
    count = offsets.shape[2]
    for s in range(first, last):
        lines = ends[s] - tops[s]
        table = np.empty((lines, cols - PATCH + 1, PATCH), np.float32)
        guess = np.empty((lines if wiener else 0, cols - PATCH + 1, PATCH), np.float32)
        done = np.empty((lines, cols - PATCH + 1, PATCH), np.float32)
        weight = np.empty((lines, cols - PATCH + 1), np.float32)
        g, p = np.empty(GROUP * _AREA, np.float32), np.empty(GROUP * _AREA, np.float32)
        for c in range(channels):
            _columns(image[c], tops[s], dct, table)
            _columns(pilot[c], tops[s], dct, guess)
            done[:] = 0
            weight[:] = 0
            for iy in range(s * _STRIP, min(len(ys), (s + 1) * _STRIP)):
                if c and not of_colour(iy, len(ys)):
                    continue
                for ix in range(len(xs)):
                    if c and not of_colour(ix, len(xs)):
                        continue
                    y, x, to = ys[iy] - tops[s], xs[ix], offsets[iy, ix]
                    _gather(table, to, y, x, count, g)
                    _rows(g, count)
                    _haar(g, count)
                    if wiener:
                        _gather(guess, to, y, x, count, p)
                        _rows(p, count)
                        _haar(p, count)
                        w = np.float32(1) / _wiener(g, p, count, sigma * sigma)
                    else:
                        w = np.float32(1) / _threshold(g, count, np.float32(THRESHOLD) * sigma)
                    _haar_back(g, count)
                    _rows_back(g, count)
                    for k in range(count):
                        v, u = y + to[k, 0], x + to[k, 1]
                        weight[v, u] += w
                        for a in range(PATCH):
                            row = done[v + a, u]
                            o = k * _AREA + a * PATCH
                            for j in range(PATCH):
                                row[j] += w * g[o + j]
            _back(done, weight, dct, total[s, c], share[s, c])


def places(length: int) -> Int[np.ndarray, " places"]:
    """Where reference patches stand along a side: every STRIDE px, and flush with the end."""
    return np.minimum(np.arange(0, length - PATCH + STRIDE, STRIDE), length - PATCH)


def groups_hold(rows: int, cols: int) -> int:
    """How many patches a group of an image has, a power of two: in a corner there are fewest candidates."""
    corner = product(range(min(rows - PATCH, REACH) + 1), range(min(cols - PATCH, REACH) + 1))
    return min(GROUP, 1 << sum(sought(dy, dx) for dy, dx in corner).bit_length() - 1)


def _planes(image: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "channels rows cols"]:
    """Luminance and two colour differences, the noise as large as before; or the one channel there is."""
    rows, cols, channels = image.shape
    if rows < PATCH or cols < PATCH or channels not in (1, 3):
        raise ValueError(f"the image must be at least {PATCH} x {PATCH} px in 1 or 3 channels, got {rows} x {cols} px in {channels}")
    mixed = image.astype(np.float32)
    return np.ascontiguousarray(np.moveaxis(mixed @ OPPONENT.T if channels == 3 else mixed, 2, 0))


def match(guide: Float[np.ndarray, "rows cols channels"]) -> Matches:
    """The groups of an image, found on its luminance."""
    luminance = _planes(guide)[0]
    rows, cols = luminance.shape
    ys, xs = places(rows), places(cols)
    offsets = np.zeros((len(ys), len(xs), groups_hold(rows, cols), 2), np.int8)
    spread(_search, len(ys), luminance, ys, xs, offsets)
    return Matches(shape=(rows, cols), offsets=offsets)


def denoise(
    image: Float[np.ndarray, "rows cols channels"],
    sigma: float,
    *,
    pilot: Float[np.ndarray, "rows cols channels"] | None = None,
    matches: Matches | None = None,
) -> Float[np.ndarray, "rows cols channels"]:
    """The image without white noise of standard deviation `sigma`, float32; 1 or 3 channels, at least 8 x 8 px.

    Alone, small coefficients are dropped. With a `pilot`, an estimate of the result, each is shrunk as Wiener would if
    the pilot were true, which keeps more detail: usually it is called twice, `denoise(image, sigma, pilot=denoise(image,
    sigma))`. Groups are sought on the pilot, else on the image, unless `matches` holds them already.
    """
    rows, cols, channels = image.shape
    if sigma == 0:
        return image.astype(np.float32)
    if matches is None:
        matches = match(image if pilot is None else pilot)
    if matches.shape != (rows, cols):
        raise ValueError(f"the matches must be of an image as large, {rows} x {cols} px; they are of one of {matches.shape} px")
    planes = _planes(image)
    ys, xs = places(rows), places(cols)
    first = np.arange(0, len(ys), _STRIP)
    last = np.minimum(first + _STRIP, len(ys)) - 1
    tops, ends = np.maximum(ys[first] - REACH, 0), np.minimum(ys[last] + REACH + PATCH, rows)
    total = np.zeros((len(tops), channels, int((ends - tops).max()), cols), np.float32)
    share = np.zeros_like(total)
    guess = planes if pilot is None else _planes(pilot)
    how = (np.float32(sigma), pilot is not None)
    spread(_filter, len(tops), planes, guess, matches.offsets, ys, xs, *how, tops, ends, DCT, total, share)
    top_sum, weight_sum = np.zeros_like(planes), np.zeros_like(planes)
    for s, (top, end) in enumerate(zip(tops, ends, strict=True)):
        top_sum[:, top:end] += total[s, :, : end - top]
        weight_sum[:, top:end] += share[s, :, : end - top]
    clean = np.moveaxis(top_sum / weight_sum, 0, 2)
    return np.ascontiguousarray(clean @ OPPONENT if channels == 3 else clean)
