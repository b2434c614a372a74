"""Algorithm 2, Eq. (15)-(18): an image under anisotropic total variation by the alternating direction method of multipliers."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from rsvideo.solvers.operator import LinearOperator
from rsvideo.solvers.prox import soft_threshold

T = TypeVar("T")
LatentUpdate = Callable[[T, np.ndarray, np.ndarray], tuple[np.ndarray, T]]
"""(b, g, l) -> (l, b): argmin_l |K l - b|^2 / 2 + rho |D l - g|^2 / 2, perhaps from l on, and the data of the next step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Split:
    """One iterate: the image and the copy that ADMM makes of its gradient."""

    latent: np.ndarray  # l
    gradient: np.ndarray  # j, for D l
    multiplier: np.ndarray  # u = lambda / rho
    before: np.ndarray | None = None  # l of the step before

    @property
    def change(self) -> float:
        """Of the image in the last step, relative to its norm; infinite at the start."""
        if self.before is None:
            return math.inf
        norm = max(float(np.linalg.norm(self.before)), float(np.linalg.norm(self.latent)))
        return float(np.linalg.norm(self.latent - self.before)) / norm if norm > 0 else 0.0


def total_variation(
    observed: T,
    *,
    mu: float,
    rho: float,
    gradient: LinearOperator,
    update: LatentUpdate[T],
    start: np.ndarray,
    weights: np.ndarray | float = 1.0,
) -> Iterator[Split]:
    """Iterates towards argmin_l |K l - b|^2 / 2 + mu |P D l|_1, where P, `weights`, may spare single differences.

    `update` makes step 1 and hands back what the next one takes for b. Where b lacks pixels, that can be b completed from K l: the sum
    over all pixels then bounds the sum over those that were observed from above and touches it at the last l, so that both have the
    same least. Or the blur can be split off too, and b be the copy of K l and its multiplier. rho steers the speed alone.
    """
    L, b = start, observed
    j = gradient.forward(L)
    u = np.zeros_like(j)
    threshold = mu / rho * weights
    yield Split(latent=L, gradient=j, multiplier=u)
    while True:
        before = L
        L, b = update(b, j - u, before)  # Algorithm 2, step 1: argmin_l L(l, j, u), Eq. (17)
        DL = gradient.forward(L)
        j = soft_threshold(DL + u, threshold)  # step 2: argmin_j L(l, j, u)
        u = u + DL - j  # step 3, lambda = rho u
        yield Split(latent=L, gradient=j, multiplier=u, before=before)


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
