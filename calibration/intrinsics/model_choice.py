"""Which lens model, with how many coefficients: the simplest that does as well as any on views that it was not fitted to."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from calibration.intrinsics import board_shape
from calibration.intrinsics.bundle_adjustment import adjust
from calibration.intrinsics.pose import pose, start
from calibration.intrinsics.views import View

FEWEST_VIEWS = 3  # fewer do not fix a lens
CANDIDATES = (("brown-conrady", 4), ("fisheye", 4), ("brown-conrady", 5), ("brown-conrady", 8))  # model, coefficients; the simpler first
_BETTER = 0.98  # a lens of more coefficients must bring the error of views that were left out below this part
_FOLDS = 5


def choose(views: Sequence[View], candidates: Sequence[tuple[str, int]]) -> tuple[tuple[str, int], dict[str, float]]:
    """One of the candidates, and the error (px) of each on views left out; none where the views are too few to leave any out."""
    folds = min(_FOLDS, len(views))
    if len(views) - -(-len(views) // folds) < FEWEST_VIEWS:
        return candidates[0], {}
    errors = {}
    for model, count in candidates:
        whole, poses, _ = adjust(views, model, *start(views, model, count))
        if np.isfinite(error := left_out_error(views, model, whole, poses)):
            errors[(model, count)] = error
    if not errors:
        raise ValueError("no lens explains these views; is --board what was filmed, and flat?")
    best = min(errors.values())
    chosen = next(one for one, error in errors.items() if _BETTER * error <= best)
    return chosen, {_name(*one): error for one, error in errors.items()}


def left_out_error(
    views: Sequence[View], model: str, whole: Float[np.ndarray, " p"], poses: Sequence[np.ndarray], *, bent: bool = False
) -> float:
    """The error (px) of views that took no part in the fit, each left out once; with `bent`, the board's shape is fitted too."""
    folds, squares = min(_FOLDS, len(views)), []
    for fold in range(folds):
        kept = [number for number in range(len(views)) if number % folds != fold]
        from_here = [views[number] for number in kept], model, whole, [poses[number] for number in kept]
        left_out = list(views[fold::folds])
        if bent:
            _, by, (numbers, _, _) = board_shape.fit(*from_here)
            left_out = board_shape.moved(left_out, by)
        else:
            numbers, _, _ = adjust(*from_here)
        squares += [np.sum(pose(view, model, numbers)[1] ** 2, axis=1) for view in left_out]
    return float(np.sqrt(np.concatenate(squares).mean()))


def _name(model: str, count: int) -> str:
    return model if model == "fisheye" else f"{model} of {count}"
