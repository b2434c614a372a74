"""From a gyroscope's log to the path of a frame."""

import math
from array import array
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline
from scipy.spatial.transform import Rotation

from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.trajectory import Spline, Trajectory, fit

FASTEST = 40.0  # rad/s; the widest range of a phone's gyroscope is 2000 degrees/s = 35 rad/s
MOST_SAMPLES = 5_000_000  # a day at 58 Hz, an hour at 1400 Hz
LONGEST = 20.0  # s; the longest exposure and readout together
SHORTEST_STEP, LONGEST_STEP = 2e-5, 0.1  # s between samples: 50,000 Hz is beyond all sensors, 10 Hz shows no hand shake
LONGEST_LOG_NS = 10**16  # ns, 116 days: times so far apart are no nanoseconds of one log
WIDEST_GAP = 20  # steps; a log that lacks more samples in a row says too little of what lies between; origin: by trial
_HALF_STEPS, _MORE_STEPS = 4, 16  # half of the integration steps for each of the log's samples, and steps beyond; origin: by trial


@dataclass(frozen=True, kw_only=True, eq=False)
class GyroLog:
    """Angular rates in the camera's axes: x to the right, y down, z forward, each turning right-handedly."""

    times: Float[np.ndarray, " samples"]  # seconds from the first sample
    rates: Float[np.ndarray, "samples 3"]  # rad/s: pitch, yaw, roll

    def __post_init__(self) -> None:
        if len(self.times) < 2:
            raise ValueError(f"a gyro log needs at least 2 samples, got {len(self.times)}")
        if not (np.isfinite(self.times).all() and np.isfinite(self.rates).all()):
            raise ValueError("a gyro log must hold finite numbers, got nan or inf")
        late = np.flatnonzero(np.diff(self.times) <= 0)
        if len(late):
            raise ValueError(f"times of a gyro log must increase, sample {late[0] + 2} is not after the one before it")
        step = float(np.median(np.diff(self.times)))
        if not SHORTEST_STEP <= step <= LONGEST_STEP:
            raise ValueError(
                f"a gyro log has between 10 and 50000 samples a second, got one every {step:.3g} s; are its times in nanoseconds?"
            )
        fastest = float(np.abs(self.rates).max())
        if fastest > FASTEST:
            raise ValueError(f"rates of a gyro log must be below {FASTEST:g} rad/s, got {fastest:.3g}; are they in degrees per second?")

    @property
    def step(self) -> float:
        """Seconds between samples, the median."""
        return float(np.median(np.diff(self.times)))


def parse(lines: Iterable[str], *, axes: str = "XYZ") -> GyroLog:
    """A log of lines `t_ns wx wy wz` (blanks or commas; one header line and # comments are passed over).

    `axes` names the gyroscope's axis that lies along the camera's x (right), y (down) and z (forward); a small letter
    is the opposite sense. A phone held upright for a picture in portrait with its back camera has "Xyz".
    """
    check_axes(axes)
    stamps, rates = array("q"), array("d")
    for number, line in enumerate(lines, 1):
        fields = line.split("#", 1)[0].replace(",", " ").split()
        if not fields or (not stamps and _is_header(fields)):
            continue
        try:
            stamp, wx, wy, wz = fields
            stamps.append(int(stamp) if stamp.lstrip("+-").isdecimal() else round(float(stamp)))
            rates.extend((float(wx), float(wy), float(wz)))
        except (ValueError, OverflowError):
            raise ValueError(f"line {number} of a gyro log must be `t_ns wx wy wz`, got {line[:60]!r}") from None
        if len(stamps) > MOST_SAMPLES:
            raise ValueError(f"a gyro log has at most {MOST_SAMPLES} samples")
    if not stamps:
        raise ValueError("the gyro log is empty; its lines are `t_ns wx wy wz`")
    if max(stamps) - min(stamps) > LONGEST_LOG_NS:
        raise ValueError(f"a gyro log spans at most {LONGEST_LOG_NS} ns, got {max(stamps) - min(stamps)}; are its times in nanoseconds?")
    times = (np.frombuffer(stamps, np.int64) - stamps[0]).astype(float) * 1e-9
    return facing(GyroLog(times=times, rates=np.frombuffer(rates).reshape(-1, 3)), axes)


def facing(log: GyroLog, axes: str) -> GyroLog:
    """A gyroscope's log in the camera's axes; see `parse`."""
    return replace(log, rates=log.rates @ camera_from_gyro(axes).T)


def camera_from_gyro(axes: str) -> Float[np.ndarray, "3 3"]:
    """The signed permutation that `axes` names; see `parse`."""
    check_axes(axes)
    return np.array([[(1.0 if letter.isupper() else -1.0) * (letter.upper() == axis) for axis in "XYZ"] for letter in axes])


