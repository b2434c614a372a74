"""The latent image as a function of the trajectory, and the derivative through it, of all tiles of a scene at once.

The twin of what `rsvideo.restoration.sparsity` solves: l = M^-1 K^H b with M = K^H K + rho D^T D, and for a measure f(l) of it, with
m = M^-1 f'(l) and r = b - K l, the change <dK m, r> - <K m, dK l> with each path sample's displacement.
"""

import math
from collections.abc import Sequence
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Float32
from numba import cuda, float32, int32, uint32

from rsvideo.gpu.arrays import Array, blocks_of, launch, to_host, xp
from rsvideo.gpu.frame import System
from rsvideo.physics.row_fourier import extent

_THREADS = 128  # of a block, along the columns; a power of two


@no_type_check
@cuda.jit(cache=True)
def _sensitivity(m, mx, latent, lx, residual, km, offsets, widths, top, left, out):
    """<dK m, r> - <K m, dK l> for a unit displacement of each path sample, by linear interpolation; a block a sample."""
    across = cuda.shared.array(_THREADS, float32)
    down = cuda.shared.array(_THREADS, float32)  # on a line of its own: the simulator tells arrays apart by their lines
    thread, threads = cuda.threadIdx.x, cuda.blockDim.x
    t, i, k = cuda.blockIdx.z, cuda.blockIdx.y, cuda.blockIdx.x
    whole_x, whole_y = math.floor(offsets[t, i, k, 0]), math.floor(offsets[t, i, k, 1])
    ax, ay = float32(offsets[t, i, k, 0] - whole_x), float32(offsets[t, i, k, 1] - whole_y)
    bx, by = float32(1) - ax, float32(1) - ay
    y = i + top + int(whole_y)
    sx, sy = float32(0), float32(0)
    for j in range(thread, widths[t], threads):
        x = left + int(whole_x) + j
        r, q = residual[t, 0, i, left + j], km[t, 0, i, left + j]
        dm = by * (bx * mx[t, 0, y, x] + ax * mx[t, 0, y, x + 1]) + ay * (bx * mx[t, 0, y + 1, x] + ax * mx[t, 0, y + 1, x + 1])
        dl = by * (bx * lx[t, 0, y, x] + ax * lx[t, 0, y, x + 1]) + ay * (bx * lx[t, 0, y + 1, x] + ax * lx[t, 0, y + 1, x + 1])
        sx += dm * r - dl * q
        dm = bx * (m[t, 0, y + 1, x] - m[t, 0, y, x]) + ax * (m[t, 0, y + 1, x + 1] - m[t, 0, y, x + 1])
        dl = bx * (latent[t, 0, y + 1, x] - latent[t, 0, y, x]) + ax * (latent[t, 0, y + 1, x + 1] - latent[t, 0, y, x + 1])
        sy += dm * r - dl * q
    across[thread], down[thread] = sx, sy
    cuda.syncthreads()
    half = threads // 2
    while half > 0:
        if thread < half:
            across[thread] += across[thread + half]
            down[thread] += down[thread + half]
        cuda.syncthreads()
        half //= 2
    if thread == 0:
        samples = float32(offsets.shape[2])
        out[t, i, k, 0] = across[0] / samples
        out[t, i, k, 1] = down[0] / samples


@no_type_check
@cuda.jit(cache=True)
def _means(image, length, step, half, share, out):
    """Along one side of an image, whose entries lie `step` apart, `share` times the sum of those up to `half` away."""
    length, step, half = int32(length), int32(step), int32(half)
    n = int32(cuda.grid(1))
    while n < len(out):
        place = int32(n // step % length)
        total = float32(0)
        for k in range(-min(half, place), min(half, length - 1 - place) + 1):
            total += image[uint32(n + k * step)]
        out[uint32(n)] = total * share
        n = int32(n + cuda.gridsize(1))


class Eliminated:
    """The latent images of tiles (rows, cols), each with the blur of its `offsets`."""

    def __init__(
        self,
        offsets: Float32[np.ndarray, "tiles rows samples 2"],
        frames: list[Float[np.ndarray, "rows cols"]],
        valid: list[Float[np.ndarray, "rows cols"]],
        *,
        ridge: float,
        floor: float,
        completions: int,
    ) -> None:
        reach = extent(offsets, max(frame.shape[1] for frame in frames))
        self._system = System.of(offsets, reach, [frame[None] for frame in frames], [v[None] > 0 for v in valid])
        op, self.widths = self._system.op, self._system.widths
        self._factor = self._system.factor(ridge, floor)
        self._data = self._system.completed()
        self._latent = self._factor.solve(op.adjoint(op.spectrum(self._data)))
        self._blurred = op.image(op.forward(self._latent))
        for _ in range(completions - 1):
            self._data = self._system.complete(self._blurred)
            self._latent = self._factor.solve(op.adjoint(op.spectrum(self._data)))
            self._blurred = op.image(op.forward(self._latent))
        self._whole = op.image(self._latent)
        self._slope = xp.zeros_like(self._whole)  # f'(l)
        columns, rows = slice(op.left, op.left + max(self.widths)), slice(op.top, op.top + op.rows)
        self.frames = self._system.frame[:, 0, :, columns]
        self.images, self.slopes = self._whole[:, 0, rows, columns], self._slope[:, 0, rows, columns]

    def derivative(self) -> Float[np.ndarray, "tiles rows samples 2"]:
        """Of f in every path sample's displacement, where `slopes` holds f'(l)."""
        op = self._system.op
        m = self._factor.solve(op.spectrum(self._slope))
        along = xp.asarray((2j * np.pi / op.period * np.arange(op.frequencies)).astype(np.complex64))
        images = op.image(m), op.image(m * along), self._whole, op.image(self._latent * along)
        out = xp.empty(op.offsets.shape, xp.float32)
        tiles, rows, samples, _ = op.offsets.shape
        launch(
            _sensitivity,
            (samples, rows, tiles),
            (_THREADS,),
            *images,
            self._data - self._blurred,
            op.image(op.forward(m)),
            op.offsets,
            xp.asarray(np.array(self.widths, np.int32)),
            op.top,
            op.left,
            out,
        )
        return to_host(out)


def box(images: Array, window: int) -> Array:
    """The mean over a window, odd, about each pixel of (..., rows, cols); 0 beyond each image."""
    shape = images.shape
    for length, step in ((shape[-2], shape[-1]), (shape[-1], 1)):
        flat, means = xp.ascontiguousarray(images, xp.float32).reshape(-1), xp.empty(images.size, xp.float32)
        how = length, step, window // 2, xp.float32(1 / window)
        launch(_means, (blocks_of(images.size, _THREADS),), (_THREADS,), flat, *how, means)
        images = means.reshape(shape)
    return images


def inside(widths: Sequence[int], rows: int, cols: int) -> Array:
    """1 within so many columns of each image, (images, rows, cols), 0 beyond."""
    of_columns = np.arange(cols) < np.array(widths)[:, None]
    return xp.repeat(xp.asarray(of_columns[:, None].astype(np.float32)), rows, axis=1)
