"""Which part of a photograph a moving camera can record, and the motions to move it by."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from rsvideo.physics import gyro
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.gyro import GyroLog
from rsvideo.physics.shake import STEADY, shake
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.simulate import extent, margin, scaled_to
from rsvideo.physics.trajectory import Trajectory, centred, fit, still

SMALLEST = 16  # px, either side of a frame
_SAME_SHAPE = 0.005  # of the ratio of columns to rows, which whole pixels may change
MOST_TERMS = 31  # coefficients of an axis; rounding spoils polynomials of higher degree; origin: by trial
_FEWEST_SAMPLES, _SLOWEST, _FASTEST = 64, 2000.0, 100e3  # of a hand over a frame's interval; and Hz; origin: by trial
_KNOT, _FEWEST_KNOTS = 0.0025, 8  # s between a hand's knots, 400 Hz where its spectrum ends below 50; and of an interval; origin: by trial
_FIT_POINTS = 401  # of a frame's interval, at which a stated polynomial is fitted; more than its terms, so that the fit is exact
AXES = ("x", "y", "roll")

Motion = Callable[[Camera], Trajectory]  # how a frame of this camera is moved


@dataclass(frozen=True, kw_only=True, eq=False)
class Stage:
    """A frame in the middle of a photograph, and its motion; the pose at the middle of its interval is the origin."""

    camera: Camera
    trajectory: Trajectory

    @property
    def blur(self) -> float:
        """Px from end to end of the longest streak of any row."""
        return extent(camera=self.camera, trajectory=self.trajectory)


def of_log(log: GyroLog, *, start: float) -> Motion:
    """The motion of a frame that opens `start` seconds into a log."""
    return lambda camera: gyro.path(log, camera=camera.intrinsics, start=start, duration=camera.timing.interval[1])


def hand(seed: int, *, rms: float = STEADY) -> Motion:
    """A random hand-shake; see `shake`."""

    def motion(camera: Camera) -> Trajectory:
        duration = camera.timing.interval[1]
        rate = min(max(_FEWEST_SAMPLES / duration, _SLOWEST), _FASTEST)
        angles = shake(np.random.default_rng(seed), duration, rate, rms=rms)
        poses = gyro.poses_from_angles(angles, camera=camera.intrinsics)
        return gyro.spline_through(poses, duration=(len(poses) - 1) / rate, spacing=min(_KNOT, duration / _FEWEST_KNOTS))

    return motion


def polynomial(terms: Mapping[str, Sequence[float]]) -> Motion:
    """x and y in px and roll in rad, each by its coefficients of 1, u, u^2, ..., where u goes from 0 to 1 over the frame's interval."""
    for axis, coefficients in terms.items():
        if axis not in AXES:
            raise ValueError(f"a polynomial has the axes {', '.join(AXES)}, got {axis!r}")
        if not 1 <= len(coefficients) <= MOST_TERMS or not all(math.isfinite(c) for c in coefficients):
            raise ValueError(f"{axis} of a polynomial must have 1 to {MOST_TERMS} finite coefficients, got {list(coefficients)}")

    def motion(camera: Camera) -> Trajectory:
        interval = camera.timing.interval
        degree = max((len(coefficients) for coefficients in terms.values()), default=1) - 1
        u = np.linspace(0, 1, _FIT_POINTS)
        poses = np.stack([np.polynomial.polynomial.polyval(u, np.array([*terms.get(axis, ()), 0.0])) for axis in AXES], axis=1)
        return fit(still(interval, degree=degree, axes=3), u * interval[1], poses)

    return motion


def stage(
    scene_rows: int,
    scene_cols: int,
    *,
    motion: Motion,
    focal: float | None = None,
    lens: Intrinsics | None = None,
    exposure: float,
    readout: float | None = None,
    row_time: float | None = None,
    direction: Direction = Direction.TOP_TO_BOTTOM,
    frame: tuple[int, int] | None = None,
    roll: bool = True,
    blur: float | None = None,
) -> Stage:
    """The largest frame (or one of the rows and columns of `frame`) in the middle of a scene that never sees past its edges.

    The camera has either a `focal` length in px or a `lens`: a camera of another frame size, whose whole picture the frame then is,
    in its ratio of columns to rows. The shutter has a readout or a row time. `roll` False leaves the roll out, `blur` scales the
    motion to so many pixels.
    """
    if (readout is None) == (row_time is None):
        raise ValueError("a shutter has either a readout or a row time")
    if (focal is None) == (lens is None):
        raise ValueError("a camera has either a focal length or a lens")
    rows, cols = frame or (scene_rows, scene_cols)
    if lens and frame and abs(rows * lens.cols / (cols * lens.rows) - 1) > _SAME_SHAPE:
        raise ValueError(f"the frame must have the shape of the camera's, {lens.cols} x {lens.rows} px, got {cols} x {rows}")
    while True:
        if lens and not frame:
            rows, cols = min(rows, round(cols * lens.rows / lens.cols)), min(cols, round(rows * lens.cols / lens.rows))
        if min(rows, cols) < SMALLEST:
            raise ValueError(
                f"the scene, {scene_cols} x {scene_rows} px, must be larger than the motion's reach by a frame of {SMALLEST} px;"
                " is the motion too large, or the focal length not in pixels?"
            )
        intrinsics = lens.scaled(rows, cols) if lens else Intrinsics.centred(focal=focal or 0.0, rows=rows, cols=cols)
        lines = cols if direction in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT) else rows
        per_line = row_time if row_time is not None else (readout or 0.0) / lines
        timing = ShutterTiming(exposure=exposure, row_time=per_line, rows=lines, direction=direction)
        camera = Camera(timing=timing, intrinsics=intrinsics)
        curve = _moved(motion, camera, roll=roll, blur=blur)
        above, beside = margin(camera=camera, trajectory=curve)
        if rows + 2 * above <= scene_rows and cols + 2 * beside <= scene_cols:
            return Stage(camera=camera, trajectory=curve)
        if frame:
            raise ValueError(
                f"the scene must hold the frame of {cols} x {rows} px and what the motion shows beyond it,"
                f" {cols + 2 * beside} x {rows + 2 * above} px, got {scene_cols} x {scene_rows}; choose a smaller frame or blur"
            )
        rows, cols = min(rows, scene_rows - 2 * above), min(cols, scene_cols - 2 * beside)


def _moved(motion: Motion, camera: Camera, *, roll: bool, blur: float | None) -> Trajectory:
    curve = centred(motion(camera), camera.timing.middle)
    if not roll and curve.coefficients.shape[1] == 3:
        curve = curve.with_coefficients(curve.coefficients * [1, 1, 0])
    return curve if blur is None else scaled_to(blur, camera=camera, trajectory=curve)
