"""The gyroscope's log that a clip's maker embedded beside the picture."""

from pathlib import Path

import numpy as np

from rsvideo.physics.gyro import MOST_SAMPLES, GyroLog
from rsvideo.video import telemetry
from rsvideo.video.telemetry import UnavailableError


def embedded(path: Path) -> GyroLog:
    """In the camera's axes as far as the reader knows them, from the log's first sample on; UnavailableError if there is none."""
    numbers = np.frombuffer(telemetry.answer(path, "gyroscope", 32 * MOST_SAMPLES))
    table = numbers.reshape(-1, 4)  # ms; degrees/s about Gyroflow's axes
    if len(table) < 2:
        raise UnavailableError(f"{path} must have a gyroscope's log embedded, none is there that telemetry-parser understands")
    x, y, z = np.deg2rad(table[:, 1:]).T
    try:
        return GyroLog(times=(table[:, 0] - table[0, 0]) * 1e-3, rates=np.stack([-y, -x, -z], axis=1))
    except ValueError as error:
        raise UnavailableError(f"{path}: {error}") from error
