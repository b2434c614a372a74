"""A board that is not flat, or not printed as it should be: where its corners really lie.

Corner j is moved by d_j in space, which is a priori a hundredth of the corners' distance or less. Given lens and poses, d_j follows from
what they leave of it in all views: d_j = argmin sum_v |r_vj + (dx_vj/dX) d_j|^2 + (s / S)^2 |d_j|^2, s being the corners' noise and S that
hundredth. Lens and poses are then found again, in turns (as Strobl and Hirzinger do in one step, ICCV workshops 2011).
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float

from calibration.intrinsics.bundle_adjustment import adjust
from calibration.intrinsics.views import View
from calibration.projection import project

_DISPLACED = 0.01  # S as part of the distance between corners, which printing and bending displace them by
_LEAST_NOISE = 0.02  # px, s at least: what detection reaches at best
_ROUNDS = 6  # of lens and board in turns; the last one moves the principal point by a tenth of its deviation


def corner_count(views: Sequence[View]) -> int:
    """How many corners the board has, as far as any view shows."""
    return 1 + max(int(view.corners.numbers.max()) for view in views)


def stiffness(views: Sequence[View], residuals: Sequence[np.ndarray]) -> float:
    """(s / S)^2, px^2 / m^2: how strongly corners are held to their nominal places."""
    noise = max(float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))), _LEAST_NOISE)
    spacing = min(float(np.linalg.norm(np.diff(view.object_points, axis=0), axis=1).min()) for view in views)
    return (noise / (_DISPLACED * spacing)) ** 2


def derivative(view: View, model: str, numbers: Float[np.ndarray, " p"], pose: np.ndarray, count: int) -> Float[np.ndarray, "two_n moves"]:
    """Of a view's image points, by the places of all corners of the board."""
    whole = np.zeros((len(view.object_points), 2, count, 3))
    whole[np.arange(len(view.object_points)), :, view.corners.numbers] = _slopes(view, model, numbers, pose)
    return whole.reshape(2 * len(view.object_points), 3 * count)


def _slopes(view: View, model: str, numbers: Float[np.ndarray, " p"], pose: np.ndarray) -> Float[np.ndarray, "n 2 3"]:
    return (project(model, numbers, view.object_points, pose)[1][:, 3:] @ cv2.Rodrigues(pose[:3])[0]).reshape(-1, 2, 3)


def displacements(
    nominal: Sequence[View],
    views: Sequence[View],
    model: str,
    numbers: Float[np.ndarray, " p"],
    poses: Sequence[np.ndarray],
    residuals: Sequence[np.ndarray],
) -> Float[np.ndarray, "corners 3"]:
    """How far each corner of the board lies from its nominal place, in metres, given a fit to `views`, whose corners are moved already."""
    count = corner_count(nominal)
    A, b = np.tile(stiffness(nominal, residuals) * np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    for before, view, pose, residual in zip(nominal, views, poses, residuals, strict=True):
        J = _slopes(view, model, numbers, pose)
        rest = residual - np.einsum("nij,nj->ni", J, view.object_points - before.object_points)  # as if no corner were moved yet
        A[view.corners.numbers] += view.weight * np.einsum("nij,nik->njk", J, J)
        b[view.corners.numbers] -= view.weight * np.einsum("nij,ni->nj", J, rest)
    return np.linalg.solve(A, b[..., None])[..., 0]


def moved(views: Sequence[View], by: Float[np.ndarray, "corners 3"]) -> list[View]:
    """The views of a board whose corners are moved; those that no view showed stay."""
    reach = np.concatenate([by, np.zeros((1, 3))])
    return [replace(view, object_points=view.object_points + reach[np.minimum(view.corners.numbers, len(by))]) for view in views]


def fit(
    views: Sequence[View], model: str, numbers: Float[np.ndarray, " p"], poses: Sequence[np.ndarray]
) -> tuple[list[View], Float[np.ndarray, "corners 3"], tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]]:
    """Lens, poses and the board's shape: the views with corners moved, by how much (m), and lens, poses and residuals with them."""
    shaped, by = list(views), np.zeros((1, 3))
    numbers, poses, residuals = adjust(views, model, numbers, poses)
    for _ in range(_ROUNDS):
        by = displacements(views, shaped, model, numbers, poses, residuals)
        shaped = moved(views, by)
        numbers, poses, residuals = adjust(shaped, model, numbers, poses)
    return shaped, by, (numbers, poses, residuals)
