"""Batches of Hermitian positive definite banded systems, one per frequency, as values.

The batch runs along the last axis in lanes of `LANES` systems, real and imaginary parts apart, so that every inner
loop is a contiguous vector operation. A matrix is stored by its upper band: entry (j, o) stands for (j, j + o).
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Complex, Float

from rsvideo.threads import loop, spread

LANES = 16
_FAST = {"nnan", "ninf", "nsz"}  # nothing that moves a rounding: a cached loop would differ there from one that is compiled just now


def blocks(frequencies: int) -> int:
    """How many lanes-wide blocks hold a batch of `frequencies` systems."""
    return -(-frequencies // LANES)


@no_type_check
@loop(fastmath=_FAST)
def _factor(first, last, re, im):
    """In place: upper Cholesky factor R of N = R^H R for every lane. Arrays (blocks, rows, width, LANES)."""
    _, rows, width, _ = re.shape
    for c in range(first, last):
        pr = np.empty(LANES, np.float32)
        pi = np.empty(LANES, np.float32)
        for j in range(rows):
            w = min(width, rows - j)
            for b in range(LANES):
                pr[b] = np.float32(1) / np.sqrt(re[c, j, 0, b])
            for o in range(w):
                for b in range(LANES):
                    re[c, j, o, b] *= pr[b]
                    im[c, j, o, b] *= pr[b]
            for p in range(1, w):
                for b in range(LANES):
                    pr[b] = re[c, j, p, b]
                    pi[b] = im[c, j, p, b]
                for o in range(w - p):
                    for b in range(LANES):
                        xr = re[c, j, p + o, b]
                        xi = im[c, j, p + o, b]
                        re[c, j + p, o, b] -= pr[b] * xr + pi[b] * xi
                        im[c, j + p, o, b] -= pr[b] * xi - pi[b] * xr


@no_type_check
@loop(fastmath=_FAST)
def _solve(first, last, re, im, x):
    """In place: x <- (R^H R)^-1 x; x is (rows, frequencies, 2)."""
    _, rows, width, _ = re.shape
    frequencies = x.shape[1]
    for c in range(first, last):
        yr = np.zeros((rows, LANES), np.float32)
        yi = np.zeros((rows, LANES), np.float32)
        live = min(LANES, frequencies - c * LANES)
        for j in range(rows):
            for b in range(live):
                yr[j, b] = x[j, c * LANES + b, 0]
                yi[j, b] = x[j, c * LANES + b, 1]
        for j in range(rows):  # R^H y = x
            w = min(width, rows - j)
            for b in range(LANES):
                yr[j, b] /= re[c, j, 0, b]
                yi[j, b] /= re[c, j, 0, b]
            for o in range(1, w):
                for b in range(LANES):
                    rr = re[c, j, o, b]
                    ri = im[c, j, o, b]
                    yr[j + o, b] -= rr * yr[j, b] + ri * yi[j, b]
                    yi[j + o, b] -= rr * yi[j, b] - ri * yr[j, b]
        for j in range(rows - 1, -1, -1):  # R x = y
            w = min(width, rows - j)
            for o in range(1, w):
                for b in range(LANES):
                    rr = re[c, j, o, b]
                    ri = im[c, j, o, b]
                    yr[j, b] -= rr * yr[j + o, b] - ri * yi[j + o, b]
                    yi[j, b] -= rr * yi[j + o, b] + ri * yr[j + o, b]
            for b in range(LANES):
                yr[j, b] /= re[c, j, 0, b]
                yi[j, b] /= re[c, j, 0, b]
        for j in range(rows):
            for b in range(live):
                x[j, c * LANES + b, 0] = yr[j, b]
                x[j, c * LANES + b, 1] = yi[j, b]


@dataclass(frozen=True, kw_only=True, eq=False)
class BandedFactor:
    """The Cholesky factors of a batch of banded systems."""

    re: Float[np.ndarray, "blocks rows width lanes"]
    im: Float[np.ndarray, "blocks rows width lanes"]

    def solve(self, rhs: Complex[np.ndarray, "rows frequencies"]) -> Complex[np.ndarray, "rows frequencies"]:
        """N^-1 rhs, one system per frequency."""
        x = rhs.astype(np.complex64, order="C")  # a copy: solved in place
        spread(_solve, len(self.re), self.re, self.im, x.view(np.float32).reshape(*x.shape, 2), size=self.re.nbytes)
        return x


@dataclass(frozen=True, kw_only=True, eq=False)
class BandedHermitian:
    """A batch of Hermitian banded matrices by their upper bands; lanes beyond the batch hold the identity."""

    re: Float[np.ndarray, "blocks rows width lanes"]
    im: Float[np.ndarray, "blocks rows width lanes"]
    frequencies: int

    def plus(self, scale: float, diagonal: Float[np.ndarray, " frequencies"], neighbour: float) -> "BandedHermitian":
        """scale * self + (diagonal(f) I + neighbour * D_y^T D_y), with D_y the forward difference of rows, free at both ends."""
        re, im = scale * self.re, scale * self.im
        lanes = np.ones(re.shape[0] * LANES, np.float32)
        lanes[: self.frequencies] = diagonal
        re[:, :, 0] += lanes.reshape(-1, 1, LANES)
        if neighbour:
            re[:, 1:-1, 0] += 2 * neighbour
            re[:, (0, -1), 0] += neighbour
            re[:, :-1, 1] -= neighbour
        return BandedHermitian(re=re, im=im, frequencies=self.frequencies)

    def factor(self) -> BandedFactor:
        """Cholesky, O(rows * width^2) per frequency."""
        re, im = self.re.astype(np.float32), self.im.astype(np.float32)
        spread(_factor, len(re), re, im)
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
