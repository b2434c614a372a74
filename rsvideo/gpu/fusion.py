"""Neighbours brought to a frame's pose and averaged with its own latent image, on the device.

The twin of `rsvideo.restoration.fusion`: what is compared, sampled and weighed are pictures; the steps of the alignment are solved there.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Bool, Float
from numba import cuda, float32, int32, uint32

from rsvideo.gpu import resampling
from rsvideo.gpu.arrays import Array, launch, planes_to_device, to_host, xp
from rsvideo.gpu.frame import DeviceFrame

_THREADS = 128  # of a block, along a row; a power of two
_SUMS = 13  # of a row
_SHARED = _SUMS * _THREADS
_NORMAL = np.array([[0, 3, 1, 4], [3, 6, 4, 7], [1, 4, 2, 5], [4, 7, 5, 8]])  # which sum: slopes times slopes
_RIGHT = np.array([9, 11, 10, 12])  # slopes times what is left


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """How two images are compared; `rsvideo.restoration.alignment` says of each what it is."""

    edge: int  # px beside the borders that are not compared
    step: int  # rows and columns from one that is compared to the next
    outlier: float
    least_difference: float


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A latent image that several frames meet."""

    planes: Array  # (channels, rows, cols), linear light
    soft: Array  # (rows, cols), as it is compared


def picture(latent: Float[np.ndarray, "rows cols channels"], lift: float, sigma: float) -> Picture:
    """On the device; `soft` is the root of its lifted grey under a Gaussian of `sigma` px."""
    planes = planes_to_device(latent)
    return Picture(planes=planes, soft=resampling.blurred(xp.sqrt(xp.maximum(_grey(planes), 0) + xp.float32(lift)), sigma))


def _grey(planes: Array) -> Array:
    return planes.mean(axis=0, dtype=xp.float32)


def _expected(power: Array, noise: float, error: float) -> Array:
    return xp.float32(noise**2) + xp.float32(error**2) * power


