"""How sure the numbers of a lens are: standard deviations of its parameters."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from calibration.intrinsics import board_shape
from calibration.intrinsics.views import View
from calibration.projection import project


def deviations(
    views: Sequence[View],
    model: str,
    numbers: Float[np.ndarray, " p"],
    poses: Sequence[np.ndarray],
    residuals: Sequence[np.ndarray],
    *,
    bent: bool = False,
) -> Float[np.ndarray, " p"]:
    """Standard deviations of the lens, the poses being unknown too, and with `bent` the places of the board's corners.

    Once from the residuals' size as if all corners erred by themselves, and once from how far the views pull the lens in different
    directions (a board that is not flat errs alike over a whole view); the larger of the two.
    """
    p, corners = len(numbers), board_shape.corner_count(views) if bent else 0
    S = np.diag(np.repeat([0.0, board_shape.stiffness(views, residuals)], [p, 3 * corners]))
    pulls, squares, count = np.zeros((len(views), len(S))), 0.0, -len(S)
    for number, (view, pose, residual) in enumerate(zip(views, poses, residuals, strict=True)):
        _, by_pose, by_all = project(model, numbers, view.object_points, pose)
        if bent:
            by_all = np.hstack([by_all, board_shape.derivative(view, model, numbers, pose, corners)])
        r = residual.ravel()
        free = by_all - by_pose @ np.linalg.lstsq(by_pose, by_all, rcond=None)[0]  # what no change of the pose can do
        S += view.weight * by_all.T @ free
        pulls[number] = view.weight * free.T @ r
        squares += view.weight * float(r @ r)
        count += len(r) - 6
    inverse = np.linalg.pinv(S, hermitian=True)[:p]
    alone = squares / max(count, 1) * np.diag(inverse)
    together = np.sum((pulls @ inverse.T) ** 2, axis=0) * len(views) / max(len(views) - 1, 1)
    return np.sqrt(np.maximum(alone, together))
