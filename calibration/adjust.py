"""Lens and poses together, by least squares after Levenberg and Marquardt.

The derivatives of one view's corners know its own pose and the lens alone, so that the normal equations of each pose are solved first, and
what is left is as small as the lens: (A - sum_v B_v C_v^-1 B_v') dk = g - sum_v B_v C_v^-1 h_v, dp_v = C_v^-1 (h_v - B_v' dk).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from calibration.projection import project
from calibration.views import View

_MOST = 100  # steps
_EVEN = 1e-10  # of the sum of squares; a step that lowers it by less is the last
_DAMPED, _STIFFEST = 1e-4, 1e8  # of the diagonal, at first, and when no step helps


def adjust(
    views: Sequence[View], model: str, numbers: Float[np.ndarray, " p"], poses: Sequence[np.ndarray]
) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """Lens, poses and residuals (computed less seen, px), from a start."""
    k, p, damped = np.array(numbers, float), np.array(poses, float), _DAMPED
    cost = _cost(views, model, k, p)
    for _ in range(_MOST):
        A, B, C, g, h = _normal(views, model, k, p)
        before = cost
        while damped < _STIFFEST:
            dk, dp = _step(A, B, C, g, h, damped)
            after = _cost(views, model, k + dk, p + dp)
            if after < cost:
                k, p, cost, damped = k + dk, p + dp, after, max(damped / 10, 1e-12)
                break
            damped *= 10
        if before - cost <= _EVEN * before:
            break
    return k, list(p), [project(model, k, view.at, pose)[0] - view.seen.points for view, pose in zip(views, p, strict=True)]


def _cost(views: Sequence[View], model: str, k: np.ndarray, p: np.ndarray) -> float:
    """The sum of weighted squares; without bound where a corner falls behind the camera."""
    rests = (
        view.weight * np.sum((project(model, k, view.at, pose)[0] - view.seen.points) ** 2) for view, pose in zip(views, p, strict=True)
    )
    total = float(sum(rests))
    return total if np.isfinite(total) else np.inf


def _normal(
    views: Sequence[View], model: str, k: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B_v, C_v, g and h_v."""
    n = len(k)
    A, B, C = np.zeros((n, n)), np.zeros((len(views), n, 6)), np.zeros((len(views), 6, 6))
    g, h = np.zeros(n), np.zeros((len(views), 6))
    for number, (view, pose) in enumerate(zip(views, p, strict=True)):
        points, by_pose, by_lens = project(model, k, view.at, pose)
        by_pose, by_lens = np.nan_to_num(by_pose), np.nan_to_num(by_lens)
        r = np.nan_to_num((view.seen.points - points).ravel())
        A += view.weight * by_lens.T @ by_lens
        B[number], C[number] = view.weight * by_lens.T @ by_pose, view.weight * by_pose.T @ by_pose
        g += view.weight * by_lens.T @ r
        h[number] = view.weight * by_pose.T @ r
    return A, B, C, g, h


def _step(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, g: np.ndarray, h: np.ndarray, damped: float
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "views 6"]]:
    """Towards the minimum; the stiffer, the shorter, each unknown in its own measure."""
    C = C + damped * C * np.eye(6) + 1e-12 * np.trace(C, axis1=1, axis2=2)[:, None, None] * np.eye(6)
    BC = np.linalg.solve(C, B.swapaxes(1, 2)).swapaxes(1, 2)  # B C^-1, for C is symmetric
    S = A + damped * np.diag(np.diag(A)) - np.sum(BC @ B.swapaxes(1, 2), axis=0)
    size = np.sqrt(np.maximum(np.diag(A), 1e-300))
    dk = np.linalg.lstsq(S / np.outer(size, size), (g - np.einsum("vij,vj->i", BC, h)) / size, rcond=1e-14)[0] / size
    return dk, np.linalg.solve(C, (h - np.einsum("vij,i->vj", B, dk))[..., None])[..., 0]
