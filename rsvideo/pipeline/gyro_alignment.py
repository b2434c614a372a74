"""A gyroscope's log of a clip or a photograph: read from a file or from the clip itself, and laid along it."""

from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsvideo.baselines import gyro
from rsvideo.config.request import Motion
from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera
from rsvideo.physics.gyro import GyroLog
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration import clip_motion
from rsvideo.restoration.clip_motion import Run
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import gyro_log
from rsvideo.shooting.gyro_log import ClipLog
from rsvideo.video import gyroscope
from rsvideo.video.telemetry import UnavailableError

LOOKED_AT = 60  # frames that a log's place is found with


@dataclass(frozen=True, kw_only=True, eq=False)
class Gyro:
    """A log in its place."""

    log: GyroLog
    offset: float
    axes: str
    note: str

    def within(self, camera: Camera) -> Trajectory:
        """The motion of a photograph, whose first scanline opens at time 0."""
        (path,) = self.movement(np.zeros(1), camera).within
        assert path is not None
        return path

    def check_cover(self, begins: np.ndarray, timing: ShutterTiming) -> None:
        """Refuse a log that does not reach over frames that begin at `begins` seconds."""
        gyro.check_cover(self.log, begins, timing, self.offset)

    def movement(self, begins: np.ndarray, camera: Camera) -> Movement:
        """The motion of frames that begin at `begins` seconds."""
        return gyro.movement(self.log, begins, camera, offset=self.offset, axes=self.axes)

    def refined(self, run: Run) -> Movement:
        """The same, corrected by what the frames show."""
        return gyro.refined(self.log, run, offset=self.offset, axes=self.axes)


def read(stated: Motion, source: Path, timing: ShutterTiming) -> ClipLog:
    """The log; raises UnreadableError, or ValueError where there is none."""
    if stated.gyro is not None:
        return gyro_log.read(stated.gyro, timing)
    try:
        return ClipLog(log=gyroscope.embedded(source), offset=None)
    except UnavailableError as error:
        raise ValueError(f"--gyro must name a log, {source} holds none that can be read: {error}") from error


def placed(stated: Motion, found: ClipLog, frames: Iterable[Frame], camera: Camera, settings: Settings) -> Gyro:
    """The log laid along a clip; what neither the request nor the file states is found from the first LOOKED_AT of its `frames`."""
    offset = found.offset if stated.gyro_offset is None else stated.gyro_offset
    axes = stated.gyro_axes or ("XYZ" if found.offset is not None else None)
    if offset is not None and axes is not None:
        return Gyro(log=found.log, offset=offset, axes=axes, note=f"gyroscope: offset {offset:.4g} s, axes {axes}")
    run = clip_motion.gather(frames, camera, settings, blur=False)
    at = gyro.aligned(found.log, run, offset=offset, axes=axes)
    note = (
        f"gyroscope: offset {at.offset:.4f} +- {at.spread:.4f} s, axes {at.axes}, by how the picture moves"
        f" ({at.residual:.2g} of {at.moved:.2g} px remain)"
    )
    return Gyro(log=found.log, offset=at.offset, axes=at.axes, note=note)


def of_photograph(stated: Motion, source: Path, timing: ShutterTiming) -> Gyro:
    """The log of one frame, of which nothing can be found from how the picture moves."""
    found = read(stated, source, timing)
    offset = found.offset if stated.gyro_offset is None else stated.gyro_offset
    if offset is None:
        raise ValueError(f"--gyro-offset must say at which of its seconds {stated.gyro} the first row of {source} opens")
    return Gyro(log=found.log, offset=offset, axes=stated.gyro_axes or "XYZ", note="")
