"""A frame at half the resolution, and a picture brought back from there.

What a blur of many pixels has destroyed at the finest scale no solver brings back, and the work for a latent image grows with the
square of the blur's length.
"""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float, Shaped

from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.scanlines import View

WHOLE_REACH = 60.0  # px of blur, beyond which a frame is solved for at half the resolution
SMALLEST = 160  # px, the shorter side that half the resolution must have


def too_long(view: View, length: float) -> bool:
    """Whether a blur of `length` px is solved for at half the resolution."""
    return length > WHOLE_REACH and min(view.pixels.shape[:2]) >= 2 * SMALLEST


def halved(view: View) -> View:
    """Means of two by two pixels; an odd last row or column is left out."""
    camera = view.camera.halved()
    rows, cols = camera.intrinsics.rows, camera.intrinsics.cols
    pixels = halved_image(view.pixels).reshape(rows, cols, -1)
    clipped = view.clipped[: 2 * rows, : 2 * cols].reshape(rows, 2, cols, 2, -1).any(axis=(1, 3))
    return replace(view, pixels=pixels, clipped=clipped, camera=camera)


def halved_image(image: Shaped[np.ndarray, "rows cols *channels"]) -> Shaped[np.ndarray, "r c *_"]:
    """The same of an image alone."""
    rows, cols = (side // 2 for side in image.shape[:2])
    return np.asarray(cv2.resize(image[: 2 * rows, : 2 * cols], (cols, rows), interpolation=cv2.INTER_AREA))


def pose_factors(scale: float, axes: int) -> Float[np.ndarray, " axes"]:
    """What a pose is multiplied with in a frame `scale` times as large: (x, y) or (x, y, roll)."""
    return np.array([scale, scale, 1])[:axes]


def halved_path(path: Trajectory) -> Trajectory:
    """The path in px of the halved frame."""
    return path.with_coefficients(path.coefficients * pose_factors(0.5, path.coefficients.shape[1]))


def doubled(image: Float[np.ndarray, "rows cols channels"], like: Float[np.ndarray, "all_rows all_cols channels"]) -> np.ndarray:
    """A picture of a halved frame in the size of that frame, by cubic interpolation."""
    rows, cols, channels = image.shape
    large = cv2.resize(image, (2 * cols, 2 * rows), interpolation=cv2.INTER_CUBIC).reshape(2 * rows, 2 * cols, channels)
    return np.pad(large, ((0, like.shape[0] - 2 * rows), (0, like.shape[1] - 2 * cols), (0, 0)), mode="edge")
