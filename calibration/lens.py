"""The lens from views of a board: pinhole and distortion by least squares, chosen by the views that were left out.

Corner j of view v lies at X_j on the board and is seen at x_vj = project(lens; R_v X_j + t_v) + noise. Lens and poses are found together;
the noise is taken to be the same in every direction. Where the board is not what it should be, X_j is found too.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from calibration import bent as shape
from calibration.adjust import adjust
from calibration.projection import project
from calibration.views import Refused, View

FEWEST = 3  # views; fewer do not fix a lens
ENOUGH = 8
BENT = 0.9  # a board off whose corners' places bring the error of views that were left out below this part is not what its name says
_CANDIDATES = (("brown-conrady", 4), ("fisheye", 4), ("brown-conrady", 5), ("brown-conrady", 8))  # the simpler first
_BETTER = 0.98  # a lens of more freedom must bring the error of views that were left out below this part
_FOLDS = 5
_ROUNDS = 6  # of lens and board in turns; the last one moves the principal point by a tenth of its deviation
_ODD = 3.0  # a view whose error is that many times the median does not show the board as it is
_STEEPEST = np.radians(85)  # from the axis, where the start looks for poses


@dataclass(frozen=True, kw_only=True, eq=False)
class Lens:
    """A lens and its uncertainty, in OpenCV's models and order."""

    model: str  # "brown-conrady" or "fisheye"
    numbers: Float[np.ndarray, " p"]  # fx, fy, cx, cy, then the coefficients of distortion
    std: Float[np.ndarray, " p"]

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
    residuals: tuple[Float[np.ndarray, "_ 2"], ...]  # px, computed less seen, of each view
    rms: float  # px, of the distance
    left_out: dict[str, float]  # px, of views not used for the fit, by candidate
    bent: float | None  # px, the same of the chosen lens if corners may lie off their places on the board; None: too few views
    off: float  # metres, how far the farthest corner does; 0: taken to lie where it should


def calibrate(views: Sequence[View], *, model: str | None = None, bent: bool = False) -> Fit:
    """The lens that the views tell of; `model` leaves the choice among that model's forms alone, `bent` finds the board's shape too.

    A board that is not what it should be, and yet is taken to be, pulls the lens: by how much is a part of the deviations.
    """
    if len(views) < (fewest := ENOUGH if bent else FEWEST):
        shape = " and the board's shape" if bent else ""
        raise ValueError(f"a lens{shape} needs at least {fewest} views of the board, {len(views)} can be used; take some from other sides")
    kept, refused = list(views), list[Refused]()
    candidates = [one for one in _CANDIDATES if model in (None, one[0])]
    chosen, left_out = _choose(kept, candidates)
    while True:
        numbers, poses, residuals = adjust(kept, chosen[0], *_start(kept, *chosen))
        errors = np.array([_rms(residual) for residual in residuals])
        usual, worst = float(np.median(errors)), int(np.argmax(errors))
        if errors[worst] <= _ODD * usual or len(kept) <= ENOUGH:
            break
        why = f"its corners do not fit: {errors[worst]:.2f} px, where half of the views have less than {usual:.2f} px"
        why += "; is the board bent, or covered in part?"
        refused.append(Refused(name=kept.pop(worst).name, why=why))
    if refused:
        chosen_before = chosen
        chosen, left_out = _choose(kept, candidates)
        if chosen != chosen_before:
            numbers, poses, residuals = adjust(kept, chosen[0], *_start(kept, *chosen))
    std, off, error = _deviations(kept, chosen[0], numbers, poses, residuals), 0.0, None
    if len(kept) >= ENOUGH:
        error = _left_out(kept, chosen[0], numbers, poses, bent=True)
        if bent or error < BENT * min(left_out.values()):
            shaped, by, free = _fit_bent(kept, chosen[0], numbers, poses)
            if bent:
                kept, off = shaped, float(np.linalg.norm(by, axis=1).max())
                numbers, poses, residuals = free
                std = _deviations(kept, chosen[0], numbers, poses, residuals, bent=True)
            else:
                std = np.maximum(std, np.abs(free[0] - numbers))
    return Fit(
        lens=Lens(model=chosen[0], numbers=numbers, std=std),
        views=tuple(kept),
        refused=tuple(refused),
        residuals=tuple(residuals),
        rms=_rms(np.concatenate(residuals)),
        left_out=left_out,
        bent=error,
        off=off,
    )


