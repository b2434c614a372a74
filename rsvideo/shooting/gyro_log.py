"""Gyroscopes' logs, whatever kind of file they are: .gcsv, sampled angles as CSV, or lines `t_ns wx wy wz` as phones write them."""

from dataclasses import dataclass
from pathlib import Path

from rsvideo.config.files import UnreadableError, lines
from rsvideo.physics.gyro import MOST_SAMPLES, GyroLog, parse
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.shooting import gcsv, given_motion

FEWEST_SAMPLES = 4  # of angles, for a cubic spline through them


@dataclass(frozen=True, kw_only=True, eq=False)
class ClipLog:
    """A gyroscope's log of a clip, and its offset against the clip."""

    log: GyroLog
    offset: float | None  # s, what a clip's time becomes the log's by adding; None where the file does not say


def read(path: Path, timing: ShutterTiming) -> ClipLog:
    """The log in a file, for a clip of that timing."""
    first = next((line for line in lines(path, most=gcsv.MOST_BYTES) if line.strip()), "")
    if first.strip() in gcsv.FIRST_LINES:
        return ClipLog(log=gcsv.read(path).log, offset=-timing.middle)  # where Gyroflow lets a log begin
    try:
        if first.split(",")[0].strip() == given_motion.COLUMNS[0]:
            return _angles(path)
        return ClipLog(log=parse(lines(path, most=gcsv.MOST_BYTES)), offset=None)
    except UnreadableError:
        raise
    except ValueError as error:
        raise UnreadableError(f"{path}: {error}") from error


def _angles(path: Path) -> ClipLog:
    """Of sampled angles; their time 0 is the clip's."""
    t, turned = given_motion.angles(path)
    if not FEWEST_SAMPLES <= len(t) <= MOST_SAMPLES:
        raise ValueError(f"angles must be {FEWEST_SAMPLES} to {MOST_SAMPLES} samples, got {len(t)}")
    return ClipLog(log=GyroLog(times=t - t[0], rates=gcsv.rates(t, turned, t)), offset=0.0 - float(t[0]))
