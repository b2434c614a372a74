"""The motion of a whole clip as a gyroscope's log, joined from the records of its frames a few at a time."""

import math
from collections.abc import Iterable, Iterator

import numpy as np

from rsvideo.config.sidecar import FrameRecord
from rsvideo.physics.camera import Camera
from rsvideo.restoration.movement import joined
from rsvideo.shooting.gcsv import Part

_AT_A_TIME = 16, 0.1  # frames; and seconds, of which there may be more
_AROUND = 2, 0.02  # the same, on either side, that a path depends on
_FEWEST = 4  # samples of a log


def parts(frames: Iterable[FrameRecord], rate: float, camera: Camera) -> Iterator[Part]:
    """The camera's angles over a clip, whose first frame begins at 0 s; nothing of a single frame or of a few milliseconds."""
    begins, pose = None, np.zeros(3)  # of the clip; and of the window's first frame
    most, around = (max(count, math.ceil(seconds * rate)) for count, seconds in (_AT_A_TIME, _AROUND))
    for near, last in _windows(frames, most, around):
        begins = near[0].time_s if begins is None else begins
        steps = np.array([frame.to_next or [0.0] * 3 for frame in near])
        within = [(np.array(frame.trajectory.t_s), frame.trajectory.poses()) for frame in near]
        t, poses = joined(np.array([frame.time_s for frame in near]), within, steps, camera.timing)
        if len(t) < _FEWEST:
            return
        x, y, roll = (pose + poses).T
        angles = np.stack([-y / camera.intrinsics.fy, x / camera.intrinsics.fx, roll], axis=1)
        yield Part(t_s=t - begins, angles=angles, until=(float(t[-1]) if last else near[-around].time_s) - begins)
        pose = pose + steps[: -2 * around].sum(axis=0)


def _windows(frames: Iterable[FrameRecord], most: int, around: int) -> Iterator[tuple[list[FrameRecord], bool]]:
    """`most` frames with those around them, and whether they are the last."""
    near: list[FrameRecord] = []
    for frame in frames:
        near.append(frame)
        if len(near) == most + 2 * around:
            yield near, False
            near = near[-2 * around :]
    if len(near) > 1:
        yield near, True
