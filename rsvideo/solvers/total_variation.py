"""Algorithm 2, Eq. (15)-(18): an image under anisotropic total variation by the alternating direction method of multipliers."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TypeVar, no_type_check

import numpy as np

from rsvideo.solvers.differences import Differences
from rsvideo.solvers.operator import LinearOperator
from rsvideo.threads import loop, spread

T = TypeVar("T")
LatentUpdate = Callable[[T, np.ndarray, np.ndarray], tuple[np.ndarray, T]]
"""(b, h, l) -> (l, b): argmin_l |K l - b|^2 / 2 + rho |D l - g|^2 / 2 with h = D^T g, perhaps from l on, and the data of the next step."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Split:
    """One iterate: the image, and the multiplier of the copy j that ADMM makes of its gradient."""

    latent: np.ndarray  # l
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
    gradient: Differences,
    update: LatentUpdate[T],
    start: np.ndarray,
    across: np.ndarray | float = 1.0,
) -> Iterator[Split]:
    """Iterates towards argmin_l |K l - b|^2 / 2 + mu |P D l|_1, where P, `across`, may spare differences between columns.

    Any number of images are restored at once. `update` makes step 1 and hands back what the next one takes for b. Where b lacks pixels,
    that can be b completed from K l: the sum over all pixels then bounds the sum over those that were observed from above and touches it
    at the last l, so that both have the same least. Or the blur can be split off too, and b be the copy of K l and its multiplier. rho
    steers the speed alone.
    """
    L, b = start, observed
    u = np.zeros((2, *L.shape), L.dtype)
    pull = gradient.adjoint(gradient.forward(L))
    thresholds = np.broadcast_to(np.asarray(mu / rho * np.asarray(across), L.dtype), L.shape[-1:]), L.dtype.type(mu / rho)
    yield Split(latent=L, multiplier=u)
    while True:
        before = L
        L, b = update(b, pull, before)  # Algorithm 2, step 1: argmin_l L(l, j, u), Eq. (17)
        u, pull = _split(L, u, thresholds, gradient.periodic_cols)
        yield Split(latent=L, multiplier=u, before=before)


def _split(latent: np.ndarray, u: np.ndarray, thresholds: tuple[np.ndarray, np.floating], periodic: bool) -> tuple[np.ndarray, np.ndarray]:
    """Steps 2 and 3 of Algorithm 2: u of the next step, and D^T (j - u) with it.

    With v = D l + u, step 2 is j = argmin_j L(l, j, u) = v - clip(v), and step 3, lambda = rho u, is u = v - j = clip(v).
    """
    shape = (-1, *latent.shape[-2:])
    images = np.ascontiguousarray(latent).reshape(shape)
    found, pull = np.empty_like(u), np.empty_like(images)
    (ux, uy), (nx, ny) = (each.reshape(2, *images.shape) for each in (u, found))
    across, down = thresholds
    spread(_shrink, len(images), images, ux, uy, np.ascontiguousarray(across), down, periodic, nx, ny, pull)
    return found, pull.reshape(latent.shape)


@no_type_check
@loop(fastmath=False)
def _shrink(first, last, latent, ux, uy, across, down, periodic, nx, ny, pull):
    """Of each image: n = clip(v) of v = D l + u, and pull = D^T (v - 2 n), in one pass."""
    _, rows, cols = latent.shape
    g, h, above = np.zeros(cols, latent.dtype), np.zeros(cols, latent.dtype), np.zeros(cols, latent.dtype)
    for s in range(first, last):
        for c in range(cols):
            above[c] = 0
        for r in range(rows):
            line, u, n = latent[s, r], ux[s, r], nx[s, r]
            for c in range(cols - 1):
                v = line[c + 1] - line[c] + u[c]
                n[c] = min(max(v, -across[c]), across[c])
                g[c] = v - 2 * n[c]
            n[cols - 1], g[cols - 1] = 0, 0
            if periodic:
                v = line[0] - line[cols - 1] + u[cols - 1]
                n[cols - 1] = min(max(v, -across[cols - 1]), across[cols - 1])
                g[cols - 1] = v - 2 * n[cols - 1]
            u, n = uy[s, r], ny[s, r]
            if r < rows - 1:
                below = latent[s, r + 1]
                for c in range(cols):
                    v = below[c] - line[c] + u[c]
                    n[c] = min(max(v, -down), down)
                    h[c] = v - 2 * n[c]
            else:
                for c in range(cols):
                    n[c], h[c] = 0, 0
            out = pull[s, r]
            out[0] = g[cols - 1] - g[0] + above[0] - h[0]
            for c in range(1, cols):
                out[c] = g[c - 1] - g[c] + above[c] - h[c]
            above, h = h, above


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
