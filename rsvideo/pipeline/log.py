"""The motion of a whole clip as a gyroscope's log, joined from the records of its frames a few at a time."""

from collections.abc import Iterable, Iterator

import numpy as np

from rsvideo.config.gcsv import Part
from rsvideo.config.sidecar import FrameRecord
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.restoration import clip

_AT_A_TIME = 16  # frames
_AROUND = 2  # frames on either side that a path depends on


def parts(frames: Iterable[FrameRecord], timing: ShutterTiming, intrinsics: Intrinsics) -> Iterator[Part]:
    """The camera's angles over a clip, whose first frame begins at 0 s; nothing of less than two frames."""
    begins, pose = None, np.zeros(3)  # of the clip; and of the window's first frame
    for near, last in _windows(frames):
        begins = near[0].time_s if begins is None else begins
        steps = np.array([frame.to_next or [0.0] * 3 for frame in near])
        within = [(np.array(frame.trajectory.t_s), frame.trajectory.poses()) for frame in near]
        t, poses = clip.joined(np.array([frame.time_s for frame in near]), within, steps, timing)
        x, y, roll = (pose + poses).T
        angles = np.stack([-y / intrinsics.fy, x / intrinsics.fx, roll], axis=1)
        yield Part(t_s=t - begins, angles=angles, until=(float(t[-1]) if last else near[-_AROUND].time_s) - begins)
        pose = pose + steps[: -2 * _AROUND].sum(axis=0)


def _windows(frames: Iterable[FrameRecord]) -> Iterator[tuple[list[FrameRecord], bool]]:
    """Frames with those around them, and whether they are the last."""
    near: list[FrameRecord] = []
    for frame in frames:
        near.append(frame)
        if len(near) == _AT_A_TIME + 2 * _AROUND:
            yield near, False
            near = near[-2 * _AROUND :]
    if len(near) > 1:
        yield near, True
