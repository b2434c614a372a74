"""The latent image of a given trajectory under anisotropic total variation: Sec. 4.3, Algorithm 2.

A shift is solved for exactly, by scanlines (physics.row_fourier, solvers.banded); a turn of the camera by conjugate gradients, as
published.
"""

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
from rsvideo.solvers.total_variation import LatentUpdate, Split, total_variation


@dataclass(frozen=True, kw_only=True)
class LatentSettings:
    """How far ADMM goes. Penalties are free: they change the steps, not the image that they lead to."""

    steps: int = 20  # of ADMM; origin: by trial
    tolerance: float = 1e-4  # relative change of the image
    threshold: float = 0.02  # mu / rho, the gradient below which the first step sees noise; origin: by trial
    trust: float = 0.3  # sigma, how stiffly the blur is tied to the frame; origin: by trial
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


def restore(
    b: Float[np.ndarray, "rows cols"], K: BlurOperator, *, mu: float, settings: LatentSettings
) -> Float[np.ndarray, "latent_rows latent_cols"]:
    """argmin_l |b - K l|^2 / 2 + mu |D l|_1, Eq. (15): by rows and exactly for a shift, by conjugate gradients for a turn.

    By rows, samples between columns are those of the Fourier series; between rows, and everywhere for a turn, they are linear.
    """
    if not (math.isfinite(mu) and mu > 0):
        raise ValueError(f"mu must be above 0, got {mu:g}")
    if not K.is_shift:
        return restore_by_gradients(b, K, mu=mu, settings=settings).state.latent
    direction = K.camera.timing.direction
    lines = direction.scanlines(b)
    A = row_fourier(K.displacement, lines.shape[1])
    latent = restore_rows(lines, A, mu=mu, settings=settings).state.latent
    rows, cols = direction.scanlines(np.empty(K.latent_shape)).shape
    row = np.clip(np.arange(rows) - (rows - A.rows) // 2 + A.top, 0, A.latent_rows - 1)
    col = np.clip(np.arange(cols) - (cols - A.cols) // 2 + A.left, 0, A.period - 1)
    return np.ascontiguousarray(direction.image(latent[row[:, None], col[None]])).astype(b.dtype)


Blurred = tuple[np.ndarray, np.ndarray]  # v, the copy that ADMM makes of K l, and its scaled multiplier y


def restore_rows(b: Float[np.ndarray, "rows cols"], A: RowFourier, *, mu: float, settings: LatentSettings) -> Solution[Split]:
    """ADMM in the frame of `A`: float32, and all that the frame does not show is no data.

    Columns are periodic for the solver only: the difference across the seam costs nothing, so nothing ties the image's sides.
    """
    rho = mu / settings.threshold
    index = np.clip(np.arange(A.period) - A.left, 0, A.cols - 1)
    wide = b[:, index].astype(np.float32)
    W = np.zeros(wide.shape, np.float32)
    W[:, A.left : A.left + A.cols] = 1
    start = wide[np.clip(np.arange(A.latent_rows) - A.top, 0, A.rows - 1)]
    P = np.ones(A.period, np.float32)
    P[-1] = 0  # the seam
    minimise_l, copy = exact_update(A, wide, W, sigma=settings.trust, rho=rho)
    v = copy(A.image(A.forward(A.spectrum(start))))
    states = total_variation(
        (v, np.zeros_like(v)), mu=mu, rho=rho, gradient=Differences(periodic_cols=True), update=minimise_l, start=start, across=P
    )
    return solve(states, steps=settings.steps, tolerance=settings.tolerance)


def exact_update(
    A: RowFourier, b: Float[np.ndarray, "rows period"], W: Float[np.ndarray, "rows period"], *, sigma: float, rho: float
) -> tuple[LatentUpdate[Blurred], Callable[[np.ndarray], np.ndarray]]:
    """The l-update, solved exactly by rows, and the v-update, both for |v - b|_W^2 / 2 subject to K l = v with the penalty sigma.

    With the blur split off, the matrix sigma A^H A + rho D^T D stays free of the weights W, and is factored once.
    """
    re, im = A.gram()
    gram = BandedHermitian(re=re, im=im, frequencies=A.frequencies)
    N = gram.factor((rho * A.difference_power).astype(np.float32), rho, scale=sigma)

    def minimise_v(KL: np.ndarray) -> np.ndarray:
        return (W * b + sigma * KL) / (W + sigma)

    def minimise_l(data: Blurred, h: np.ndarray, _: np.ndarray) -> tuple[np.ndarray, Blurred]:
        v, y = data
        spectrum = N.solve(sigma * A.adjoint(A.spectrum(v - y)) + rho * A.spectrum(h))
        KL = A.image(A.forward(spectrum))
        v = minimise_v(KL + y)
        return A.image(spectrum), (v, y + KL - v)

    return minimise_l, minimise_v


def restore_by_gradients(b: Float[np.ndarray, "rows cols"], K: BlurOperator, *, mu: float, settings: LatentSettings) -> Solution[Split]:
    """ADMM for any trajectory, its l-update by conjugate gradients; at the precision of `b`."""
    rho, D = mu / settings.threshold, Differences()
    N = NormalMatrix(blur=K, gradient=D, rho=rho)

    def update(data: np.ndarray, h: np.ndarray, latent: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        states = conjugate_gradient(N, K.adjoint(data) + rho * h, latent)
        return solve(states, steps=settings.inner_steps, tolerance=settings.inner_tolerance).state.x, data

    start = np.pad(b, [(m, m) for m in K.margin], mode="edge")
    states = total_variation(b, mu=mu, rho=rho, gradient=D, update=update, start=start)
    return solve(states, steps=settings.steps, tolerance=settings.tolerance)
