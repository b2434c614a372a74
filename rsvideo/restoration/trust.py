"""How far a restoration is to be followed: only where the blur is long enough, and where the path is in focus.

s, the focus along the path (restoration.focus), scatters about 0 along a wrong path, or one cut to a wrong exposure, and is positive
along a true one. It is measured twice: over the frames of a run, whose path was found without blur; and about each pixel.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float

from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.focus import focus_map
from rsvideo.restoration.scene import Scene, reduced

SHORT, LONG = 1.5, 3.0  # px of blur within an exposure: up to the first, deblurring gains nothing; from the second on it is done in full
OUT_OF_FOCUS, IN_FOCUS = -0.002, 0.003  # s of a region; origin: by trial on real scenes
REGION = 0.25  # of the frame's shorter side: the region about a pixel over which s is measured
FULL_VOTE = 0.005  # s of a frame, beyond which it hardly counts more, so that no frame outweighs many; origin: by trial
CHANCE, CERTAIN = 1.3, 1.7  # standard deviations of a sum of votes that scatter about 0: up to the first, a run's focus may be chance


def run_share(focuses: Sequence[float]) -> float:
    """The share of restorations, 0 to 1, that the focus of a run's frames grants; fewer than two blurred frames grant none."""
    votes = np.tanh(np.array(focuses) / FULL_VOTE)
    scatter = float(np.sqrt(np.sum(votes**2)))
    return float(np.clip((votes.sum() / scatter - CHANCE) / (CERTAIN - CHANCE), 0, 1)) if scatter else 0.0


def trust(scene: Scene, path: Trajectory, length: float) -> Float[np.ndarray, "rows cols"]:
    """The share of the restoration along a path whose blur is `length` px long, 0 to 1, smooth over the frame."""
    rows, cols = scene.frame.shape
    if length <= SHORT:
        return np.zeros((rows, cols), np.float32)
    scene = reduced(scene, length)
    focus = focus_map(scene, path, REGION * min(scene.frame.shape))
    share = np.clip((focus - OUT_OF_FOCUS) / (IN_FOCUS - OUT_OF_FOCUS), 0, 1) * min((length - SHORT) / (LONG - SHORT), 1)
    return cv2.resize(share.astype(np.float32), (cols, rows), interpolation=cv2.INTER_LINEAR)
