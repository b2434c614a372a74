"""Batches of Hermitian positive definite banded systems, one per frequency, as values.

The batch runs along the last axis in lanes of `LANES` systems, real and imaginary parts apart, so that every step of a kernel is one of
whole vectors. A matrix is stored by its upper band: entry (j, o) stands for (j, j + o).
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Complex, Float

from rsvideo.lanes import LANES, alike, gathered, load, root, scattered, store
from rsvideo.threads import loop, spread


def blocks(frequencies: int) -> int:
    """How many lanes-wide blocks hold a batch of `frequencies` systems."""
    return -(-frequencies // LANES)


@no_type_check
@loop(fastmath=False)
def _factor(first, last, band_re, band_im, scale, diagonal, neighbour, rows, width, re, im):
    """The upper Cholesky factor R of N = R^H R for every lane, N the scaled band and what is added to it; all arrays are flat.

    Row j of R follows from the rows above that reach it; two of its entries are summed at a time.
    """
    times, one, twice, once = alike(scale), alike(np.float32(1)), alike(np.float32(2) * neighbour), alike(neighbour)
    nothing = alike(np.float32(0))
    for c in range(first, last):
        for j in range(rows):
            row = (c * rows + j) * width * LANES
            pivot = one
            for o in range(0, width, 2):
                at, pair = row + o * LANES, o + 1 < width
                ar, ai = times * load(band_re, at), times * load(band_im, at)
                br, bi = nothing, nothing
                if pair:
                    br, bi = times * load(band_re, at + LANES), times * load(band_im, at + LANES)
                if o == 0:
                    ar = ar + load(diagonal, c * LANES)
                    ar = ar + (once if j == 0 or j == rows - 1 else twice)
                    if j < rows - 1:
                        br = br - once
                for p in range(1, min(j, width - 1 - o) + 1):
                    above = ((c * rows + j - p) * width + p) * LANES
                    pr, pi = load(re, above), load(im, above)
                    xr, xi = load(re, above + o * LANES), load(im, above + o * LANES)
                    ar = ar - pr * xr - pi * xi
                    ai = ai - pr * xi + pi * xr
                    if p + o + 1 < width:
                        xr, xi = load(re, above + (o + 1) * LANES), load(im, above + (o + 1) * LANES)
                        br = br - pr * xr - pi * xi
                        bi = bi - pr * xi + pi * xr
                if o == 0:
                    pivot = one / root(ar)
                    ai = nothing
                store(re, at, ar * pivot)
                store(im, at, ai * pivot)
                if pair:
                    store(re, at + LANES, br * pivot)
                    store(im, at + LANES, bi * pivot)


@no_type_check
@loop(fastmath=False)
def _solve(first, last, re, im, rows, width, frequencies, count, x):
    """In place: x <- (R^H R)^-1 x for so many right-hand sides; x is (count, rows, frequencies, 2), flat as all arrays are."""
    y = np.empty(count * rows * 2 * LANES, np.float32)
    for c in range(first, last):
        gathered(x, count * rows, frequencies, c, y)
        for j in range(rows):  # R^H y = x
            row, reach = (c * rows + j) * width * LANES, min(width, rows - j)
            pivot = alike(np.float32(1)) / load(re, row)
            for s in range(count):
                at = (s * rows + j) * 2 * LANES
                vr, vi = load(y, at) * pivot, load(y, at + LANES) * pivot
                store(y, at, vr)
                store(y, at + LANES, vi)
                for o in range(1, reach):
                    rr, ri = load(re, row + o * LANES), load(im, row + o * LANES)
                    to = at + 2 * o * LANES
                    store(y, to, load(y, to) - rr * vr - ri * vi)
                    store(y, to + LANES, load(y, to + LANES) - rr * vi + ri * vr)
        for j in range(rows - 1, -1, -1):  # R x = y
            row, reach = (c * rows + j) * width * LANES, min(width, rows - j)
            pivot = alike(np.float32(1)) / load(re, row)
            for s in range(count):
                at = (s * rows + j) * 2 * LANES
                vr, vi = load(y, at), load(y, at + LANES)
                for o in range(1, reach):
                    rr, ri = load(re, row + o * LANES), load(im, row + o * LANES)
                    wr, wi = load(y, at + 2 * o * LANES), load(y, at + (2 * o + 1) * LANES)
                    vr = vr - rr * wr + ri * wi
                    vi = vi - rr * wi - ri * wr
                store(y, at, vr * pivot)
                store(y, at + LANES, vi * pivot)
        scattered(y, count * rows, frequencies, c, x)


@dataclass(frozen=True, kw_only=True, eq=False)
class BandedFactor:
    """The Cholesky factors of a batch of banded systems."""

    re: Float[np.ndarray, "blocks rows width lanes"]
    im: Float[np.ndarray, "blocks rows width lanes"]

    def solve(self, rhs: Complex[np.ndarray, "*sides rows frequencies"]) -> Complex[np.ndarray, "*sides rows frequencies"]:
        """N^-1 rhs, one system per frequency, for any number of right-hand sides."""
        x = rhs.astype(np.complex64, order="C")  # a copy: solved in place
        count, rows, width, _ = self.re.shape
        sides = x.size // (rows * x.shape[-1])
        work = (self.re.ravel(), self.im.ravel(), rows, width, x.shape[-1], sides, x.view(np.float32).ravel())
        spread(_solve, count, *work, size=self.re.nbytes)
        return x


@dataclass(frozen=True, kw_only=True, eq=False)
class BandedHermitian:
    """A batch of Hermitian banded matrices by their upper bands."""

    re: Float[np.ndarray, "blocks rows width lanes"]
    im: Float[np.ndarray, "blocks rows width lanes"]
    frequencies: int

    def factor(self, diagonal: Float[np.ndarray, " frequencies"], neighbour: float = 0.0, *, scale: float = 1.0) -> BandedFactor:
        """Cholesky of scale * self + diagonal(f) I + neighbour * D_y^T D_y, with D_y the forward difference of rows, free at both ends.

        It takes O(rows * width^2) per frequency.
        """
        count, rows, width, _ = self.re.shape
        lanes = np.ones(count * LANES, np.float32)
        lanes[: self.frequencies] = diagonal
        re, im = np.empty_like(self.re), np.empty_like(self.im)
        added = (np.float32(scale), lanes, np.float32(neighbour))
        spread(_factor, count, self.re.ravel(), self.im.ravel(), *added, rows, width, re.ravel(), im.ravel())
        return BandedFactor(re=re, im=im)

    def dense(self, frequency: int) -> Complex[np.ndarray, "rows rows"]:
        """One system written out, for tests."""
        block, lane = divmod(frequency, LANES)
        band = self.re[block, :, :, lane] + 1j * self.im[block, :, :, lane]
        rows, width = band.shape
        full = np.zeros((rows, rows), complex)
        for o in range(width):
            j = np.arange(rows - o)
            full[j, j + o] = band[: rows - o, o]
            full[j + o, j] = band[: rows - o, o].conj()
        return full