def check_axes(axes: str) -> None:
    """Refuse what names no axes; see `parse`."""
    if sorted(axes.upper()) != ["X", "Y", "Z"]:
        raise ValueError(f"gyro axes must be X, Y and Z in some order, small letters for the opposite sense, got {axes!r}")


def _is_header(fields: list[str]) -> bool:
    return len(fields) == 4 and all(field[0].isalpha() and field.lower() not in ("nan", "inf", "infinity") for field in fields)


def integrate(log: GyroLog, *, start: float, duration: float, steps: int) -> Float[np.ndarray, "times 3"]:
    """Rotation vectors (pitch, yaw, roll) from the middle of [start, start + duration] to its `steps` + 1 equidistant times.

    A vector v stands for R = exp([v]_x), which takes a ray of the camera at that time to the ray in the camera of the
    middle; body rates w give dR/dt = R [w]_x. Rates are linear between samples.
    """
    if not (math.isfinite(duration) and 0 < duration <= LONGEST):
        raise ValueError(f"a frame's interval must lie in (0, {LONGEST:g}] s, got {duration:g} s; is it in milliseconds?")
    if not (math.isfinite(start) and start >= 0 and start + duration <= log.times[-1]):
        raise ValueError(f"the frame at {start:g} s of {duration:g} s must lie within the gyro log, which is {log.times[-1]:.6g} s long")
    first = np.searchsorted(log.times, start, side="right") - 1
    last = np.searchsorted(log.times, start + duration, side="left")
    widest = float(np.diff(log.times[first : last + 1]).max())
    if widest > WIDEST_GAP * log.step:
        raise ValueError(f"the gyro log has a gap of {widest:.3g} s near {start:g} s; choose another start")
    dt = duration / steps
    middles = start + (np.arange(steps) + 0.5) * dt
    turns = Rotation.from_rotvec(dt * np.stack([np.interp(middles, log.times, log.rates[:, i]) for i in range(3)], axis=1))
    pose = Rotation.identity()
    poses = [pose]
    for turn in turns:
        pose = pose * turn
        poses.append(pose)
    path = Rotation.concatenate(poses)
    return (path[steps // 2].inv() * path).as_rotvec()


def integrals(log: GyroLog) -> CubicHermiteSpline:
    """Of pitch, yaw and roll rate from the log's beginning, each by itself, as functions of time.

    Over the angles of a frame or between neighbours, differences are rotation vectors in the camera of that time, to first order.
    """
    gaps = np.diff(log.times)[:, None]
    so_far = np.vstack([np.zeros(3), np.cumsum(0.5 * gaps * (log.rates[1:] + log.rates[:-1]), axis=0)])
    return CubicHermiteSpline(log.times, so_far, log.rates)


def path(log: GyroLog, *, camera: Intrinsics, start: float, duration: float) -> Trajectory:
    """The path of a frame whose first scanline opens `start` seconds into the log, with its origin at the middle."""
    steps = 2 * math.ceil(_HALF_STEPS * duration / log.step) + _MORE_STEPS
    angles = integrate(log, start=start, duration=duration, steps=steps)
    return spline_through(poses_from_angles(angles, camera=camera), duration=duration, spacing=log.step / 2)


def spline_through(poses: Float[np.ndarray, "n axes"], *, duration: float, spacing: float) -> Trajectory:
    """The spline over [0, duration] nearest to equidistant poses, with a knot every `spacing` seconds or nearly so."""
    pieces = max(1, min(math.ceil(duration / spacing), len(poses) // 2 - 3))
    blank = Spline(t0=0.0, t1=duration, coefficients=np.zeros((pieces + 3, poses.shape[1])))
    return fit(blank, np.linspace(0, duration, len(poses)), poses)


def poses_from_angles(angles: Float[np.ndarray, "n 3"], *, camera: Intrinsics) -> Float[np.ndarray, "n 3"]:
    """Poses (x_px, y_px, roll_rad) of angles (pitch, yaw, roll) in rad."""
    return np.stack([camera.fx * angles[:, 1], -camera.fy * angles[:, 0], angles[:, 2]], axis=1)


def angles_from_poses(poses: Float[np.ndarray, "n axes"], *, camera: Intrinsics) -> Float[np.ndarray, "n 3"]:
    """Angles (pitch, yaw, roll) in rad of poses (x_px, y_px[, roll_rad]); without a third column roll is 0."""
    roll = poses[:, 2] if poses.shape[1] == 3 else np.zeros(len(poses))
    return np.stack([-poses[:, 1] / camera.fy, poses[:, 0] / camera.fx, roll], axis=1)
