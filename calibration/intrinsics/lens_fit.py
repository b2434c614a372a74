"""The lens from views of a board: pinhole and distortion by least squares, chosen by the views that were left out.

Corner j of view v lies at X_j on the board and is observed at x_vj = project(lens; R_v X_j + t_v) + noise. Lens and poses are found
together; the noise is taken to be the same in every direction. Where the board is not what it should be, X_j is found too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from calibration.intrinsics import board_shape
from calibration.intrinsics.bundle_adjustment import adjust
from calibration.intrinsics.model_choice import CANDIDATES, FEWEST_VIEWS, choose, left_out_error
from calibration.intrinsics.pose import rms, start
from calibration.intrinsics.uncertainty import deviations
from calibration.intrinsics.views import Refused, View

ENOUGH_VIEWS = 8  # for views to be left out one by one, and for the board's shape
BENT = 0.9  # a board off whose corners' places bring the error of views that were left out below this part is not what its name says
_OUTLYING = 3.0  # a view whose error is that many times the median does not show the board as it is


@dataclass(frozen=True, kw_only=True, eq=False)
class Lens:
    """A lens and its uncertainty, in OpenCV's models and order."""

    model: str  # "brown-conrady" or "fisheye"
    numbers: Float[np.ndarray, " p"]  # fx, fy, cx, cy in px, then the coefficients of distortion
    std: Float[np.ndarray, " p"]  # standard deviations

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """The camera matrix."""
        fx, fy, cx, cy = self.numbers[:4]
        return np.array([[fx, 0, cx], [0, fy, cy], [0, 0, 1]])


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """A lens, and how well it explains the views."""

    lens: Lens
    views: tuple[View, ...]
    refused: tuple[Refused, ...]  # for what the fit showed
    residuals: tuple[Float[np.ndarray, "_ 2"], ...]  # px, computed less observed, of each view
    rms: float  # px, of the distance
    left_out: dict[str, float]  # px, of views not used for the fit, by candidate
    left_out_if_bent: float | None  # px, the same of the chosen lens if corners may be displaced on the board; None: too few views
    displacement: float  # metres, of the corner that lies farthest off its place on the board; 0: taken to lie where it should


class TooFewViewsError(ValueError):
    """The views that can be used do not fix a lens; `refused` says why others cannot be used."""

    def __init__(self, message: str, refused: tuple[Refused, ...] = ()) -> None:
        super().__init__(message)
        self.refused = refused


def calibrate(views: Sequence[View], *, model: str | None = None, bent: bool = False) -> Fit:
    """The lens that made the views; `model` leaves the choice among that model's forms alone, `bent` finds the board's shape too.

    A board that is not what it should be, and yet is taken to be, pulls the lens: by how much is a part of the deviations.
    """
    if len(views) < (fewest := ENOUGH_VIEWS if bent else FEWEST_VIEWS):
        shape = " and the board's shape" if bent else ""
        raise TooFewViewsError(
            f"a lens{shape} needs at least {fewest} views of the board, {len(views)} can be used; take some from other sides"
        )
    candidates = [one for one in CANDIDATES if model in (None, one[0])]
    kept, refused, model, left_out, (numbers, poses, residuals) = _without_outliers(views, candidates)
    std, displacement, if_bent = deviations(kept, model, numbers, poses, residuals), 0.0, None
    if len(kept) >= ENOUGH_VIEWS:
        if_bent = left_out_error(kept, model, numbers, poses, bent=True)
        if bent or if_bent < BENT * min(left_out.values()):
            shaped, by, free = board_shape.fit(kept, model, numbers, poses)
            if bent:
                kept, displacement = shaped, float(np.linalg.norm(by, axis=1).max())
                numbers, poses, residuals = free
                std = deviations(kept, model, numbers, poses, residuals, bent=True)
            else:
                std = np.maximum(std, np.abs(free[0] - numbers))
    return Fit(
        lens=Lens(model=model, numbers=numbers, std=std),
        views=tuple(kept),
        refused=tuple(refused),
        residuals=tuple(residuals),
        rms=rms(np.concatenate(residuals)),
        left_out=left_out,
        left_out_if_bent=if_bent,
        displacement=displacement,
    )


def fitted(views: Sequence[View], model: str, count: int) -> Float[np.ndarray, " p"]:
    """The lens of that many coefficients that explains the views best, without a choice or a doubt."""
    return adjust(views, model, *start(views, model, count))[0]


def reach(views: Sequence[View], numbers: Float[np.ndarray, " p"], rows: int, cols: int) -> float:
    """How far from the principal point corners were observed, relative to the distance of the farthest corner of the picture."""
    centre = numbers[2:4]
    far = max(np.linalg.norm(np.array(corner) - centre) for corner in ((0, 0), (cols, 0), (0, rows), (cols, rows)))
    return float(max(np.linalg.norm(view.corners.points - centre, axis=1).max() for view in views) / far)


def _without_outliers(
    views: Sequence[View], candidates: Sequence[tuple[str, int]]
) -> tuple[list[View], list[Refused], str, dict[str, float], tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]]:
    """The views that one lens explains, those that are refused, the model chosen, its error on views left out, and the fit.

    The fit is the lens, the poses and the residuals.
    """
    kept, refused = list(views), list[Refused]()
    chosen, left_out = choose(kept, candidates)
    while True:
        fit = adjust(kept, chosen[0], *start(kept, *chosen))
        errors = np.array([rms(residual) for residual in fit[2]])
        usual, worst = float(np.median(errors)), int(np.argmax(errors))
        if errors[worst] <= _OUTLYING * usual or len(kept) <= ENOUGH_VIEWS:
            break
        reason = f"its corners do not fit: {errors[worst]:.2f} px, where half of the views have less than {usual:.2f} px"
        reason += "; is the board bent, or covered in part?"
        refused.append(Refused(name=kept.pop(worst).name, reason=reason))
    if refused:
        before = chosen
        chosen, left_out = choose(kept, candidates)
        if chosen != before:
            fit = adjust(kept, chosen[0], *start(kept, *chosen))
    return kept, refused, chosen[0], left_out, fit
