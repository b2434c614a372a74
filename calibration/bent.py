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

from calibration.projection import project
from calibration.views import View

_OFF = 0.01  # of the distance between corners, which they may be off
_FAINTEST = 0.02  # px, the least noise that is reckoned with


def corners(views: Sequence[View]) -> int:
    """Of the board, as far as it was seen."""
    return 1 + max(int(view.seen.numbers.max()) for view in views)


def stiffness(views: Sequence[View], residuals: Sequence[np.ndarray]) -> float:
    """(s / S)^2, px^2 / m^2."""
    noise = max(float(np.sqrt(np.mean(np.concatenate(residuals) ** 2))), _FAINTEST)
    apart = min(float(np.linalg.norm(np.diff(view.at, axis=0), axis=1).min()) for view in views)
    return (noise / (_OFF * apart)) ** 2


def derivative(view: View, model: str, numbers: Float[np.ndarray, " p"], pose: np.ndarray, count: int) -> Float[np.ndarray, "two_n moves"]:
    """Of where a view's corners are seen, by the places of all corners of the board."""
    whole = np.zeros((len(view.at), 2, count, 3))
    whole[np.arange(len(view.at)), :, view.seen.numbers] = _slopes(view, model, numbers, pose)
    return whole.reshape(2 * len(view.at), 3 * count)


def _slopes(view: View, model: str, numbers: Float[np.ndarray, " p"], pose: np.ndarray) -> Float[np.ndarray, "n 2 3"]:
    return (project(model, numbers, view.at, pose)[1][:, 3:] @ cv2.Rodrigues(pose[:3])[0]).reshape(-1, 2, 3)


def moves(
    nominal: Sequence[View],
    views: Sequence[View],
    model: str,
    numbers: Float[np.ndarray, " p"],
    poses: Sequence[np.ndarray],
    residuals: Sequence[np.ndarray],
) -> Float[np.ndarray, "corners 3"]:
    """How far each corner of the board lies from where it should, in metres, given a fit to `views`, whose corners are moved already."""
    count = corners(nominal)
    A, b = np.tile(stiffness(nominal, residuals) * np.eye(3), (count, 1, 1)), np.zeros((count, 3))
    for before, view, pose, residual in zip(nominal, views, poses, residuals, strict=True):
        J = _slopes(view, model, numbers, pose)
        rest = residual - np.einsum("nij,nj->ni", J, view.at - before.at)  # as if no corner were moved yet
        A[view.seen.numbers] += view.weight * np.einsum("nij,nik->njk", J, J)
        b[view.seen.numbers] -= view.weight * np.einsum("nij,ni->nj", J, rest)
    return np.linalg.solve(A, b[..., None])[..., 0]


def moved(views: Sequence[View], by: Float[np.ndarray, "corners 3"]) -> list[View]:
    """The views of a board whose corners are moved; those that no view showed stay."""
    reach = np.concatenate([by, np.zeros((1, 3))])
    return [replace(view, at=view.at + reach[np.minimum(view.seen.numbers, len(by))]) for view in views]
