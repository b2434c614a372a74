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
    x, y, roll = (*np.ptp(poses, axis=0), 0.0)[:3]
    if x > lens.cols or y > lens.rows or roll > np.pi / 2:
        raise UnreadableError(
            f"{path} must keep in view what a frame of {lens.cols} x {lens.rows} shows, it moves the picture by {x:.0f} x {y:.0f} px"
            f" and turns it by {np.degrees(roll):.0f} degrees; are its angles in degrees, or is focal-px too long?"
        )
    within = np.lib.stride_tricks.sliding_window_view(poses, max(1, round(_INSTANTS * timing.exposure / timing.interval[1])), axis=0)
    across, along = (1, lens.cols) if timing.direction.by_row else (0, lens.rows)
    shift, turn = (*np.ptp(within, axis=-1).max(axis=0)[[across, *range(2, poses.shape[1])]], 0.0)[:2]
    blur = shift + turn * along / 2  # px across scanlines, within one exposure
    needed = _BYTES_AN_ENTRY * (along / 2) * (timing.rows + blur) * (blur + 2)
    memory.check(path, f"it blurs pictures of {lens.cols} x {lens.rows} by {blur:.0f} px", needed)
