"""Where corners appear through a lens, and how that changes with the lens and with where they stand."""

import cv2
import numpy as np
from jaxtyping import Float


def project(
    model: str, numbers: Float[np.ndarray, " p"], at: Float[np.ndarray, "n 3"], pose: Float[np.ndarray, "6"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "two_n 6"], Float[np.ndarray, "two_n p"]]:
    """Where corners appear, and the derivatives in the pose (rotation vector, translation) and in the lens."""
    matrix = np.array([[numbers[0], 0, numbers[2]], [0, numbers[1], numbers[3]], [0, 0, 1]])
    turn, shift = pose[:3].reshape(3, 1), pose[3:].reshape(3, 1)
    if model == "fisheye":
        points, J = cv2.fisheye.projectPoints(at[:, None], turn, shift, matrix, numbers[4:].reshape(4, 1))
        return points.reshape(-1, 2), J[:, 8:14], J[:, :8]
    points, J = cv2.projectPoints(at, turn, shift, matrix, numbers[4:])[:2]
    return points.reshape(-1, 2), J[:, :6], J[:, 6 : 10 + len(numbers) - 4]
