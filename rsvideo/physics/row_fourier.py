"""The blur of a shift trajectory as one banded matrix per horizontal frequency.

All pixels of a scanline see the same path, so along the scanline the blur is a convolution and a Fourier transform
diagonalises it:  b^(i, f) = sum_j A_f(i, j) l^(j, f),  A_f(i, j) = (1/K) sum_k exp(2 pi i f dx_ik) w(j - i - dy_ik),
with w the interpolation weight across rows. A_f is banded: its width is the vertical extent of one scanline's path.
A PSF without a path is the same sum with a weight of its own for each sample instead of 1/K.
Su & Heidrich (Sec. 5.3) hold Fourier methods to be ruled out; for the paper's 2-D model they are exact.
"""

from dataclasses import dataclass, replace
from typing import no_type_check

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float, Int

from rsvideo.physics.warp import TAPS, taps
from rsvideo.threads import loop, spread

_LANES = 16  # frequencies side by side, as in solvers.banded


@no_type_check
@loop()
def _symbol(first, last, dx, share, lowest, weights, period, re, im):
    """A_f(i, base_i + o) in (blocks, rows, width, lanes), real and imaginary."""
    count, samples, n_taps = len(re), dx.shape[1], weights.shape[2]
    zr = np.empty(_LANES, np.float32)
    zi = np.empty(_LANES, np.float32)
    xr = np.empty(_LANES, np.float32)
    xi = np.empty(_LANES, np.float32)
    for i in range(first, last):
        for k in range(samples):
            angle = 2 * np.pi * dx[i, k] / period
            er, ei = np.cos(angle), np.sin(angle)
            wr, wi = share[i, k], 0.0  # share * exp(i angle f), from one frequency to the next
            for b in range(_LANES):
                zr[b], zi[b] = wr, wi
                wr, wi = wr * er - wi * ei, wr * ei + wi * er
            er, ei = np.cos(angle * _LANES), np.sin(angle * _LANES)
            wr, wi = 1.0, 0.0  # and from one block of them to the next
            for c in range(count):
                sr, si = np.float32(wr), np.float32(wi)
                for b in range(_LANES):
                    xr[b] = zr[b] * sr - zi[b] * si
                    xi[b] = zr[b] * si + zi[b] * sr
                for t in range(n_taps):
                    w = weights[i, k, t]
                    to_re, to_im = re[c, i, lowest[i, k] + t], im[c, i, lowest[i, k] + t]
                    for b in range(_LANES):
                        to_re[b] += w * xr[b]
                        to_im[b] += w * xi[b]
                wr, wi = wr * er - wi * ei, wr * ei + wi * er


@no_type_check
@loop()
def _apply(first, last, re, im, base, x, out):
    """out[i] = sum_o A[i, o] x[base_i + o]; x (latent rows, f, 2), out (rows, f, 2)."""
    count, _, width, _ = re.shape
    frequencies = x.shape[1]
    ar = np.empty(_LANES, np.float32)
    ai = np.empty(_LANES, np.float32)
    for i in range(first, last):
        for c in range(count):
            f0 = c * _LANES
            live = min(_LANES, frequencies - f0)
            ar[:] = 0
            ai[:] = 0
            r, m = re[c, i], im[c, i]
            for o in range(width):
                z = x[base[i] + o, f0 : f0 + live]
                for b in range(live):
                    ar[b] += r[o, b] * z[b, 0] - m[o, b] * z[b, 1]
                    ai[b] += r[o, b] * z[b, 1] + m[o, b] * z[b, 0]
            for b in range(live):
                out[i, f0 + b, 0] = ar[b]
                out[i, f0 + b, 1] = ai[b]


@no_type_check
@loop()
def _apply_adjoint(first, last, re, im, base, y, out):
    """out[base_i + o] += conj(A[i, o]) y[i]."""
    _, rows, width, _ = re.shape
    frequencies = y.shape[1]
    for c in range(first, last):
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
@loop()
def _gram(first, last, re, im, base, gr, gi):
    """The upper band of A^H A, (blocks, latent rows, width, lanes)."""
    _, rows, width, _ = re.shape
    r = np.empty((width, _LANES), np.float32)
    m = np.empty((width, _LANES), np.float32)
    for c in range(first, last):
        for i in range(rows):
            for o in range(width):
                for b in range(_LANES):
                    r[o, b], m[o, b] = re[c, i, o, b], im[c, i, o, b]
            for p in range(width):
                to_re, to_im = gr[c, base[i] + p], gi[c, base[i] + p]
                for o in range(width - p):
                    for b in range(_LANES):
                        to_re[o, b] += r[p, b] * r[p + o, b] + m[p, b] * m[p + o, b]
                        to_im[o, b] += r[p, b] * m[p + o, b] - m[p, b] * r[p + o, b]


