"""Pictures filtered, and sampled at other places, on the device: twins of OpenCV's separable filters and its `remap`.

OpenCV rounds places to 1/32 px; here they are exact. Pictures are (channels, rows, cols), places (2, rows, cols): columns, then rows.
"""

import math
from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Float
from numba import cuda, float32, int32, uint32

from rsvideo.gpu.arrays import Array, blocks_of, launch, ndimage, planes_to_device, planes_to_host, xp

_THREADS = 256  # of a block, each with a pixel
_TAPS = 8  # pixels that a Lanczos sample reads along each side
_BEFORE = 3  # of them up to the one before its place
_ON_A_PIXEL = 1e-5  # px; a place nearer to one counts as so far from it
_EIGHTH_TURN = math.pi / 4
_DERIVATIVE, _ACROSS = (-0.5, 0.0, 0.5), (0.25, 0.5, 0.25)  # Sobel's, for a slope per px


@no_type_check
@cuda.jit(cache=True)
def _along(image, length, step, taps, out):
    """Along one side of an image, whose entries lie `step` apart, sums weighted by `taps`; mirrored about its outermost pixels."""
    size, length, step, count = int32(len(out)), int32(length), int32(step), int32(len(taps))
    half = int32(count // 2)
    n = int32(cuda.grid(1))
    while n < size:
        place = int32(n // step % length)
        begin = int32(n - place * step)
        total = float32(0)
        for k in range(count):
            at = int32(place + k - half) if length > 1 else int32(0)
            while at < 0 or at >= length:
                at = int32(-at) if at < 0 else int32(2 * length - 2 - at)
            total += taps[uint32(k)] * image[uint32(begin + at * step)]
        out[uint32(n)] = total
        n = int32(n + cuda.gridsize(1))


@no_type_check
@cuda.jit(cache=True)
def _places(grid, high, wide, down, across, shift, rows, cols, first, step, width, at):
    """Where pixels of every `step`-th row and column are sampled: their own place, as far off as between the nodes of `grid`, which lie
    `down` rows and `across` columns apart, and by `shift`: constant or across the columns, axis, row."""
    high, wide, down, across, rows, cols = int32(high), int32(wide), int32(down), int32(across), int32(rows), int32(cols)
    size, width = int32(len(at) // 2), int32(width)
    n = int32(cuda.grid(1))
    while n < size:
        row, col = int32(first + n // width * step), int32(first + n % width * step)
        i, j = min(int32(row // down), max(int32(high - 2), int32(0))), min(int32(col // across), max(int32(wide - 2), int32(0)))
        y, x = int32(i * down), int32(j * across)
        a = float32(row - y) / float32(max(min(int32(y + down), int32(rows - 1)) - y, int32(1)))
        b = float32(col - x) / float32(max(min(int32(x + across), int32(cols - 1)) - x, int32(1)))
        side = float32(col) / float32(max(cols - int32(1), int32(1))) - float32(0.5)
        above, below = int32(i * wide), int32(min(int32(i + 1), int32(high - 1)) * wide)
        right = min(int32(j + 1), int32(wide - 1))
        for axis in range(2):
            p, q = grid[uint32(2 * (above + j) + axis)], grid[uint32(2 * (above + right) + axis)]
            r, s = grid[uint32(2 * (below + j) + axis)], grid[uint32(2 * (below + right) + axis)]
            upper, lower = p + b * (q - p), r + b * (s - r)
            moved = shift[uint32(axis * rows + row)] + side * shift[uint32((2 + axis) * rows + row)]
            own = float32(col) if axis == 0 else float32(row)
            at[uint32(axis * size + n)] = own + (upper + a * (lower - upper) + moved)
        n = int32(n + cuda.gridsize(1))


@no_type_check
@cuda.jit(device=True)
def _weigh(share, weights):
    """Lanczos' window of 4 px about a place `share` px behind a pixel: sin(pi d) sin(pi d / 4) / d^2, less what all have alike.

    The angle pi d / 4 turns by 45 degrees from pixel to pixel; its sine and cosine are series, which need no double precision.
    """
    one, half = float32(1), float32(math.sqrt(0.5))
    share = min(max(share, float32(_ON_A_PIXEL)), float32(1 - _ON_A_PIXEL))
    angle = float32(_EIGHTH_TURN) * share
    v = angle * angle
    sine = angle * (one - v * float32(1 / 6) * (one - v * float32(1 / 20) * (one - v * float32(1 / 42))))
    cosine = one - v * float32(1 / 2) * (one - v * float32(1 / 12) * (one - v * float32(1 / 30) * (one - v * float32(1 / 56))))
    sine, cosine = half * (cosine - sine), -half * (cosine + sine)  # of the first pixel, 3 px before
    total = float32(0)
    for k in range(_TAPS):
        d = share + float32(_BEFORE - k)
        weight = sine / (d * d)
        weights[k] = weight if k % 2 else -weight
        total += weights[k]
        sine, cosine = half * (sine - cosine), half * (sine + cosine)
    for k in range(_TAPS):
        weights[k] = weights[k] / total


@no_type_check
@cuda.jit(cache=True)
def _lanczos(image, channels, rows, cols, at, out):
    """Samples of the image, its outermost pixels repeated, within 0 and 1."""
    across = cuda.local.array(_TAPS, float32)
    down = cuda.local.array(_TAPS, float32)
    columns = cuda.local.array(_TAPS, int32)
    size, channels, rows, cols = int32(len(at) // 2), int32(channels), int32(rows), int32(cols)
    n = int32(cuda.grid(1))
    while n < size:
        x = min(max(at[uint32(n)], float32(-_TAPS)), float32(cols + _TAPS))
        y = min(max(at[uint32(size + n)], float32(-_TAPS)), float32(rows + _TAPS))
        left, top = int32(math.floor(x)), int32(math.floor(y))
        _weigh(x - float32(left), across)
        _weigh(y - float32(top), down)
        for k in range(_TAPS):
            columns[k] = min(max(int32(left + k - _BEFORE), int32(0)), int32(cols - 1))
        for c in range(channels):
            total = float32(0)
            for i in range(_TAPS):
                begin = int32((c * rows + min(max(int32(top + i - _BEFORE), int32(0)), int32(rows - 1))) * cols)
                line = float32(0)
                for k in range(_TAPS):
                    line += across[k] * image[uint32(begin + columns[k])]
                total += down[i] * line
            out[uint32(c * size + n)] = min(max(total, float32(0)), float32(1))
        n = int32(n + cuda.gridsize(1))


@no_type_check
@cuda.jit(cache=True)
def _linear(image, channels, rows, cols, at, out):
    """Samples of the image between four pixels, its outermost ones repeated."""
    size, channels, rows, cols = int32(len(at) // 2), int32(channels), int32(rows), int32(cols)
    n = int32(cuda.grid(1))
    while n < size:
        x = min(max(at[uint32(n)], float32(0)), float32(cols - 1))
        y = min(max(at[uint32(size + n)], float32(0)), float32(rows - 1))
        left, top = int32(math.floor(x)), int32(math.floor(y))
        a, b = x - float32(left), y - float32(top)
        right, below = min(int32(left + 1), int32(cols - 1)), min(int32(top + 1), int32(rows - 1))
        for c in range(channels):
            upper, lower = int32((c * rows + top) * cols), int32((c * rows + below) * cols)
            p, q = image[uint32(upper + left)], image[uint32(upper + right)]
            r, s = image[uint32(lower + left)], image[uint32(lower + right)]
            one, other = p + a * (q - p), r + a * (s - r)
            out[uint32(c * size + n)] = one + b * (other - one)
        n = int32(n + cuda.gridsize(1))


def filtered(image: Array, down: Float[np.ndarray, " taps"], across: Float[np.ndarray, " taps"]) -> Array:
    """An image (rows, cols) under a separable filter, mirrored about its outermost pixels."""
    rows, cols = image.shape
    for length, step, taps in ((cols, 1, across), (rows, cols, down)):
        flat, out = xp.ascontiguousarray(image, xp.float32).reshape(-1), xp.empty(image.size, xp.float32)
        weights = xp.asarray(np.ascontiguousarray(taps, np.float32))
        launch(_along, (blocks_of(out.size, _THREADS),), (_THREADS,), flat, length, step, weights, out)
        image = out.reshape(rows, cols)
    return image


def mean(image: Array, window: int) -> Array:
    """Over a window about each pixel, odd."""
    taps = np.full(window, 1 / window)
    return filtered(image, taps, taps)


def blurred(image: Array, sigma: float) -> Array:
    """Under a Gaussian."""
    taps = cv2.getGaussianKernel(round(8 * sigma + 1) | 1, sigma, cv2.CV_32F)[:, 0]
    return filtered(image, taps, taps)


def gradients(image: Array) -> tuple[Array, Array]:
    """Along the columns and along the rows, per px (Sobel)."""
    derivative, across = np.array(_DERIVATIVE), np.array(_ACROSS)
    return filtered(image, across, derivative), filtered(image, derivative, across)


def places(
    drift: Float[np.ndarray, "high wide 2"],
    spacing: tuple[int, int],
    shape: tuple[int, int],
    shift: Float[np.ndarray, "2 2 rows"] | None = None,
    thin: tuple[int, int] = (0, 1),
) -> Array:
    """Where the pixels of an image of that shape are sampled, x and y.

    `drift` is how far from their own place (x, y), at nodes `spacing` rows and columns apart, and at the last ones. Of `shift` the first
    is added to it, and the second times -0.5 to 0.5 from the first column to the last. `thin` is the first row and column, which are left
    out at the end as well, and the step from one to the next.
    """
    rows, cols = shape
    first, step = thin
    height, width = (len(range(first, side - first, step)) for side in shape)
    at = xp.empty((2, height, width), xp.float32)
    grid = xp.asarray(np.ascontiguousarray(drift, np.float32)).reshape(-1)
    moved = xp.zeros(4 * rows, xp.float32) if shift is None else xp.asarray(np.ascontiguousarray(shift, np.float32)).reshape(-1)
    how = *drift.shape[:2], *spacing, moved, rows, cols, first, step, width
    launch(_places, (blocks_of(height * width, _THREADS),), (_THREADS,), grid, *how, at.reshape(-1))
    return at


def lanczos(image: Array, at: Array) -> Array:
    """The picture at these places, its outermost pixels repeated, within 0 and 1."""
    return _sampled(_lanczos, image, at)


def linear(image: Array, at: Array) -> Array:
    """The same, between four pixels, of any values."""
    return _sampled(_linear, image, at)


def straightened(
    pixels: Float[np.ndarray, "rows cols channels"],
    drift: Float[np.ndarray, "high wide 2"] | None,
    spacing: tuple[int, int],
    moved: float,
    latent: tuple[Float[np.ndarray, "rows cols channels"], Float[np.ndarray, "..."] | np.float32, int, float] | None,
) -> Float[np.ndarray, "rows cols channels"]:
    """`moved` of a picture sampled elsewhere, or the picture where there is no `drift`, mixed with a latent image by its share.

    The latent image is `held` so many px from the borders, beside what is as bright as a lamp.
    """
    image = planes_to_device(pixels)
    if drift is not None:
        image = image + xp.float32(moved) * (lanczos(image, places(drift, spacing, pixels.shape[:2])) - image)
    if latent is not None:
        restored, share, reach, lamp = latent
        weight = planes_to_device(share) if isinstance(share, np.ndarray) else share
        image = image + weight * (xp.clip(held(planes_to_device(restored), image, reach, lamp), 0, 1) - image)
    return planes_to_host(image)


def held(latent: Array, straight: Array, reach: int, lamp: float) -> Array:
    """A latent image (channels, rows, cols) which near the borders and a lamp, as bright as that, is nowhere darker than a rectified one
    nearby: the twin of `rsvideo.restoration.rectification.held`."""
    if not reach:
        return latent
    window, latent = (1, 2 * reach + 1, 2 * reach + 1), latent.copy()
    for side in range(4):
        inner, shown = (xp.rot90(image, side, axes=(1, 2))[:, : 2 * reach] for image in (latent, straight))
        extremes = ndimage.minimum_filter, ndimage.maximum_filter
        least, most = (extreme(shown, window, mode="nearest")[:, :reach] for extreme in extremes)
        inner[:, :reach] = xp.where(most >= lamp, xp.maximum(inner[:, :reach], least), inner[:, :reach])
    return latent


def _sampled(kernel: object, image: Array, at: Array) -> Array:
    out = xp.empty((len(image), *at.shape[1:]), xp.float32)
    flat = xp.ascontiguousarray(image, xp.float32).reshape(-1)
    launch(kernel, (blocks_of(at.size // 2, _THREADS),), (_THREADS,), flat, *image.shape, at.reshape(-1), out.reshape(-1))
    return out
