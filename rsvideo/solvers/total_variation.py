"""Algorithm 2, Eq. (15)-(18): an image under anisotropic total variation by the alternating direction method of multipliers."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from rsvideo.solvers.operator import LinearOperator
from rsvideo.solvers.prox import soft_threshold


@dataclass(frozen=True, kw_only=True, eq=False)
class Split:
    """One iterate: the image and, with scaled multipliers, the copies that ADMM makes of its gradient and its blur."""

    latent: np.ndarray  # l
    gradient: np.ndarray  # j, for D l
    gradient_gap: np.ndarray  # u = lambda / rho
    seen: np.ndarray  # v, for K l; the observation itself where there are no weights
    seen_gap: np.ndarray  # its scaled multiplier
    change: float  # of the image, relative to its norm


def total_variation(
    observed: np.ndarray,
    *,
    mu: float,
    rho: float,
    blur: LinearOperator,
    gradient: LinearOperator,
    minimise_l: Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray],
    start: np.ndarray,
    weights: np.ndarray | None = None,
    sigma: float | None = None,
    prior: np.ndarray | float = 1.0,
) -> Iterator[Split]:
    """Iterates towards argmin_l |K l - b|_W^2 / (2 mu) + |P D l|_1, where P, `prior`, may spare single differences.

    `minimise_l(v, g, l)` answers argmin_l s |K l - v|^2 / 2 + rho |D l - g|^2 / 2, perhaps starting from l. Without weights v = b and
    s = 1 / mu, as in the paper. With weights (0 for a missing or clipped pixel) the blur is split off too, so that the system to solve
    stays free of them: v is subject to K l = v, and s is the penalty `sigma`.
    """
    L, b = start, observed
    j = gradient.forward(L)
    u = np.zeros_like(j)
    sigma = 1 / mu if sigma is None else sigma

    def minimise_v(KL: np.ndarray) -> np.ndarray:
        return b if weights is None else (weights * b / mu + sigma * KL) / (weights / mu + sigma)

    v = b if weights is None else minimise_v(blur.forward(L))
    y = np.zeros_like(v)
    yield Split(latent=L, gradient=j, gradient_gap=u, seen=v, seen_gap=y, change=math.inf)
    while True:
        before = L
        L = minimise_l(v - y, j - u, before)  # Algorithm 2, step 1
        DL = gradient.forward(L)
        j = soft_threshold(DL + u, prior / rho)  # step 2
        u = u + DL - j  # step 3, lambda = rho u
        if weights is not None:
            KL = blur.forward(L)
            v = minimise_v(KL + y)
            y = y + KL - v
        norm = max(float(np.linalg.norm(before)), float(np.linalg.norm(L)))
        change = float(np.linalg.norm(L - before)) / norm if norm > 0 else 0.0
        yield Split(latent=L, gradient=j, gradient_gap=u, seen=v, seen_gap=y, change=change)


def objective(
    latent: np.ndarray,
    observed: np.ndarray,
    *,
    mu: float,
    blur: LinearOperator,
    gradient: LinearOperator,
    weights: np.ndarray | None = None,
) -> float:
    """Eq. (8): |b - K l|_W^2 / 2 + mu |D l|_1."""
    r = observed - blur.forward(latent)
    data = np.sum(r * r, dtype=float) if weights is None else np.sum(weights * r * r, dtype=float)
    return float(0.5 * data + mu * np.sum(np.abs(gradient.forward(latent)), dtype=float))
