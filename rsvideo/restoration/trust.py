"""How far a frame's restoration is to be followed at each pixel: only where its blur is long enough, and where the path is in focus."""

import cv2
import numpy as np
from jaxtyping import Float

from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.focus import focus_map
from rsvideo.restoration.scene import Scene, reduced

SHORT, LONG = 1.5, 3.0  # px of blur within an exposure: up to the first, deblurring gains nothing; from the second on it is done in full
OUT_OF_FOCUS, IN_FOCUS = 0.001, 0.005  # s of a region; origin: by trial
REGION = 0.25  # of the frame's shorter side: the region about a pixel over which s is measured


def trust(scene: Scene, path: Trajectory, length: float) -> Float[np.ndarray, "rows cols"]:
    """The share of the restoration along a path whose blur is `length` px long, 0 to 1, smooth over the frame."""
    rows, cols = scene.frame.shape
    if length <= SHORT:
        return np.zeros((rows, cols), np.float32)
    scene = reduced(scene)
    focus = focus_map(scene, path, REGION * min(scene.frame.shape))
    share = np.clip((focus - OUT_OF_FOCUS) / (IN_FOCUS - OUT_OF_FOCUS), 0, 1) * min((length - SHORT) / (LONG - SHORT), 1)
    return cv2.resize(share.astype(np.float32), (cols, rows), interpolation=cv2.INTER_LINEAR)
