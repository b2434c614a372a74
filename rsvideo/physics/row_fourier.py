"""The blur of a shift trajectory as one banded matrix per horizontal frequency.

All pixels of a scanline see the same path, so along the scanline the blur is a convolution and a Fourier transform
diagonalises it:  b^(i, f) = sum_j A_f(i, j) l^(j, f),  A_f(i, j) = (1/K) sum_k exp(2 pi i f dx_ik) w(j - i - dy_ik),
with w the interpolation weight across rows. A_f is banded: its width is the vertical extent of one scanline's path.
A PSF without a path is the same sum with a weight of its own for each sample instead of 1/K.
Su & Heidrich (Sec. 5.3) hold Fourier methods to be ruled out; for the paper's 2-D model they are exact.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float, Int
from numba import njit, prange

from rsvideo.physics.warp import TAPS, taps

_LANES = 16  # frequencies side by side, as in solvers.banded


@no_type_check
@njit(cache=True, fastmath=True, parallel=True)
def _symbol(dx, share, first, weights, width, period, count):
    """A_f(i, base_i + o) in (blocks, rows, width, lanes), real and imaginary."""
    rows, samples = dx.shape
    re = np.zeros((count, rows, width, _LANES), np.float32)
    im = np.zeros((count, rows, width, _LANES), np.float32)
    for i in prange(rows):
        zr = np.empty(_LANES, np.float32)
        zi = np.empty(_LANES, np.float32)
        for k in range(samples):
            angle = 2 * np.pi * dx[i, k] / period
            for b in range(_LANES):
                zr[b] = np.cos(angle * b) * share[i, k]
                zi[b] = np.sin(angle * b) * share[i, k]
            for c in range(count):
                sr = np.float32(np.cos(angle * c * _LANES))
                si = np.float32(np.sin(angle * c * _LANES))
                for t in range(weights.shape[2]):
                    o = first[i, k] + t
                    w = weights[i, k, t]
                    for b in range(_LANES):
                        re[c, i, o, b] += w * (zr[b] * sr - zi[b] * si)
                        im[c, i, o, b] += w * (zr[b] * si + zi[b] * sr)
    return re, im


@no_type_check
@njit(cache=True, fastmath=True, parallel=True)
def _apply(re, im, base, x, out):
    """out[i] = sum_o A[i, o] x[base_i + o]; x (latent rows, f, 2), out (rows, f, 2)."""
    count, rows, width, _ = re.shape
    frequencies = x.shape[1]
    for i in prange(rows):
        for c in range(count):
            live = min(_LANES, frequencies - c * _LANES)
            f0 = c * _LANES
            ar = np.zeros(_LANES, np.float32)
            ai = np.zeros(_LANES, np.float32)
            for o in range(width):
                j = base[i] + o
                for b in range(live):
                    xr = x[j, f0 + b, 0]
                    xi = x[j, f0 + b, 1]
                    ar[b] += re[c, i, o, b] * xr - im[c, i, o, b] * xi
                    ai[b] += re[c, i, o, b] * xi + im[c, i, o, b] * xr
            for b in range(live):
                out[i, f0 + b, 0] = ar[b]
                out[i, f0 + b, 1] = ai[b]


@no_type_check
@njit(cache=True, fastmath=True, parallel=True)
def _apply_adjoint(re, im, base, y, out):
    """out[base_i + o] += conj(A[i, o]) y[i]."""
    count, rows, width, _ = re.shape
    frequencies = y.shape[1]
    for c in prange(count):
        live = min(_LANES, frequencies - c * _LANES)
        f0 = c * _LANES
        yr = np.empty(_LANES, np.float32)
        yi = np.empty(_LANES, np.float32)
        for i in range(rows):
            for b in range(live):
                yr[b] = y[i, f0 + b, 0]
                yi[b] = y[i, f0 + b, 1]
            for o in range(width):
                j = base[i] + o
                for b in range(live):
                    out[j, f0 + b, 0] += re[c, i, o, b] * yr[b] + im[c, i, o, b] * yi[b]
                    out[j, f0 + b, 1] += re[c, i, o, b] * yi[b] - im[c, i, o, b] * yr[b]


@no_type_check
@njit(cache=True, fastmath=True, parallel=True)
def _gram(re, im, base, latent_rows):
    """The upper band of A^H A, (blocks, latent rows, width, lanes)."""
    count, rows, width, _ = re.shape
    gr = np.zeros((count, latent_rows, width, _LANES), np.float32)
    gi = np.zeros((count, latent_rows, width, _LANES), np.float32)
    for c in prange(count):
        pr = np.empty(_LANES, np.float32)
        pi = np.empty(_LANES, np.float32)
        for i in range(rows):
            for p in range(width):
                j = base[i] + p
                for b in range(_LANES):
                    pr[b] = re[c, i, p, b]
                    pi[b] = im[c, i, p, b]
                for o in range(width - p):
                    for b in range(_LANES):
                        xr = re[c, i, p + o, b]
                        xi = im[c, i, p + o, b]
                        gr[c, j, o, b] += pr[b] * xr + pi[b] * xi
                        gi[c, j, o, b] += pr[b] * xi - pi[b] * xr
    return gr, gi


@dataclass(frozen=True, kw_only=True, eq=False)
class RowFourier:
    """K(theta) for row-dependent shifts; the latent image is larger than the frame by the blur's extent on every side.

    Latent row `top + i` and column `left + j` lie at frame position (i, j). Columns are periodic with `period`;
    those beyond the frame are unknown and belong to no observation.
    """

    rows: int  # of the frame
    cols: int
    top: int  # latent rows above the frame
    latent_rows: int
    left: int  # latent columns left of the frame
    period: int  # latent columns
    base: Int[np.ndarray, " rows"]  # the first latent row that each scanline sees
    re: Float[np.ndarray, "blocks rows width lanes"]
    im: Float[np.ndarray, "blocks rows width lanes"]

    @property
    def frequencies(self) -> int:
        return self.period // 2 + 1

    @property
    def difference_power(self) -> Float[np.ndarray, " frequencies"]:
        """|d_x(f)|^2 = |1 - exp(2 pi i f)|^2 of the difference between neighbouring columns."""
        return 2 - 2 * np.cos(2 * np.pi * np.arange(self.frequencies) / self.period)

    def spectrum(self, image: Float[np.ndarray, "n period"]) -> Complex[np.ndarray, "n frequencies"]:
        """The Fourier transform along rows."""
        return np.asarray(scipy.fft.rfft(image, axis=1))

    def image(self, spectrum: Complex[np.ndarray, "n frequencies"]) -> Float[np.ndarray, "n period"]:
        """The inverse of `spectrum`."""
        return np.asarray(scipy.fft.irfft(spectrum, n=self.period, axis=1))

    def forward(self, latent: Complex[np.ndarray, "latent_rows frequencies"]) -> Complex[np.ndarray, "rows frequencies"]:
        """K l, spectrum to spectrum."""
        out = np.empty((self.rows, self.frequencies), np.complex64)
        x = np.ascontiguousarray(latent, np.complex64)
        _apply(self.re, self.im, self.base, _parts(x), _parts(out))
        return out

    def adjoint(self, frame: Complex[np.ndarray, "rows frequencies"]) -> Complex[np.ndarray, "latent_rows frequencies"]:
        """K^H b, spectrum to spectrum."""
        out = np.zeros((self.latent_rows, self.frequencies), np.complex64)
        y = np.ascontiguousarray(frame, np.complex64)
        _apply_adjoint(self.re, self.im, self.base, _parts(y), _parts(out))
        return out

    def gram(self) -> tuple[Float[np.ndarray, "blocks latent_rows width lanes"], Float[np.ndarray, "blocks latent_rows width lanes"]]:
        """The upper bands of A^H A, real and imaginary, as solvers.banded stores them."""
        return _gram(self.re, self.im, self.base, self.latent_rows)


def _parts(x: np.ndarray) -> np.ndarray:
    return x.view(np.float32).reshape(*x.shape, 2)


def row_fourier(
    displacement: Float[np.ndarray, "rows samples 2"],
    cols: int,
    *,
    weights: Float[np.ndarray, "rows samples"] | None = None,
    margin: int = 2,
) -> RowFourier:
    """The operator of a frame of `cols` columns whose scanline i samples the latent image at offsets `displacement[i, k]` (x, y).

    `weights` are the parts of the scanline's light that the samples send, all the same by default; they sum to 1 a scanline.
    """
    rows = len(displacement)
    dx, dy = displacement[..., 0], displacement[..., 1]
    share = np.full(dx.shape, 1 / dx.shape[1]) if weights is None else weights
    index, across = taps(dy)  # rows i + index .. i + index + TAPS - 1
    lowest = np.arange(rows) + index.min(axis=1)
    width = int((index.max(axis=1) - index.min(axis=1)).max()) + TAPS
    top = int(max(0, -lowest.min())) + margin
    left = int(max(0.0, np.ceil(-dx.min()))) + margin
    right = int(max(0.0, np.ceil(dx.max()))) + margin
    period = scipy.fft.next_fast_len(cols + left + right, real=True)
    period += period % 2  # pyright: ignore[reportOperatorIssue]  # scipy's stub says it may be None
    base = (lowest + top).astype(np.int64)
    count = -(-(period // 2 + 1) // _LANES)
    first = (index - index.min(axis=1, keepdims=True)).astype(np.int64)
    dx, share = (np.ascontiguousarray(each, dtype=float) for each in (dx, share))  # in one order, or each is compiled for
    re, im = _symbol(dx, share, first, across.astype(np.float32), width, float(period), count)
    latent_rows = max(int(base.max()) + width, rows + top) + margin
    return RowFourier(rows=rows, cols=cols, top=top, latent_rows=latent_rows, left=left, period=period, base=base, re=re, im=im)
