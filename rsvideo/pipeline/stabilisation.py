"""A steadier camera: the restored frames shown from a smoothed path, cropped so that no border shows."""

import math
from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from rsvideo.physics.camera import Intrinsics, resampled_at, turned

SMOOTHING = 0.4  # s, standard deviation of the Gaussian that smooths the path
MOST_CROP = 1.25  # the largest enlargement; a path that needs more is smoothed less
_REACH = 4  # standard deviations, at which the Gaussian is cut off, as SciPy does
_LEAST_OVERLAP = 1e-9  # of the frame; a path that is smooth already is divided by this


def corrections(
    steps: Sequence[Sequence[float] | None], rate: float, intrinsics: Intrinsics
) -> tuple[Float[np.ndarray, "frames 3"], float]:
    """How far each restored frame is turned from the camera's pose to the smoothed one, and the enlargement that hides the borders.

    `steps` lead from each frame's pose to the next; None at a cut, across which nothing is smoothed.
    """
    poses = np.zeros((len(steps), 3))
    for k, step in enumerate(steps[:-1]):
        poses[k + 1] = poses[k] + (step or 0.0)
    cuts = [k + 1 for k, step in enumerate(steps[:-1]) if step is None]
    around = math.ceil(_REACH * SMOOTHING * rate)
    turns = np.zeros_like(poses)
    for run, turn in zip(np.split(poses, cuts), np.split(turns, cuts), strict=True):
        longer = np.pad(run, ((around, around), (0, 0)), mode="reflect", reflect_type="odd")  # a pan goes on beyond the run's ends
        turn[:] = gaussian_filter1d(longer, SMOOTHING * rate, axis=0)[around:-around] - run
    most = 1 - 1 / MOST_CROP
    turns = turns * min(1.0, most / max(_overlap(turns, intrinsics), _LEAST_OVERLAP))
    return turns, 1 / (1 - min(_overlap(turns, intrinsics), most))


def _overlap(turns: Float[np.ndarray, "frames 3"], intrinsics: Intrinsics) -> float:
    """How far the corners of turned frames reach beyond the frame that is there, as a share of half its side; to first order."""
    rows, cols = intrinsics.rows, intrinsics.cols
    x, y = np.meshgrid([0.0, cols - 1.0], [0.0, rows - 1.0])
    moved = [turned(intrinsics, x, y, np.broadcast_to(t, (2, 2, 3))) for t in turns]
    outward = np.abs(np.array(moved)).max(axis=(0, 1, 2))  # px, columns and rows
    return float((2 * outward / np.array([cols, rows])).max())


def shown(
    pixels: Float[np.ndarray, "rows cols channels"], turn: Float[np.ndarray, "3"], enlargement: float, intrinsics: Intrinsics
) -> Float[np.ndarray, "rows cols channels"]:
    """The frame as a camera turned by `turn` sees it, enlarged about its centre (Lanczos)."""
    if math.isclose(enlargement, 1) and not turn.any():
        return pixels
    rows, cols = pixels.shape[:2]
    x, y = np.meshgrid(np.arange(cols, dtype=float), np.arange(rows, dtype=float))
    x, y = (x - (cols - 1) / 2) / enlargement + (cols - 1) / 2, (y - (rows - 1) / 2) / enlargement + (rows - 1) / 2
    at = resampled_at(intrinsics, turn, x, y).astype(np.float32)
    out = cv2.remap(pixels, at[..., 0], at[..., 1], cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE)
    return np.clip(out, 0, 1).reshape(pixels.shape)
