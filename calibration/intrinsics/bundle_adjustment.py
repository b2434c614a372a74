"""Lens and poses together (bundle adjustment), by least squares after Levenberg and Marquardt.

The derivatives of one view's corners depend on its own pose and the lens alone, so that the normal equations of each pose are solved
first, and what is left is as small as the lens: (A - sum_v B_v C_v^-1 B_v') dk = g - sum_v B_v C_v^-1 h_v, dp_v = C_v^-1 (h_v - B_v' dk).
"""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from calibration.intrinsics.views import View
from calibration.projection import project

_MOST_STEPS = 100
_CONVERGED = 1e-10  # of the sum of squares; a step that lowers it by less is the last
_DAMPING_START, _DAMPING_LEAST, _DAMPING_MOST = 1e-4, 1e-12, 1e8  # of the diagonal; beyond the most, no step helps
_DAMPING_FACTOR = 10  # by which it falls after a step that helps, and rises after one that does not
_POSE_RIDGE = 1e-12  # of the trace; keeps a pose that its view does not fix finite
_LENS_RANK = 1e-14  # relative singular value below which a combination of the lens's parameters is left where it is
_TINY = 1e-300  # keeps divisors from being 0


def adjust(
    views: Sequence[View], model: str, numbers: Float[np.ndarray, " p"], poses: Sequence[np.ndarray]
) -> tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]:
    """Lens, poses and residuals (computed less observed, px), from a start."""
    k, p, damping = np.array(numbers, float), np.array(poses, float), _DAMPING_START
    cost = _cost(views, model, k, p)
    for _ in range(_MOST_STEPS):
        A, B, C, g, h = _normal(views, model, k, p)
        before = cost
        while damping < _DAMPING_MOST:
            dk, dp = _step(A, B, C, g, h, damping)
            after = _cost(views, model, k + dk, p + dp)
            if after < cost:
                k, p, cost, damping = k + dk, p + dp, after, max(damping / _DAMPING_FACTOR, _DAMPING_LEAST)
                break
            damping *= _DAMPING_FACTOR
        if before - cost <= _CONVERGED * before:
            break
    return k, list(p), [project(model, k, view.object_points, pose)[0] - view.corners.points for view, pose in zip(views, p, strict=True)]


def _cost(views: Sequence[View], model: str, k: np.ndarray, p: np.ndarray) -> float:
    """The sum of weighted squares; without bound where a corner falls behind the camera."""
    squares = (
        view.weight * np.sum((project(model, k, view.object_points, pose)[0] - view.corners.points) ** 2)
        for view, pose in zip(views, p, strict=True)
    )
    total = float(sum(squares))
    return total if np.isfinite(total) else np.inf


def _normal(
    views: Sequence[View], model: str, k: np.ndarray, p: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """A, B_v, C_v, g and h_v."""
    n = len(k)
    A, B, C = np.zeros((n, n)), np.zeros((len(views), n, 6)), np.zeros((len(views), 6, 6))
    g, h = np.zeros(n), np.zeros((len(views), 6))
    for number, (view, pose) in enumerate(zip(views, p, strict=True)):
        points, by_pose, by_lens = project(model, k, view.object_points, pose)
        by_pose, by_lens = np.nan_to_num(by_pose), np.nan_to_num(by_lens)
        r = np.nan_to_num((view.corners.points - points).ravel())
        A += view.weight * by_lens.T @ by_lens
        B[number], C[number] = view.weight * by_lens.T @ by_pose, view.weight * by_pose.T @ by_pose
        g += view.weight * by_lens.T @ r
        h[number] = view.weight * by_pose.T @ r
    return A, B, C, g, h


def _step(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, g: np.ndarray, h: np.ndarray, damping: float
) -> tuple[Float[np.ndarray, " p"], Float[np.ndarray, "views 6"]]:
    """Towards the minimum; the stiffer, the shorter, each unknown in its own measure."""
    C = C + damping * C * np.eye(6) + _POSE_RIDGE * np.trace(C, axis1=1, axis2=2)[:, None, None] * np.eye(6)
    BC = np.linalg.solve(C, B.swapaxes(1, 2)).swapaxes(1, 2)  # B C^-1, for C is symmetric
    S = A + damping * np.diag(np.diag(A)) - np.sum(BC @ B.swapaxes(1, 2), axis=0)
    size = np.sqrt(np.maximum(np.diag(A), _TINY))
    dk = np.linalg.lstsq(S / np.outer(size, size), (g - np.einsum("vij,vj->i", BC, h)) / size, rcond=_LENS_RANK)[0] / size
    return dk, np.linalg.solve(C, (h - np.einsum("vij,i->vj", B, dk))[..., None])[..., 0]
