"""Steps of ADMM under total variation on the device, each array read and written once; the twin of `rsvideo.solvers.total_variation`.

Images (..., rows, cols) have periodic columns. A gradient is two images: along columns, the first behind the last, and along rows,
none beyond the last.
"""

from typing import no_type_check

from numba import cuda, int32, uint32

from rsvideo.gpu.arrays import Array, blocks_of, launch, xp

_THREADS = 256  # of a block, each with a pixel


@no_type_check
@cuda.jit(cache=True)
def _split(latent, rows, cols, limit, u, g):
    """v = D l + u;  u = v - j, with j the soft threshold of v;  g = j - u."""
    size, rows, cols = int32(latent.shape[0]), int32(rows), int32(cols)
    n = int32(cuda.grid(1))
    while n < size:
        col, row, value = int32(n % cols), int32(n // cols % rows), latent[uint32(n)]
        beside = latent[uint32(n + 1 if col + 1 < cols else n + 1 - cols)]
        below = latent[uint32(n + cols if row + 1 < rows else n)]
        v = beside - value + u[uint32(n)]
        clipped = min(max(v, -limit), limit)
        u[uint32(n)] = clipped
        g[uint32(n)] = v - clipped - clipped
        v = below - value + u[uint32(size + n)]
        clipped = min(max(v, -limit), limit)
        u[uint32(size + n)] = clipped
        g[uint32(size + n)] = v - clipped - clipped
        n = int32(n + cuda.gridsize(1))


@no_type_check
@cuda.jit(cache=True)
def _join(g, rows, cols, rho, out):
    """rho D^T g."""
    size, rows, cols = int32(out.shape[0]), int32(rows), int32(cols)
    n = int32(cuda.grid(1))
    while n < size:
        col, row = int32(n % cols), int32(n // cols % rows)
        total = g[uint32(n - 1 if col > 0 else n - 1 + cols)] - g[uint32(n)]
        if row > 0:
            total += g[uint32(size + n - cols)]
        if row + 1 < rows:
            total -= g[uint32(size + n)]
        out[uint32(n)] = rho * total
        n = int32(n + cuda.gridsize(1))


@no_type_check
@cuda.jit(cache=True)
def _complete(data, frame, least, blurred, before, ahead, out):
    """The frame where it is data; elsewhere K l and `ahead` times how it differs from `before`, and not below `least`."""
    n = int32(cuda.grid(1))
    while n < len(out):
        value = blurred[uint32(n)]
        value = max(least[uint32(n)], value + ahead * (value - before[uint32(n)]))
        out[uint32(n)] = frame[uint32(n)] if data[uint32(n)] else value
        n = int32(n + cuda.gridsize(1))


def split(latent: Array, limit: float, u: Array, g: Array) -> None:
    """Steps 2 and 3 (Algorithm 2): `u`, the scaled multiplier, is carried on, and `g` becomes what the next latent image's gradient seeks.

    Both are (2, *latent.shape); `limit` is mu / rho.
    """
    how = (*latent.shape[-2:], xp.float32(limit))
    launch(_split, (blocks_of(latent.size, _THREADS),), (_THREADS,), latent.reshape(-1), *how, u.reshape(-1), g.reshape(-1))


def joined(g: Array, rho: float) -> Array:
    """rho D^T g."""
    out = xp.empty(g.shape[1:], xp.float32)
    launch(_join, (blocks_of(out.size, _THREADS),), (_THREADS,), g.reshape(-1), *out.shape[-2:], xp.float32(rho), out.reshape(-1))
    return out


def completed(data: Array, frame: Array, least: Array, blurred: Array, before: Array, ahead: float) -> Array:
    """The frame where it is `data`; elsewhere what blurs to, carried on by `ahead` of its last step, a clipped pixel at `least`."""
    out = xp.empty_like(frame)
    given = (each.reshape(-1) for each in (data, frame, least, blurred, before))
    launch(_complete, (blocks_of(out.size, _THREADS),), (_THREADS,), *given, xp.float32(ahead), out.reshape(-1))
    return out