def fitted(views: Sequence[View], model: str, count: int) -> Float[np.ndarray, " p"]:
    """The lens of that many coefficients that explains the views best, without a choice or a doubt."""
    return adjust(views, model, *_start(views, model, count))[0]


def reach(views: Sequence[View], numbers: Float[np.ndarray, " p"], rows: int, cols: int) -> float:
    """How far from the principal point corners were seen, as part of the way to the farthest corner of the picture."""
    centre = numbers[2:4]
    far = max(np.linalg.norm(np.array(corner) - centre) for corner in ((0, 0), (cols, 0), (0, rows), (cols, rows)))
    return float(max(np.linalg.norm(view.seen.points - centre, axis=1).max() for view in views) / far)


def _rms(residual: Float[np.ndarray, "n 2"]) -> float:
    return float(np.sqrt((residual**2).sum(axis=1).mean()))


def _choose(views: Sequence[View], candidates: Sequence[tuple[str, int]]) -> tuple[tuple[str, int], dict[str, float]]:
    """The simplest lens that does as well as any on views that it was not fitted to."""
    folds = min(_FOLDS, len(views))
    if len(views) - -(-len(views) // folds) < FEWEST:
        return candidates[0], {}
    errors = {}
    for model, count in candidates:
        whole, poses, _ = adjust(views, model, *_start(views, model, count))
        if np.isfinite(error := _left_out(views, model, whole, poses)):
            errors[(model, count)] = error
    if not errors:
        raise ValueError("no lens explains these views; is --board what was filmed, and flat?")
    best = min(errors.values())
    chosen = next(one for one, error in errors.items() if _BETTER * error <= best)
    return chosen, {_named(*one): error for one, error in errors.items()}


def _left_out(
    views: Sequence[View], model: str, whole: Float[np.ndarray, " p"], poses: Sequence[np.ndarray], *, bent: bool = False
) -> float:
    """The error of views that took no part in the fit, px."""
    folds, squares = min(_FOLDS, len(views)), []
    for fold in range(folds):
        kept = [number for number in range(len(views)) if number % folds != fold]
        start = [views[number] for number in kept], model, whole, [poses[number] for number in kept]
        left = list(views[fold::folds])
        if bent:
            _, by, (numbers, _, _) = _fit_bent(*start)
            left = shape.moved(left, by)
        else:
            numbers, _, _ = adjust(*start)
        squares += [np.sum(_pose(view, model, numbers)[1] ** 2, axis=1) for view in left]
    return float(np.sqrt(np.concatenate(squares).mean()))


def _named(model: str, count: int) -> str:
    return model if model == "fisheye" else f"{model} of {count}"


def _fit_bent(
    views: Sequence[View], model: str, numbers: Float[np.ndarray, " p"], poses: Sequence[np.ndarray]
) -> tuple[list[View], np.ndarray, tuple[np.ndarray, list[np.ndarray], list[np.ndarray]]]:
    """The same with the board's corners unknown too: the views with corners moved, by how much, and the fit to them."""
    shaped, by = list(views), np.zeros((1, 3))
    numbers, poses, residuals = adjust(views, model, numbers, poses)
    for _ in range(_ROUNDS):
        by = shape.moves(views, shaped, model, numbers, poses, residuals)
        shaped = shape.moved(views, by)
        numbers, poses, residuals = adjust(shaped, model, numbers, poses)
    return shaped, by, (numbers, poses, residuals)


def _start(views: Sequence[View], model: str, count: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """The focal length without distortion, of several, under which the board's poses explain the views best."""
    rows, cols = views[0].rows, views[0].cols
    middle = ((cols - 1) / 2, (rows - 1) / 2)
    tried = []
    for focal in np.geomspace(0.25, 4, 9) * cols:
        numbers = np.concatenate([[focal, focal, *middle], np.zeros(count)])
        fits = [_pose(view, model, numbers, steps=1) for view in views]
        tried.append((float(np.median([_rms(residual) for _, residual in fits])), numbers, [pose for pose, _ in fits]))
    _, numbers, poses = min(tried, key=lambda one: one[0])
    return numbers, poses


def _pose(
    view: View, model: str, numbers: Float[np.ndarray, " p"], *, steps: int = 20
) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "n 2"]]:
    """The board's pose under a lens, and what is left of the corners."""
    matrix = np.array([[numbers[0], 0, numbers[2]], [0, numbers[1], numbers[3]], [0, 0, 1]])
    points = view.seen.points[:, None]
    if model == "fisheye":
        angles = np.linalg.norm((view.seen.points - numbers[2:4]) / numbers[:2], axis=1)
        points = points[angles < _STEEPEST]
        at = view.at[angles < _STEEPEST]
        rays = cv2.fisheye.undistortPoints(points, matrix, numbers[4:].reshape(4, 1)) if len(at) >= 6 else np.zeros((0, 1, 2))
    else:
        at, rays = view.at, cv2.undistortPoints(points, matrix, numbers[4:])
    seen = np.isfinite(rays).all(axis=(1, 2)) & (np.abs(rays) < 20).all(axis=(1, 2))
    if seen.sum() < 6:
        return np.array([0, 0, 0, 0, 0, 1.0]), np.full(view.seen.points.shape, 1e3)
    try:
        _, turn, shift = cv2.solvePnP(at[seen], rays[seen], np.eye(3), None, flags=cv2.SOLVEPNP_ITERATIVE)
    except cv2.error:  # corners that no camera sees so
        return np.array([0, 0, 0, 0, 0, 1.0]), np.full(view.seen.points.shape, 1e3)
    pose = np.concatenate([turn.ravel(), shift.ravel()])
    found = least_squares(
        lambda six: np.nan_to_num(project(model, numbers, view.at, six)[0] - view.seen.points, nan=1e3, posinf=1e3, neginf=-1e3).ravel(),
        pose,
        jac=lambda six: np.nan_to_num(project(model, numbers, view.at, six)[1]),  # pyright: ignore[reportArgumentType]
        x_scale="jac",
        max_nfev=steps,
    )
    return found.x, found.fun.reshape(-1, 2)


def _deviations(
    views: Sequence[View],
    model: str,
    numbers: np.ndarray,
    poses: Sequence[np.ndarray],
    residuals: Sequence[np.ndarray],
    *,
    bent: bool = False,
) -> Float[np.ndarray, " p"]:
    """Standard deviations of the lens, the poses being unknown too, and with `bent` the places of the board's corners.

    Once from the residuals' size as if all corners erred by themselves, and once from how far the views pull the lens in different
    directions (a board that is not flat errs alike over a whole view); the larger of the two.
    """
    p, corners = len(numbers), shape.corners(views) if bent else 0
    S = np.diag(np.repeat([0.0, shape.stiffness(views, residuals)], [p, 3 * corners]))
    pulls, squares, count = np.zeros((len(views), len(S))), 0.0, -len(S)
    for number, (view, pose, residual) in enumerate(zip(views, poses, residuals, strict=True)):
        _, by_pose, by_all = project(model, numbers, view.at, pose)
        if bent:
            by_all = np.hstack([by_all, shape.derivative(view, model, numbers, pose, corners)])
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
