"""Whether a picture can be restored along a motion that is given: it keeps the frame in view, and there is memory for its blur."""

from pathlib import Path

import numpy as np

from rsvideo.config import memory
from rsvideo.config.files import UnreadableError
from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.parallax import Flow

_INSTANTS = 400  # at which a path is looked at
_PLACES = 24  # on either side of the frame, at which a flow is looked at
_BYTES_AN_ENTRY = 24  # of the banded matrices of a blur: the blur, its normal matrix and its factor, complex


def check(path: Path, trajectory: Trajectory, camera: Camera, flow: Flow | None = None) -> None:
    """Refuse a given motion that no picture of this size can be restored from, or for whose blur there is no memory."""
    timing, lens = camera.timing, camera.intrinsics
    fastest = _fastest(flow, max(lens.rows, lens.cols)) if flow else 0.0
    if (drift := fastest * timing.interval[1]) > max(lens.rows, lens.cols):
        raise UnreadableError(f"{path} must keep points in view, it lets them drift by {drift:.0f} px; is it a sidecar that rsvideo wrote?")
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
    blur = shift + turn * along / 2 + fastest * timing.exposure  # px across scanlines, within one exposure
    needed = _BYTES_AN_ENTRY * (along / 2) * (timing.rows + blur) * (blur + 2)
    memory.check(path, f"it blurs pictures of {lens.cols} x {lens.rows} by {blur:.0f} px", needed)


def _fastest(flow: Flow, longer: int) -> float:
    """The largest velocity in px/s, over the frame and at the flow's own points."""
    x, y = np.meshgrid(*[np.linspace(0, longer - 1, _PLACES)] * 2)
    places = np.concatenate([flow.points, np.stack([x, y], axis=-1).reshape(-1, 2)])
    return float(np.linalg.norm(flow.at(places), axis=1).max())
