"""Whether a picture can be restored along a motion that is given: it keeps the frame in view, and there is memory for its blur."""

from pathlib import Path

import numpy as np

from rsvideo.config import memory
from rsvideo.config.files import UnreadableError
from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Trajectory

_INSTANTS = 400  # at which a path is looked at
_BYTES_AN_ENTRY = 24  # of the banded matrices of a blur: the blur, its normal matrix and its factor, complex


def check(path: Path, trajectory: Trajectory, camera: Camera) -> None:
    """Refuse a given motion that no picture of this size can be restored from, or for whose blur there is no memory."""
    timing, lens = camera.timing, camera.intrinsics
    poses = trajectory.at(np.linspace(*timing.interval, _INSTANTS))
    corner = 0.5 * np.hypot(lens.rows, lens.cols)
    x, y = (np.ptp(poses[:, axis]) + (corner * np.ptp(poses[:, 2]) if poses.shape[1] > 2 else 0.0) for axis in (0, 1))
    if x > lens.cols or y > lens.rows:
        raise UnreadableError(
            f"{path} must keep in view what a frame of {lens.cols} x {lens.rows} shows, it moves the picture by {x:.0f} x {y:.0f} px;"
            " are its angles in degrees, or is focal-px too long?"
        )
    within = np.lib.stride_tricks.sliding_window_view(poses, max(1, round(_INSTANTS * timing.exposure / timing.interval[1])), axis=0)
    blur = float(np.ptp(within, axis=-1)[:, 1 if timing.direction.by_row else 0].max())  # across scanlines, within one exposure
    along = lens.cols if timing.direction.by_row else lens.rows
    needed = _BYTES_AN_ENTRY * (along / 2) * (timing.rows + blur) * (blur + 2)
    memory.check(path, f"it blurs pictures of {lens.cols} x {lens.rows} by {blur:.0f} px", needed)