@no_type_check
@cuda.jit(cache=True)
def _moments(apart, gx, gy, limit, first, step, cols, out):
    """Sums along a row, a block each, of the products of slopes, weighted; with the powers 0 to 2 of the column, from -0.5 to 0.5.

    Of gx^2, gx gy and gy^2 with three powers, and of gx and gy times what is left with two. A pixel that is `limit` apart counts half.
    """
    shared = cuda.shared.array(_SHARED, float32)
    mine = cuda.local.array(_SUMS, float32)
    thread, threads, row = int32(cuda.threadIdx.x), int32(cuda.blockDim.x), int32(cuda.blockIdx.x)
    width = int32(len(apart) // cuda.gridDim.x)
    scale, across = float32(1) / limit[0], float32(1) / float32(max(int32(cols - 1), int32(1)))
    for k in range(_SUMS):
        mine[k] = float32(0)
    j = thread
    while j < width:
        n = uint32(row * width + j)
        left, x, y = apart[n], gx[n], gy[n]
        side = float32(int32(first + j * step)) * across - float32(0.5)
        far = left * scale
        weight = float32(1) / (float32(1) + far * far)
        x_weighted, y_weighted = weight * x, weight * y
        power = float32(1)
        for k in range(3):
            mine[k] += x_weighted * x * power
            mine[3 + k] += x_weighted * y * power
            mine[6 + k] += y_weighted * y * power
            if k < 2:
                mine[9 + k] += x_weighted * left * power
                mine[11 + k] += y_weighted * left * power
            power *= side
        j = int32(j + threads)
    for k in range(_SUMS):
        shared[uint32(k * _THREADS + thread)] = mine[k]
    cuda.syncthreads()
    half = int32(threads // 2)
    while half > 0:
        if thread < half:
            for k in range(_SUMS):
                shared[uint32(k * _THREADS + thread)] += shared[uint32(k * _THREADS + thread + half)]
        cuda.syncthreads()
        half = int32(half // 2)
    k = thread
    while k < _SUMS:
        out[uint32(row * _SUMS + k)] = shared[uint32(k * _THREADS)]
        k = int32(k + threads)


class Neighbour:
    """A latent image beside a frame's own, drifted from it as `drift` says, at nodes `spacing` px apart, and some shift more."""

    def __init__(self, first: Picture, other: Picture, drift: Float[np.ndarray, "high wide 2"], spacing: int, how: Comparison) -> None:
        self.other, self._how = other, how
        self._shape, self._drift, self._spacing = first.soft.shape, drift, (spacing, spacing)
        thin = tuple(slice(how.edge, side - how.edge, how.step) for side in self._shape)
        self._observed = xp.ascontiguousarray(first.soft[thin])
        self._compared = xp.stack([*resampling.gradients(other.soft), other.soft])

    def sums(self, shift: Float[np.ndarray, "2 2 rows"]) -> tuple[Float[np.ndarray, "thin 4 4"], Float[np.ndarray, "thin 4"]]:
        """For every row that is compared, of the slopes in the shift and in its change across the columns, x and y: their products, and
        those with what is left between both images."""
        edge, step = self._how.edge, self._how.step
        gx, gy, sampled = resampling.linear(self._compared, self.at(shift, (edge, step)))
        apart = self._observed - sampled
        limit = self._how.outlier * xp.median(xp.abs(apart)) + self._how.least_difference
        out = xp.empty((len(apart), _SUMS), xp.float32)
        flat = (each.reshape(-1) for each in (apart, gx, gy))
        how = xp.asarray(limit, xp.float32).reshape(1), edge, step, self._shape[1]
        launch(_moments, (len(apart),), (_THREADS,), *flat, *how, out.reshape(-1))
        found = to_host(out)
        return found[:, _NORMAL], found[:, _RIGHT]

    def at(self, shift: Float[np.ndarray, "2 2 rows"], thin: tuple[int, int] = (0, 1)) -> Array:
        """Where the frame's pixels, every few from the first one, are sampled."""
        return resampling.places(self._drift, self._spacing, self._shape, shift, thin)


class Fusion:
    """The mean of a frame's latent image and its neighbours', those by how well they explain the frame in a patch about each pixel."""

    def __init__(
        self,
        frame: DeviceFrame,
        first: Picture,
        weights: Float[np.ndarray, "rows cols"],
        noise: float,
        error: float,
        *,
        patch: int,
        doubt: float,
        margin: int,
    ) -> None:
        """`noise` is the sensor's, and the path may be off by `error` px. `weights` are those of the frame's own pixels; nearer to its
        borders than `margin` a picture shows nothing."""
        self._frame, self._first, self._patch, self._margin = frame, first, patch, margin
        self._observed, self._unclipped = _grey(frame.planes), frame.data.min(axis=0)
        power, own = self._gradient_power(), self._misfit(first.planes, xp.ones(weights.shape, bool))
        self._limit = doubt**2 * (own + _expected(xp.minimum(power, power.mean()), noise, error) / 2)
        self._own, self._usual = own, _expected(power, noise, error)
        self._weights = self._alone = xp.asarray(weights, xp.float32)
        self._total = self._weights * first.planes
        self._explained, self._shown = xp.zeros(weights.shape, xp.float32), xp.zeros(weights.shape, bool)

    def add(self, other: Neighbour, shift: Float[np.ndarray, "2 2 rows"], weight: float) -> None:
        """A neighbour that weighs so much."""
        image, there = self._at_pose(other, shift)
        agreement = there * xp.exp(-self._misfit(image, there) / self._limit)
        self._explained, self._shown = xp.maximum(self._explained, agreement), self._shown | there
        weights = agreement * xp.float32(weight)
        self._total = self._total + weights * image
        self._weights = self._weights + weights

    def latent(self, ridge: float) -> Array:
        """The frame's latent image near the mean."""
        return self._frame.towards(self._total / self._weights, ridge)

    def found(self) -> tuple[Float[np.ndarray, "rows cols"], Bool[np.ndarray, "rows cols"], Float[np.ndarray, "rows cols"]]:
        """How well the best neighbour explains the frame, whether any shows the place, and the weight of all."""
        return to_host(self._explained), to_host(self._shown), to_host(self._weights)

    def unexplained(self, most: float) -> Bool[np.ndarray, "rows cols"]:
        """Where the frame's own image leaves more than so many times what a right one may."""
        return to_host(self._own > xp.float32(most) * self._usual)

    def beside(self, least: float) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Of the grey frame b: b, K t with the mean t of the neighbours alone, t, and where these weigh more than `least` and b is data."""
        beside, own = self._weights - self._alone, _grey(self._first.planes)
        served = beside > xp.float32(least)
        target = xp.where(served, (_grey(self._total) - self._alone * own) / xp.where(served, beside, xp.float32(1)), own)
        served = served & (self._unclipped > 0)
        return to_host(self._observed), to_host(self._frame.blurred(target)), to_host(target), to_host(served)

    def _misfit(self, image: Array, there: Array) -> Array:
        unexplained = self._unclipped * (self._frame.blurred(_grey(image)) - self._observed) ** 2
        shown = xp.where(there, resampling.mean(there.astype(xp.float32), self._patch), xp.float32(1))
        return resampling.mean(there * unexplained, self._patch) / shown

    def _gradient_power(self) -> Array:
        power = xp.zeros_like(self._observed)
        power[:, :-1] += xp.diff(self._observed, axis=1) ** 2
        power[:-1] += xp.diff(self._observed, axis=0) ** 2
        return resampling.mean(power, self._patch)

    def _at_pose(self, other: Neighbour, shift: Float[np.ndarray, "2 2 rows"]) -> tuple[Array, Array]:
        """The neighbour's picture at the frame's pose, and where it shows the place; elsewhere the frame's own."""
        at = other.at(shift)
        rows, cols = at.shape[1:]
        x, y = (at >= self._margin) & (at <= xp.asarray([[[cols]], [[rows]]], xp.float32) - 1 - self._margin)
        there = x & y
        return xp.where(there, resampling.lanczos(other.other.planes, at), self._first.planes), there
