"""Lens and poses by elimination, against the dense problem written out."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from scipy.optimize import least_squares

from calibration.intrinsics.bundle_adjustment import adjust
from calibration.intrinsics.views import View
from calibration.projection import project
from tests.calibration.test_lens_fit import TRUTH, made


def pose(view: View, model: str, numbers: np.ndarray) -> np.ndarray:
    """Near where the board was."""
    C = np.array([[numbers[0], 0, numbers[2]], [0, numbers[1], numbers[3]], [0, 0, 1]])
    undistorted = cv2.fisheye.undistortPoints if model == "fisheye" else cv2.undistortPoints
    rays = undistorted(view.corners.points[:, None], C, numbers[4:])
    _, turn, shift = cv2.solvePnP(view.object_points, rays, np.eye(3), None)
    return np.concatenate([turn.ravel(), shift.ravel()])


@pytest.mark.parametrize("model", ["brown-conrady", "fisheye"])
def test_the_minimum_is_that_of_the_dense_problem(model: str) -> None:
    views = [replace(view, weight=0.2 + 0.2 * n) for n, view in enumerate(made(model, 6))]
    truth, p = TRUTH[model], 8
    poses = [pose(view, model, truth) for view in views]

    def residual(unknown: np.ndarray) -> np.ndarray:
        each = zip(views, unknown[p:].reshape(-1, 6), strict=True)
        return np.concatenate(
            [np.sqrt(v.weight) * (project(model, unknown[:p], v.object_points, q)[0] - v.corners.points).ravel() for v, q in each]
        )

    dense = least_squares(residual, np.concatenate([truth, *poses]), x_scale="jac", xtol=1e-12, ftol=1e-14)
    numbers, poses, residuals = adjust(views, model, truth * np.repeat([1.02, 0.8], 4), poses)
    np.testing.assert_allclose(numbers[:4], dense.x[:4], atol=5e-3)
    np.testing.assert_allclose(np.concatenate(poses), dense.x[p:], atol=1e-4)
    assert sum(v.weight * np.sum(r**2) for v, r in zip(views, residuals, strict=True)) == pytest.approx(2 * dense.cost, rel=1e-7)
