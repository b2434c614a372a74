"""Motion that is given rather than found: a sidecar, or sampled angles, as a spline over one frame's interval."""

import csv
from array import array
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from rsvideo.config import sidecar
from rsvideo.config.files import UnreadableError, lines
from rsvideo.config.yaml import shown
from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Spline, Trajectory, centred, fit

COLUMNS = ("t_s", "pitch_rad", "yaw_rad", "roll_rad")
_LARGEST = 1e7  # s and rad; no camera turns or waits so far
_AROUND = 64  # samples; the influence of each falls by a factor of 4 from one to the next
_TOLERANCE = 0.01  # px, anywhere in the frame
_TERMS = (8, 16, 32, 64, 128, 256, 512)
_SLACK = 0.02  # of the interval, that a record may start late or end early, but by no more than one of its own steps
_LEAST_SLACK = 1e-3  # of the interval, that a record may lack in any case: rounding of its times
_NEIGHBOURS = 4  # samples beyond the interval on either side that shape the curve inside; farther ones do not
_FIT_POINTS = 4  # for each term of the longest spline, at which all are compared with the samples; origin: by trial


def read(path: Path, camera: Camera) -> Trajectory:
    """The motion of a photograph in a file, with its pose at the middle of the frame's interval as the origin."""
    return of_clip(path, camera, [(0, 0.0)])[0][0]


def of_clip(path: Path, camera: Camera, frames: Sequence[tuple[int, float]]) -> tuple[list[Trajectory], list[list[float] | None]]:
    """The motion within each of successive frames, given as (index, seconds at which it begins), and from each one's middle to the next's.

    The latter is None at a cut, and of the last.
    """
    steps: list[list[float] | None] = [None] * len(frames)
    if path.suffix.lower() == ".json":
        held = of_frames(path, [index for index, _ in frames])
        within = [(np.array(held[index].trajectory.t_s), held[index].trajectory.poses()) for index, _ in frames]
        steps[:-1] = [held[index].to_next for index, _ in frames[:-1]]
    else:
        timing, lens = camera.timing, camera.intrinsics
        t, turned = angles(path)
        poses = turned[:, [1, 0, 2]] * np.array([lens.fx, -lens.fy, 1.0])
        t, poses = _near(t, poses, frames[0][1], frames[-1][1] + timing.interval[1])
        parts = [(begins, *_near(t, poses, begins, begins + timing.interval[1])) for _, begins in frames]
        within = [(near - begins, path_px) for begins, near, path_px in parts]
        if len(frames) > 1:
            at = CubicSpline(t, poses)(np.array([begins + timing.middle for _, begins in frames]))
            steps[:-1] = np.diff(at, axis=0).tolist()
    return [_within(path, t, poses, camera) for t, poses in within], steps


def of_frames(path: Path, indices: Sequence[int]) -> dict[int, sidecar.FrameRecord]:
    """What a sidecar holds of all of these frames; UnreadableError where it lacks one."""
    held = sidecar.frames(path, {*indices})
    if missing := [index for index in indices if index not in held]:
        raise UnreadableError(f"{path} must hold the motion of frame {missing[0]}, it does not; is it another clip's, or a part's?")
    return held


def _near(
    t: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n 3"], start: float, end: float
) -> tuple[Float[np.ndarray, " m"], Float[np.ndarray, "m 3"]]:
    """The samples from `start` to `end`, with so many on either side that those beyond do not shape the curve between."""
    first, last = np.searchsorted(t, (start, end))
    near = slice(max(first - _AROUND, 0), last + _AROUND)
    return t[near], poses[near]


def _within(path: Path, t: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n axes"], camera: Camera) -> Trajectory:
    """The motion within one frame, from samples at the frame's own times."""
    start, end = camera.timing.interval
    slack = max(_LEAST_SLACK * (end - start), min(_SLACK * (end - start), float(np.median(np.diff(t)))))
    if t[0] > start + slack or t[-1] < end - slack:
        raise ValueError(
            f"{path} must cover the frame's whole interval, {start:g} to {end:g} s, it covers {t[0]:g} to {t[-1]:g} s;"
            " is its time 0 the opening of the first row?"
        )
    if not poses[:, 2].any():
        poses = poses[:, :2]
    return centred(_spline(path, t, poses, camera), camera.timing.middle)


def angles(path: Path) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n 3"]]:
    """Rising times in s, and pitch, yaw and roll in rad, of a CSV that has a column for each."""
    rows = csv.reader(lines(path, most=sidecar.MOST_BYTES), strict=True)
    samples = array("d")
    try:
        header = [name.strip() for name in next(rows)]
        if missing := [name for name in COLUMNS if name not in header]:
            raise UnreadableError(f"{path}:1: must be text and must name the columns {','.join(COLUMNS)}, it lacks {', '.join(missing)}")
        columns = [header.index(name) for name in COLUMNS]
        for row in rows:
            if row:
                samples.extend(_numbers(path, rows.line_num, row, columns))
    except csv.Error as error:
        raise UnreadableError(f"{path} must be text with the columns {','.join(COLUMNS)}: {error}") from error
    table = np.frombuffer(samples).reshape(-1, len(COLUMNS))
    if len(table) < 2:
        raise UnreadableError(f"{path} must hold at least 2 samples, it holds {len(table)}")
    t = table[:, 0]
    if (late := np.flatnonzero(np.diff(t) < sidecar.LEAST_STEP)).size:
        raise UnreadableError(f"{path}: t_s must rise from line to line, it does not after {t[late[0]]:g} s")
    return t, table[:, 1:]


def _numbers(path: Path, number: int, row: list[str], columns: list[int]) -> list[float]:
    try:
        values = [float(row[column]) for column in columns]
    except (ValueError, IndexError) as error:
        raise UnreadableError(f"{path}:{number}: must hold a number in each column, got {shown(','.join(row))!r}") from error
    if not all(abs(value) <= _LARGEST for value in values):  # which no NaN is
        raise UnreadableError(f"{path}:{number}: must hold finite numbers of at most {_LARGEST:g}, got {shown(','.join(row))!r}")
    return values


def _spline(path: Path, t: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n axes"], camera: Camera) -> Trajectory:
    """The spline of fewest terms that stays within the tolerance of a smooth curve through the samples."""
    interval, lens = camera.timing.interval, camera.intrinsics
    first, last = np.searchsorted(t, interval)
    near = slice(max(first - _NEIGHBOURS, 0), last + _NEIGHBOURS)
    t, poses = t[near], poses[near]
    dense = np.linspace(*interval, _FIT_POINTS * _TERMS[-1] + 1)
    path_px = CubicSpline(t, poses)(dense)
    reach = np.array([1.0, 1.0, 0.5 * np.hypot(lens.rows, lens.cols)])[: poses.shape[1]]  # px a unit of each axis moves a corner
    for terms in _TERMS:
        spline = fit(Spline(t0=interval[0], t1=interval[1], coefficients=np.zeros((terms, poses.shape[1]))), dense, path_px)
        if np.abs((spline.at(dense) - path_px) * reach).max() < _TOLERANCE:
            return spline
    raise ValueError(
        f"{path} must be smooth enough for a spline to follow within {_TOLERANCE:g} px, {_TERMS[-1]} terms do not;"
        " is it noise, or are its angles in degrees?"
    )
