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

import cv2
import numpy as np
from jaxtyping import Float, Int
from numba import njit

from rsvideo import lanes
from rsvideo.lanes import LANES, add_halves, alike, alike_halves, load, load_halves, store, store_half, swapped
from rsvideo.threads import loop, spread

PATCH = 8  # rows and columns of a patch; the transforms below are written out for it
GROUP = 16  # patches of a group, a power of two; fewer where the image has not so many
STRIDE = 4  # px between the reference patches
COLOUR_STRIDE = 2  # times STRIDE between those of a colour difference, which varies slowly; origin: by trial
REACH = 15  # px from a reference patch to the farthest candidate
CLOSE = 4  # px, beyond which candidates lie on every other row and column only; origin: by trial
THRESHOLD = 2.7  # standard deviations below which a coefficient is held to be noise

_AREA = PATCH * PATCH  # a group is flat, two patches side by side: group[(pair, row, patch, column)], a row of both in lanes
_STRIP = 12  # rows of reference patches that share one strip
_STRIPS = 8  # that are filtered before their sums are added up
_BLOCK = 24  # reference patches of such a row whose transforms are held at a time: they are to stay in the processor's caches
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

    shape: tuple[int, int]  # rows, cols of the image, px
    offsets: Int[np.ndarray, "down across group 2"]  # px (rows, cols) from each reference patch to its group, itself and the likest first


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
        for ix in range(across):
            best[ix, 0] = -1  # the patch itself, whatever else equals it
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
@njit(cache=True)
def _columns(channel, top, across, table):
    """Flat table[y, x, j]: the transform of the eight pixels to the right of (top + y, x), two x at a time; `across` is DCT, twice."""
    places = channel.shape[1] - PATCH + 1
    for y in range(table.size // (places * PATCH)):
        for x in range(0, places, 2):
            at, beside = x, min(x + 1, places - 1)
            v = alike_halves(channel[top + y, at], channel[top + y, beside])
            t = v * load(across, 0)
            for b in range(1, PATCH):
                t = t + alike_halves(channel[top + y, at + b], channel[top + y, beside + b]) * load(across, b * LANES)
            row = y * places * PATCH
            if beside > at:
                store(table, row + at * PATCH, t)
            else:
                store_half(table, row + at * PATCH, t)


@no_type_check
@njit(cache=True)
def _gather(table, places, offsets, y, x, count, group):
    """A group whose patches are transformed along their rows too, two of them side by side: group[pair, row, lanes], flat."""
    line = places * PATCH
    for k in range(0, count, 2):
        m = min(k + 1, count - 1)
        one = (y + offsets[k, 0]) * line + (x + offsets[k, 1]) * PATCH
        two = (y + offsets[m, 0]) * line + (x + offsets[m, 1]) * PATCH
        x0, x1 = load_halves(table, one, two), load_halves(table, one + line, two + line)
        x2, x3 = load_halves(table, one + 2 * line, two + 2 * line), load_halves(table, one + 3 * line, two + 3 * line)
        x4, x5 = load_halves(table, one + 4 * line, two + 4 * line), load_halves(table, one + 5 * line, two + 5 * line)
        x6, x7 = load_halves(table, one + 6 * line, two + 6 * line), load_halves(table, one + 7 * line, two + 7 * line)
        c1, c2, c3, c4, c5, c6, c7 = alike(_C1), alike(_C2), alike(_C3), alike(_C4), alike(_C5), alike(_C6), alike(_C7)
        s0, s1, s2, s3 = x0 + x7, x1 + x6, x2 + x5, x3 + x4  # the even and the odd half of the cosine transform apart
        d0, d1, d2, d3 = x0 - x7, x1 - x6, x2 - x5, x3 - x4
        to = k * _AREA
        store(group, to, c4 * (s0 + s1 + s2 + s3))
        store(group, to + LANES, c1 * d0 + c3 * d1 + c5 * d2 + c7 * d3)
        store(group, to + 2 * LANES, c2 * (s0 - s3) + c6 * (s1 - s2))
        store(group, to + 3 * LANES, c3 * d0 - c7 * d1 - c1 * d2 - c5 * d3)
        store(group, to + 4 * LANES, c4 * (s0 - s1 - s2 + s3))
        store(group, to + 5 * LANES, c5 * d0 - c1 * d1 + c7 * d2 + c3 * d3)
        store(group, to + 6 * LANES, c6 * (s0 - s3) - c2 * (s1 - s2))
        store(group, to + 7 * LANES, c7 * d0 - c5 * d1 + c3 * d2 - c1 * d3)


@no_type_check
@njit(cache=True)
def _scatter(group, count, offsets, y, x, places, w, table):
    """Adds w times the patches of a group, transformed back along their rows: the transpose of _gather, which is its inverse."""
    line = places * PATCH
    for k in range(0, count, 2):
        m = min(k + 1, count - 1)
        one = (y + offsets[k, 0]) * line + (x + offsets[k, 1]) * PATCH
        two = (y + offsets[m, 0]) * line + (x + offsets[m, 1]) * PATCH
        c1, c2, c3, c4 = alike(w * _C1), alike(w * _C2), alike(w * _C3), alike(w * _C4)
        c5, c6, c7, to = alike(w * _C5), alike(w * _C6), alike(w * _C7), k * _AREA
        y0, y1, y2, y3 = load(group, to), load(group, to + LANES), load(group, to + 2 * LANES), load(group, to + 3 * LANES)
        y4, y5 = load(group, to + 4 * LANES), load(group, to + 5 * LANES)
        y6, y7 = load(group, to + 6 * LANES), load(group, to + 7 * LANES)
        e0, e1, e2, e3 = c4 * (y0 + y4), c4 * (y0 - y4), c2 * y2 + c6 * y6, c6 * y2 - c2 * y6
        s0, s1, s2, s3 = e0 + e2, e1 + e3, e1 - e3, e0 - e2
        d0 = c1 * y1 + c3 * y3 + c5 * y5 + c7 * y7
        d1 = c3 * y1 - c7 * y3 - c1 * y5 - c5 * y7
        d2 = c5 * y1 - c1 * y3 + c7 * y5 + c3 * y7
        d3 = c7 * y1 - c5 * y3 + c3 * y5 - c1 * y7
        add_halves(table, one, two, s0 + d0)
        add_halves(table, one + line, two + line, s1 + d1)
        add_halves(table, one + 2 * line, two + 2 * line, s2 + d2)
        add_halves(table, one + 3 * line, two + 3 * line, s3 + d3)
        add_halves(table, one + 4 * line, two + 4 * line, s3 - d3)
        add_halves(table, one + 5 * line, two + 5 * line, s2 - d2)
        add_halves(table, one + 6 * line, two + 6 * line, s1 - d1)
        add_halves(table, one + 7 * line, two + 7 * line, s0 - d0)


@no_type_check
@njit(cache=True)
def _haar(group, count):
    """The Haar transform along the group: sums of its halves in front, differences behind, then the front again."""
    half, h = alike(_HALF), count // 2
    while h > 1:
        for i in range(0, h * _AREA, LANES):
            u, v = load(group, i), load(group, i + h * _AREA)
            store(group, i, half * (u + v))
            store(group, i + h * _AREA, half * (u - v))
        h //= 2
    if count > 1:
        _first_two(group)


@no_type_check
@njit(cache=True)
def _haar_back(group, count):
    """The transpose of _haar, which is its inverse."""
    half, h = alike(_HALF), 2
    if count > 1:
        _first_two(group)
    while h < count:
        for i in range(0, h * _AREA, LANES):
            u, v = load(group, i), load(group, i + h * _AREA)
            store(group, i, half * (u + v))
            store(group, i + h * _AREA, half * (u - v))
        h *= 2


@no_type_check
@njit(cache=True)
def _first_two(group):
    """The Haar transform of the first two patches, which lie side by side; it is its own inverse."""
    half, sign = alike(_HALF), alike_halves(np.float32(1), np.float32(-1))
    for i in range(0, 2 * _AREA, LANES):
        both = load(group, i)
        store(group, i, half * (swapped(both) + sign * both))


@no_type_check
@njit(cache=True)
def _threshold(group, count, least):
    """Small coefficients become zero, but for the mean of the group; answers how many are left."""
    mean, limit = group[0], alike(least)
    kept = alike(np.float32(0))
    for i in range(0, max(count, 2) * _AREA, LANES):
        value = load(group, i)
        keep = lanes.exceeds(value, limit)
        kept = kept + keep
        store(group, i, keep * value)
    group[0] = mean
    return max(lanes.total(kept), np.float32(1))


@no_type_check
@njit(cache=True)
def _wiener(group, pilot, count, variance):
    """Each coefficient times h = p^2 / (p^2 + variance), p the pilot's; answers the sum of h^2."""
    energy, noise = alike(np.float32(0)), alike(variance)
    for i in range(0, max(count, 2) * _AREA, LANES):
        p = load(pilot, i)
        h = p * p / (p * p + noise)
        energy = energy + h * h
        store(group, i, h * load(group, i))
    return max(lanes.total(energy), np.float32(1))


@no_type_check
@njit(cache=True)
def _back(table, places, weight, back, summed, share, left, width):
    """Adds the patches of a strip, still transformed along their columns, and their weights, to flat sums; `back` is DCT, twice."""
    lines, cols = weight.shape[0], places + PATCH - 1
    across = np.zeros((lines, cols), np.float32)
    for y in range(lines):
        for x in range(0, places, 2):
            at, beside = x, min(x + 1, places - 1)
            one, two = (y * places + at) * PATCH, (y * places + beside) * PATCH
            twice = np.float32(1 if beside > at else 0)
            v = alike_halves(table[one], twice * table[two]) * load(back, 0)
            for j in range(1, PATCH):
                v = v + alike_halves(table[one + j], twice * table[two + j]) * load(back, j * LANES)
            add_halves(summed, y * width + left + at, y * width + left + beside, v)
        for b in range(PATCH):
            for x in range(places):
                across[y, x + b] += weight[y, x]
    for y in range(lines - PATCH + 1):
        for a in range(PATCH):
            for x in range(cols):
                share[(y + a) * width + left + x] += across[y, x]


@no_type_check
@loop()
def _filter(first, last, image, pilot, offsets, ys, xs, sigma, wiener, row, tops, ends, across, back, summed, share):
    """Filters every group of the strips from reference row `row` on; summed and share are (strips, channels, lines, cols), zero before."""
    channels, _, cols = image.shape
    count = offsets.shape[2]
    g, p = np.empty((2, max(count, 2) * _AREA), np.float32)
    for s in range(first, last):
        lines = ends[s] - tops[s]
        blocks = -(-len(xs) // _BLOCK)
        for k in range(channels * blocks):
            c, begin = k // blocks, k % blocks * _BLOCK
            end = min(begin + _BLOCK, len(xs))
            left, right = max(xs[begin] - REACH, 0), min(xs[end - 1] + REACH + PATCH, cols)
            places = right - left - PATCH + 1
            table, done = np.empty(lines * places * PATCH, np.float32), np.zeros(lines * places * PATCH, np.float32)
            guess = np.empty(lines * places * PATCH if wiener else 0, np.float32)
            weight = np.zeros((lines, places), np.float32)
            _columns(image[c, :, left:right], tops[s], across, table)
            _columns(pilot[c, :, left:right], tops[s], across, guess)
            for iy in range(row + s * _STRIP, min(len(ys), row + (s + 1) * _STRIP)):
                if c and not of_colour(iy, len(ys)):
                    continue
                for ix in range(begin, end):
                    if c and not of_colour(ix, len(xs)):
                        continue
                    y, x, to = ys[iy] - tops[s], xs[ix] - left, offsets[iy, ix]
                    _gather(table, places, to, y, x, count, g)
                    _haar(g, count)
                    if wiener:
                        _gather(guess, places, to, y, x, count, p)
                        _haar(p, count)
                        w = np.float32(1) / _wiener(g, p, count, sigma * sigma)
                    else:
                        w = np.float32(1) / _threshold(g, count, np.float32(THRESHOLD) * sigma)
                    _haar_back(g, count)
                    _scatter(g, count, to, y, x, places, w if count > 1 else np.float32(0.5) * w, done)  # a lone patch is its own pair
                    for m in range(count):
                        weight[y + to[m, 0], x + to[m, 1]] += w
            _back(done, places, weight, back, summed[s, c].reshape(-1), share[s, c].reshape(-1), left, cols)


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
    pixels = np.ascontiguousarray(image, np.float32)
    return np.stack(cv2.split(cv2.transform(pixels, OPPONENT))) if channels == 3 else pixels.reshape(1, rows, cols)


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
    guess = planes if pilot is None or pilot is image else _planes(pilot)
    how = (np.float32(sigma), pilot is not None)
    across, back = (np.ascontiguousarray(np.concatenate([half, half], axis=1), np.float32).ravel() for half in (DCT.T, DCT))
    top_sum, weight_sum = np.zeros_like(planes), np.zeros_like(planes)
    for begin in range(0, len(tops), _STRIPS):  # each has sums of its own, so that threads need not wait for one another
        top, end = tops[begin : begin + _STRIPS], ends[begin : begin + _STRIPS]
        summed, share = np.zeros((2, len(top), channels, int((end - top).max()), cols), np.float32)
        spread(_filter, len(top), planes, guess, matches.offsets, ys, xs, *how, begin * _STRIP, top, end, across, back, summed, share)
        for s, lines in enumerate(map(slice, top, end)):
            top_sum[:, lines] += summed[s, :, : end[s] - top[s]]
            weight_sum[:, lines] += share[s, :, : end[s] - top[s]]
    top_sum /= weight_sum
    return cv2.transform(cv2.merge([*top_sum]), OPPONENT.T) if channels == 3 else top_sum.reshape(image.shape)
