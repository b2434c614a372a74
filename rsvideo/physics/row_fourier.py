"""The blur of a shift trajectory as one banded matrix per horizontal frequency.

All pixels of a scanline see the same path, so along the scanline the blur is a convolution and a Fourier transform
diagonalises it:  b^(i, f) = sum_j A_f(i, j) l^(j, f),  A_f(i, j) = (1/K) sum_k exp(2 pi i f dx_ik) w(j - i - dy_ik),
with w the interpolation weight across rows. A_f is banded: its width is the vertical extent of one scanline's path.
A PSF without a path is the same sum with a weight of its own for each sample instead of 1/K.
Su & Heidrich (Sec. 5.3) hold Fourier methods to be ruled out; for the paper's 2-D model they are exact.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import no_type_check

import numpy as np
import scipy.fft
from jaxtyping import Complex, Float, Int

from rsvideo.lanes import LANES, alike, gathered, load, scattered, store
from rsvideo.physics.warp import TAPS, taps
from rsvideo.threads import loop, spread

_DOUBLINGS = LANES.bit_length() - 1  # of an angle: as far as a block of frequencies leads


@no_type_check
@loop(fastmath=False)
def _symbol(first, last, dx, share, lowest, weights, period, rows, width, count, re, im):
    """A_f(i, base_i + o) in flat (blocks, rows, width, lanes), real and imaginary; zero on entry."""
    samples = dx.shape[1]
    z = np.empty(samples * 2 * LANES, np.float32)  # share * exp(i angle f) of each sample, of the frequencies of one block
    step = np.empty((samples, 2), np.float32)  # and what leads to the next block
    for i in range(first, last):
        for k in range(samples):
            angle = 2 * np.pi * dx[i, k] / period
            er, ei = np.cos(angle), np.sin(angle)
            wr, wi = share[i, k], 0.0
            for b in range(LANES):
                z[2 * k * LANES + b], z[(2 * k + 1) * LANES + b] = wr, wi
                wr, wi = wr * er - wi * ei, wr * ei + wi * er
            for _ in range(_DOUBLINGS):
                er, ei = er * er - ei * ei, 2 * er * ei
            step[k, 0], step[k, 1] = er, ei
        for c in range(count):
            for k in range(samples):
                zr, zi = load(z, 2 * k * LANES), load(z, (2 * k + 1) * LANES)
                for t in range(weights.shape[2]):
                    to, w = ((c * rows + i) * width + lowest[i, k] + t) * LANES, alike(weights[i, k, t])
                    store(re, to, load(re, to) + w * zr)
                    store(im, to, load(im, to) + w * zi)
                sr, si = alike(step[k, 0]), alike(step[k, 1])
                store(z, 2 * k * LANES, zr * sr - zi * si)
                store(z, (2 * k + 1) * LANES, zr * si + zi * sr)


@no_type_check
@loop(fastmath=False)
def _apply(first, last, re, im, base, width, frequencies, count, latent_rows, x, out):
    """out[i] = sum_o A[i, o] x[base_i + o]; x (count, latent rows, f, 2), out (count, rows, f, 2), both flat."""
    rows = len(base)
    y = np.empty(count * latent_rows * 2 * LANES, np.float32)
    done = np.empty(count * rows * 2 * LANES, np.float32)
    for c in range(first, last):
        gathered(x, count * latent_rows, frequencies, c, y)
        for i in range(rows):
            row = (c * rows + i) * width * LANES
            for s in range(count):
                at, to = (s * latent_rows + base[i]) * 2 * LANES, (s * rows + i) * 2 * LANES
                sr, si = alike(np.float32(0)), alike(np.float32(0))
                for o in range(width):
                    r, m = load(re, row + o * LANES), load(im, row + o * LANES)
                    zr, zi = load(y, at + 2 * o * LANES), load(y, at + (2 * o + 1) * LANES)
                    sr = sr + r * zr - m * zi
                    si = si + r * zi + m * zr
                store(done, to, sr)
                store(done, to + LANES, si)
        scattered(done, count * rows, frequencies, c, out)


@no_type_check
@loop(fastmath=False)
def _apply_adjoint(first, last, re, im, base, width, frequencies, count, latent_rows, y, out):
    """out[base_i + o] += conj(A[i, o]) y[i], of as many flat spectra as in _apply."""
    rows = len(base)
    x = np.empty(count * rows * 2 * LANES, np.float32)
    done = np.empty(count * latent_rows * 2 * LANES, np.float32)
    for c in range(first, last):
        gathered(y, count * rows, frequencies, c, x)
        for k in range(len(done)):
            done[k] = 0
        for i in range(rows):
            row = (c * rows + i) * width * LANES
            for s in range(count):
                at, to = (s * rows + i) * 2 * LANES, (s * latent_rows + base[i]) * 2 * LANES
                zr, zi = load(x, at), load(x, at + LANES)
                for o in range(width):
                    r, m = load(re, row + o * LANES), load(im, row + o * LANES)
                    store(done, to, load(done, to) + r * zr + m * zi)
                    store(done, to + LANES, load(done, to + LANES) + r * zi - m * zr)
                    to += 2 * LANES
        scattered(done, count * latent_rows, frequencies, c, out)


@no_type_check
@loop(fastmath=False)
def _gram(first, last, re, im, base, rows, width, latent_rows, gr, gi):
    """The upper band of A^H A, flat (blocks, latent rows, width, lanes); zero on entry."""
    for c in range(first, last):
        for i in range(rows):
            row = (c * rows + i) * width * LANES
            for p in range(width):
                pr, pi = load(re, row + p * LANES), load(im, row + p * LANES)
                to = (c * latent_rows + base[i] + p) * width * LANES
                for o in range(p, width):
                    r, m = load(re, row + o * LANES), load(im, row + o * LANES)
                    store(gr, to, load(gr, to) + pr * r + pi * m)
                    store(gi, to, load(gi, to) + pr * m - pi * r)
                    to += LANES


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

    def crop(self, latent: Float[np.ndarray, "*images latent_rows period"], rows: int, cols: int) -> Float[np.ndarray, "*images rows cols"]:
        """The part of a latent image that lies on the pixels of the frame."""
        return latent[..., self.top : self.top + rows, self.left : self.left + cols]

    def extended(self, image: Float[np.ndarray, "*images rows cols"]) -> Float[np.ndarray, "*images latent_rows period"]:
        """A picture of the frame's size continued from its borders over the latent image's."""
        *images, rows, cols = image.shape
        beyond = (self.top, self.latent_rows - self.top - rows), (self.left, self.period - self.left - cols)
        return np.pad(image, [*((0, 0) for _ in images), *beyond], mode="edge")


@dataclass(frozen=True, kw_only=True, eq=False)
class RowFourier(Grid):
    """K(theta) for row-dependent shifts."""

    rows: int  # of the frame
    cols: int
    base: Int[np.ndarray, " rows"]  # the first latent row that each scanline sees
    re: Float[np.ndarray, "blocks rows width lanes"]
    im: Float[np.ndarray, "blocks rows width lanes"]

    def spectrum(self, image: Float[np.ndarray, "*images n period"]) -> Complex[np.ndarray, "*images n frequencies"]:
        """The Fourier transform along rows."""
        return np.asarray(scipy.fft.rfft(image, axis=-1))

    def image(self, spectrum: Complex[np.ndarray, "*images n frequencies"]) -> Float[np.ndarray, "*images n period"]:
        """The inverse of `spectrum`."""
        return np.asarray(scipy.fft.irfft(spectrum, n=self.period, axis=-1))

    def forward(self, latent: Complex[np.ndarray, "*images latent_rows frequencies"]) -> Complex[np.ndarray, "*images rows frequencies"]:
        """K l, spectrum to spectrum, of any number of images."""
        return self._applied(_apply, latent, self.rows)

    def adjoint(self, frame: Complex[np.ndarray, "*images rows frequencies"]) -> Complex[np.ndarray, "*images latent_rows frequencies"]:
        """K^H b, spectrum to spectrum, of any number of images."""
        return self._applied(_apply_adjoint, frame, self.latent_rows)

    def gram(self) -> tuple[Float[np.ndarray, "blocks latent_rows width lanes"], Float[np.ndarray, "blocks latent_rows width lanes"]]:
        """The upper bands of A^H A, real and imaginary, as solvers.banded stores them."""
        count, rows, width, lanes = self.re.shape
        re, im = (np.zeros((count, self.latent_rows, width, lanes), np.float32) for _ in range(2))
        symbol = (self.re.ravel(), self.im.ravel(), self.base, rows, width, self.latent_rows)
        spread(_gram, count, *symbol, re.ravel(), im.ravel(), size=self.re.nbytes)
        return re, im

    def _applied(
        self, kernel: Callable[..., None], spectra: Complex[np.ndarray, "*images n f"], rows: int
    ) -> Complex[np.ndarray, "*images m f"]:
        x = np.ascontiguousarray(spectra, np.complex64)
        out = np.empty((*x.shape[:-2], rows, self.frequencies), np.complex64)
        blocks, _, width, _ = self.re.shape
        images = x.size // (x.shape[-2] * self.frequencies)
        symbol = (self.re.ravel(), self.im.ravel(), self.base, width, self.frequencies, images, self.latent_rows)
        spread(kernel, blocks, *symbol, x.view(np.float32).ravel(), out.view(np.float32).ravel(), size=self.re.nbytes)
        return out


@dataclass(frozen=True, kw_only=True, eq=False)
class Extent(Grid):
    """How much of the latent image scanlines see that sample it at given offsets: of one frame, or of tiles that share one grid."""

    width: int  # latent rows that one scanline sees, at most
    base: Int[np.ndarray, "*tiles rows"]  # the first of them

    @property
    def symbol_bytes(self) -> int:
        """Of the symbol of one frame or tile."""
        return 8 * self.width * self.frequencies * self.base.shape[-1]

    @property
    def system_bytes(self) -> int:
        """Of the symbol of one frame or tile, its normal matrix, and the factor of that."""
        return self.symbol_bytes + 2 * 8 * self.width * self.frequencies * self.latent_rows

    def part(self, first: int, last: int) -> "Extent":
        """Of the tiles [first, last), on the grid that all share."""
        return replace(self, base=self.base[first:last])


def extent(displacement: Float[np.ndarray, "*tiles rows samples 2"], cols: int, margin: int = 2) -> Extent:
    """The extent of frames of `cols` columns whose scanline i samples the latent image at offsets `displacement[..., i, k, :]`."""
    rows = displacement.shape[-3]
    dx, dy = displacement[..., 0], displacement[..., 1]
    least, greatest = (np.floor(of(axis=-1)).astype(np.int64) for of in (dy.min, dy.max))  # a sample reads TAPS rows from there on
    lowest = np.arange(rows) + least
    width = int((greatest - least).max()) + TAPS
    top = int(max(0, -lowest.min())) + margin
    left = int(max(0.0, np.ceil(-dx.min()))) + margin
    right = int(max(0.0, np.ceil(dx.max()))) + margin
    period = scipy.fft.next_fast_len(cols + left + right, real=True)
    period += period % 2  # pyright: ignore[reportOperatorIssue]  # scipy's stub says it may be None
    base = (lowest + top).astype(np.int64)
    latent_rows = max(int(base.max()) + width, rows + top) + margin
    return Extent(top=top, latent_rows=latent_rows, left=left, period=period, width=width, base=base)


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
    count = -(-reach.frequencies // LANES)
    dx, share = (np.ascontiguousarray(each, dtype=float) for each in (dx, share))  # in one order, or each is compiled for
    re, im = (np.zeros((count, rows, reach.width, LANES), np.float32) for _ in range(2))
    index, across = taps(displacement[..., 1])
    samples = (dx, share, index - index.min(axis=-1, keepdims=True), across.astype(np.float32), float(reach.period))
    spread(_symbol, rows, *samples, rows, reach.width, count, re.ravel(), im.ravel())
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
