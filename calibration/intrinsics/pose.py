"""Where the board stands in each view, under a lens that is given or guessed: the start of the adjustment."""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float
from scipy.optimize import least_squares

from calibration.intrinsics.views import View
from calibration.projection import project

_FOCAL_GUESSES = np.geomspace(0.25, 4, 9)  # of the picture's width: from a fisheye to a long lens
_STEEPEST_RAY = np.radians(85)  # from the axis; farther out, fisheye points are not undistorted
_WIDEST_TANGENT = 20  # of a ray's angle from the axis; beyond, undistorting has failed
_FEWEST_CORNERS = 6  # for a pose
_FAR_OFF = 1e3  # px, the residual of a view or of a corner that the lens cannot explain
_NOWHERE = (0, 0, 0, 0, 0, 1.0)  # the pose that stands for none
_POSE_STEPS = 20  # of Gauss and Newton, when the lens is settled


def start(views: Sequence[View], model: str, count: int) -> tuple[np.ndarray, list[np.ndarray]]:
    """A lens with `count` coefficients of distortion, all 0, and poses: the guess of its focal length that explains the views best."""
    rows, cols = views[0].rows, views[0].cols
    middle = ((cols - 1) / 2, (rows - 1) / 2)
    tried = []
    for focal in _FOCAL_GUESSES * cols:
        numbers = np.concatenate([[focal, focal, *middle], np.zeros(count)])
        fits = [pose(view, model, numbers, steps=1) for view in views]
        tried.append((float(np.median([rms(residual) for _, residual in fits])), numbers, [six for six, _ in fits]))
    _, numbers, poses = min(tried, key=lambda one: one[0])
    return numbers, poses


def pose(
    view: View, model: str, numbers: Float[np.ndarray, " p"], *, steps: int = _POSE_STEPS
) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "n 2"]]:
    """The board's pose (rotation vector, translation in m) under a lens, and the corners' residuals in px."""
    object_points, rays = _rays(view, model, numbers)
    usable = np.isfinite(rays).all(axis=(1, 2)) & (np.abs(rays) < _WIDEST_TANGENT).all(axis=(1, 2))
    none = np.array(_NOWHERE), np.full(view.corners.points.shape, _FAR_OFF)
    if usable.sum() < _FEWEST_CORNERS:
        return none
    try:
        _, turn, shift = cv2.solvePnP(object_points[usable], rays[usable], np.eye(3), None, flags=cv2.SOLVEPNP_ITERATIVE)
    except cv2.error:  # corners that no camera sees so
        return none

    def residual(six: np.ndarray) -> np.ndarray:
        left = project(model, numbers, view.object_points, six)[0] - view.corners.points
        return np.nan_to_num(left, nan=_FAR_OFF, posinf=_FAR_OFF, neginf=-_FAR_OFF).ravel()

    found = least_squares(
        residual,
        np.concatenate([turn.ravel(), shift.ravel()]),
        jac=lambda six: np.nan_to_num(project(model, numbers, view.object_points, six)[1]),  # pyright: ignore[reportArgumentType]
        x_scale="jac",
        max_nfev=steps,
    )
    return found.x, found.fun.reshape(-1, 2)


def rms(residual: Float[np.ndarray, "n 2"]) -> float:
    """The root mean square of distances, px."""
    return float(np.sqrt((residual**2).sum(axis=1).mean()))


def _rays(view: View, model: str, numbers: Float[np.ndarray, " p"]) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 1 2"]]:
    """Corners on the board in metres, and their undistorted rays as (x / z, y / z); of a fisheye, without those far out."""
    K = np.array([[numbers[0], 0, numbers[2]], [0, numbers[1], numbers[3]], [0, 0, 1]])
    points = view.corners.points[:, None]
    if model != "fisheye":
        return view.object_points, cv2.undistortPoints(points, K, numbers[4:])
    inside = np.linalg.norm((view.corners.points - numbers[2:4]) / numbers[:2], axis=1) < _STEEPEST_RAY
    if inside.sum() < _FEWEST_CORNERS:
        return np.zeros((0, 3)), np.zeros((0, 1, 2))
    return view.object_points[inside], cv2.fisheye.undistortPoints(points[inside], K, numbers[4:].reshape(4, 1))
