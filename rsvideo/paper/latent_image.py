"""The latent image of a known trajectory under anisotropic total variation: Sec. 4.3."""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rsvideo.physics.blur import BlurOperator
from rsvideo.physics.row_fourier import RowFourier, row_fourier
from rsvideo.solvers.banded import BandedHermitian
from rsvideo.solvers.conjugate_gradient import NormalMatrix, conjugate_gradient
from rsvideo.solvers.differences import Differences
from rsvideo.solvers.stopping import Solution, solve
from rsvideo.solvers.total_variation import Split, total_variation


@dataclass(frozen=True, kw_only=True)
class LatentSettings:
    """How far ADMM goes. Penalties are free: they change the way, not the image at its end."""

    steps: int = 20  # of ADMM
    tolerance: float = 1e-4  # relative change of the image
    threshold: float = 0.02  # 1 / rho, the gradient below which the first step sees noise
    trust: float = 0.3  # sigma mu, how stiffly the blur is tied to what was seen
    inner_steps: int = 12  # of conjugate gradients, where the camera turns
    inner_tolerance: float = 1e-5  # of their residual; coarser, and the outer steps stand still


@dataclass(frozen=True, kw_only=True, eq=False)
class RowBlur:
    """RowFourier on images instead of spectra. Along rows it interpolates by Fourier series, where BlurOperator is linear."""

    rows: RowFourier

    def forward(self, image: Float[np.ndarray, "latent_rows period"]) -> Float[np.ndarray, "rows period"]:
        """K l."""
        return self.rows.image(self.rows.forward(self.rows.spectrum(image)))

    def adjoint(self, frame: Float[np.ndarray, "rows period"]) -> Float[np.ndarray, "latent_rows period"]:
        """K^T b."""
        return self.rows.image(self.rows.adjoint(self.rows.spectrum(frame)))


def exact_step(A: RowFourier, *, sigma: float, rho: float) -> Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]:
    """The l-update of ADMM, solved exactly: factors once, then (sigma A^H A + rho D^T D) l = sigma A^H v + rho D^T g by rows."""
    D = Differences(periodic_cols=True)
    re, im = A.gram()
    gram = BandedHermitian(re=re, im=im, frequencies=A.frequencies)
    N = gram.plus(sigma, (rho * A.difference_power).astype(np.float32), rho).factor()

    def minimise_l(v: np.ndarray, g: np.ndarray, _: np.ndarray) -> np.ndarray:
        return A.image(N.solve(sigma * A.adjoint(A.spectrum(v)) + rho * A.spectrum(D.adjoint(g))))

    return minimise_l


def restore_rows(
    b: Float[np.ndarray, "rows cols"], A: RowFourier, *, mu: float, settings: LatentSettings, weights: Float[np.ndarray, "rows cols"] | None
) -> Solution[Split]:
    """ADMM in the frame of `A`: float32, all that the frame does not show has weight 0.

    Columns are periodic for the solver only: the difference across the seam costs nothing, so nothing ties the image's sides.
    """
    sigma, rho = settings.trust / mu, 1 / settings.threshold
    index = np.clip(np.arange(A.period) - A.left, 0, A.cols - 1)
    wide = b[:, index].astype(np.float32)
    W = np.zeros(wide.shape, np.float32)
    W[:, A.left : A.left + A.cols] = 1 if weights is None else weights
    start = wide[np.clip(np.arange(A.latent_rows) - A.top, 0, A.rows - 1)]
    P = np.ones((2, *start.shape), np.float32)
    P[0, :, -1] = 0  # the seam
    states = total_variation(
        wide,
        mu=mu,
        rho=rho,
        sigma=sigma,
        weights=W,
        blur=RowBlur(rows=A),
        gradient=Differences(periodic_cols=True),
        minimise_l=exact_step(A, sigma=sigma, rho=rho),
        start=start,
        prior=P,
    )
    return solve(states, steps=settings.steps, tolerance=settings.tolerance)


def restore_by_gradients(
    b: Float[np.ndarray, "rows cols"],
    K: BlurOperator,
    *,
    mu: float,
    settings: LatentSettings,
    weights: Float[np.ndarray, "rows cols"] | None,
) -> Solution[Split]:
    """ADMM for any trajectory, its l-update by conjugate gradients; at the precision of `b`."""
    sigma, rho = 1 / mu, 1 / settings.threshold
    D = Differences()
    N = NormalMatrix(blur=K, gradient=D, scale=sigma, rho=rho, weights=weights)

    def minimise_l(v: np.ndarray, g: np.ndarray, latent: np.ndarray) -> np.ndarray:
        rhs = sigma * K.adjoint(v if weights is None else weights * v) + rho * D.adjoint(g)
        return solve(conjugate_gradient(N, rhs, latent), steps=settings.inner_steps, tolerance=settings.inner_tolerance).state.x

    start = np.pad(b, [(m, m) for m in K.margin], mode="edge")
    states = total_variation(b, mu=mu, rho=rho, blur=K, gradient=D, minimise_l=minimise_l, start=start)
    return solve(states, steps=settings.steps, tolerance=settings.tolerance)


def restore(
    b: Float[np.ndarray, "rows cols"],
    K: BlurOperator,
    *,
    mu: float,
    settings: LatentSettings,
    weights: Float[np.ndarray, "rows cols"] | None = None,
) -> Float[np.ndarray, "latent_rows latent_cols"]:
    """argmin_l |b - K l|_W^2 / 2 + mu |D l|_1, Eq. (15): by rows and exactly for a shift, by conjugate gradients for a turn.

    By rows, samples between columns are those of the Fourier series; between rows, and everywhere for a turn, they are linear.
    Pixels of weight 0, such as clipped ones, say nothing.
    """
    if not (math.isfinite(mu) and mu > 0):
        raise ValueError(f"mu must be above 0, got {mu:g}")
    if not K.is_shift:
        return restore_by_gradients(b, K, mu=mu, settings=settings, weights=weights).state.latent
    way = K.timing.direction
    lines, W = way.scanlines(b), None if weights is None else way.scanlines(weights)
    A = row_fourier(K.displacement, lines.shape[1])
    found = restore_rows(lines, A, mu=mu, settings=settings, weights=W).state.latent
    rows, cols = way.scanlines(np.empty(K.latent_shape)).shape
    row = np.clip(np.arange(rows) - (rows - A.rows) // 2 + A.top, 0, A.latent_rows - 1)
    col = np.clip(np.arange(cols) - (cols - A.cols) // 2 + A.left, 0, A.period - 1)
    return np.ascontiguousarray(way.image(found[row[:, None], col[None]])).astype(b.dtype)