@dataclass(frozen=True, kw_only=True, eq=False)
class Grid:
    """Where the latent image lies, which is larger than the frame by the blur's extent on every side.

    Latent row `top + i` and column `left + j` lie at frame position (i, j). Columns are periodic with `period`;
    those beyond the frame are unknown and belong to no observation.
    """

    top: int  # latent rows above the frame
    latent_rows: int
    left: int  # latent columns left of the frame
    period: int  # latent columns

    @property
    def frequencies(self) -> int:
        """Of a latent row's spectrum."""
        return self.period // 2 + 1

    @property
    def difference_power(self) -> Float[np.ndarray, " frequencies"]:
        """|d_x(f)|^2 = |1 - exp(2 pi i f)|^2 of the difference between neighbouring columns."""
        return 2 - 2 * np.cos(2 * np.pi * np.arange(self.frequencies) / self.period)

    def crop(self, latent: Float[np.ndarray, "latent_rows period"], rows: int, cols: int) -> Float[np.ndarray, "rows cols"]:
        """The part of a latent image that lies on the pixels of the frame."""
        return latent[self.top : self.top + rows, self.left : self.left + cols]

    def extended(self, image: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "latent_rows period"]:
        """A picture of the frame's size continued from its borders over the latent image's."""
        rows, cols = image.shape
        return np.pad(image, ((self.top, self.latent_rows - self.top - rows), (self.left, self.period - self.left - cols)), mode="edge")


@dataclass(frozen=True, kw_only=True, eq=False)
class RowFourier(Grid):
    """K(theta) for row-dependent shifts."""

    rows: int  # of the frame
    cols: int
    base: Int[np.ndarray, " rows"]  # the first latent row that each scanline sees
    re: Float[np.ndarray, "blocks rows width lanes"]
    im: Float[np.ndarray, "blocks rows width lanes"]

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
        spread(_apply, self.rows, self.re, self.im, self.base, _parts(x), _parts(out), size=self.re.nbytes)
        return out

    def adjoint(self, frame: Complex[np.ndarray, "rows frequencies"]) -> Complex[np.ndarray, "latent_rows frequencies"]:
        """K^H b, spectrum to spectrum."""
        out = np.zeros((self.latent_rows, self.frequencies), np.complex64)
        y = np.ascontiguousarray(frame, np.complex64)
        spread(_apply_adjoint, len(self.re), self.re, self.im, self.base, _parts(y), _parts(out), size=self.re.nbytes)
        return out

    def gram(self) -> tuple[Float[np.ndarray, "blocks latent_rows width lanes"], Float[np.ndarray, "blocks latent_rows width lanes"]]:
        """The upper bands of A^H A, real and imaginary, as solvers.banded stores them."""
        count, _, width, lanes = self.re.shape
        re, im = (np.zeros((count, self.latent_rows, width, lanes), np.float32) for _ in range(2))
        spread(_gram, count, self.re, self.im, self.base, re, im, size=self.re.nbytes)
        return re, im


def _parts(x: np.ndarray) -> np.ndarray:
    return x.view(np.float32).reshape(*x.shape, 2)


@dataclass(frozen=True, kw_only=True, eq=False)
class Extent(Grid):
    """How much of the latent image scanlines see that sample it at given offsets: of one frame, or of tiles that share one grid."""

    width: int  # latent rows that one scanline sees, at most
    base: Int[np.ndarray, "*tiles rows"]  # the first of them
    first: Int[np.ndarray, "*tiles rows samples"]  # the first that each sample reads, from `base` on
    across: Float[np.ndarray, "*tiles rows samples taps"]  # the interpolation weights of those it reads

    @property
    def system_bytes(self) -> int:
        """Of the symbol of one frame or tile, its normal matrix, and the factor of that."""
        return 8 * self.width * self.frequencies * (self.base.shape[-1] + 2 * self.latent_rows)

    def part(self, first: int, last: int) -> "Extent":
        """Of the tiles [first, last), on the grid that all share."""
        some = slice(first, last)
        return replace(self, base=self.base[some], first=self.first[some], across=self.across[some])


def extent(displacement: Float[np.ndarray, "*tiles rows samples 2"], cols: int, margin: int = 2) -> Extent:
    """The extent of frames of `cols` columns whose scanline i samples the latent image at offsets `displacement[..., i, k, :]`."""
    rows = displacement.shape[-3]
    dx, dy = displacement[..., 0], displacement[..., 1]
    index, across = taps(dy)  # rows i + index .. i + index + TAPS - 1
    lowest = np.arange(rows) + index.min(axis=-1)
    width = int((index.max(axis=-1) - index.min(axis=-1)).max()) + TAPS
    top = int(max(0, -lowest.min())) + margin
    left = int(max(0.0, np.ceil(-dx.min()))) + margin
    right = int(max(0.0, np.ceil(dx.max()))) + margin
    period = scipy.fft.next_fast_len(cols + left + right, real=True)
    period += period % 2  # pyright: ignore[reportOperatorIssue]  # scipy's stub says it may be None
    base = (lowest + top).astype(np.int64)
    latent_rows = max(int(base.max()) + width, rows + top) + margin
    first = (index - index.min(axis=-1, keepdims=True)).astype(np.int64)
    return Extent(top=top, latent_rows=latent_rows, left=left, period=period, width=width, base=base, first=first, across=across)


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
    rows, dx = len(displacement), displacement[..., 0]
    share = np.full(dx.shape, 1 / dx.shape[1]) if weights is None else weights
    reach = extent(displacement, cols, margin)
    count = -(-reach.frequencies // _LANES)
    dx, share = (np.ascontiguousarray(each, dtype=float) for each in (dx, share))  # in one order, or each is compiled for
    re, im = (np.zeros((count, rows, reach.width, _LANES), np.float32) for _ in range(2))
    spread(_symbol, rows, dx, share, reach.first, reach.across.astype(np.float32), float(reach.period), re, im)
    return RowFourier(
        rows=rows,
        cols=cols,
        top=reach.top,
        latent_rows=reach.latent_rows,
        left=reach.left,
        period=reach.period,
        base=reach.base,
        re=re,
        im=im,
    )
