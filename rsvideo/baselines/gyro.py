"""The motion of a clip from a gyroscope's log: what the paper recommends where one is there, as on drones and in phones.

A log's clock and axes are seldom the camera's. Both are found from points that move between frames: a point observed at the times t
and t' moves by L A (P(t' + tau) - P(t + tau)), with P the gyroscope's integrated rates, L the lever of the point, and the offset
tau and the axes A (one of 24 rotations by right angles) sought: coarsely where the rates that tracks show agree with the log's,
then where the points themselves do.
"""

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicHermiteSpline
from scipy.ndimage import gaussian_filter1d
from scipy.optimize import minimize_scalar
from scipy.spatial.transform import Rotation

from rsvideo.physics import gyro
from rsvideo.physics.camera import Camera, lever
from rsvideo.physics.gyro import GyroLog, camera_from_gyro
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Spline, Trajectory, fit
from rsvideo.restoration import clip_motion
from rsvideo.restoration.camera_path import CameraPath, blank, trusted
from rsvideo.restoration.clip_motion import Run
from rsvideo.restoration.correction import ApproximatePath
from rsvideo.restoration.movement import Movement

SLOWEST = 0.025  # s between samples; a hand shakes at up to 20 Hz
SLACK = 0.01  # s, by which a log may begin late or end early; a frame there moves as it does that much later or earlier
RIGHT_ANGLES = tuple(
    axes
    for letters in itertools.permutations("XYZ")
    for senses in itertools.product((str.upper, str.lower), repeat=3)
    for axes in ["".join(sense(letter) for sense, letter in zip(senses, letters, strict=True))]
    if np.linalg.det(camera_from_gyro(axes)) > 0
)
HARDLY = 1.0  # px between frames, RMS; below, a clip's motion does not place a log
EXPLAINED = 0.6  # of that, which may remain
ALIKE = 1.25  # times the best answer's residual, that another must exceed
ANOTHER = 0.05  # s; offsets closer than this are one answer
_POINTS = 40  # of a pair of frames
_GRID = 5e-3  # s, between the offsets that are tried first
_PRECISE = 1e-5  # s, to which they are then found
_SMOOTH = 0.012  # s, a Gaussian's; faster motion is not shared by tracks and logs
_CANDIDATES = 8  # offsets of each set of axes that are tried
_SAMPLES = 4  # of an exposure, over which a point's pose is averaged
_RADIUS = 0.25  # of the frame's diagonal: how far from the middle roll is taken to move a point
_SCALE, _SHARE = 0.5, 0.1  # px, and of the points' own motion, beyond which a point counts less (Cauchy); origin: by trial
DRIFT, SHARE = 0.3, 0.05  # px a frame, and of a frame's motion, by which a log's path may be wrong
_HALF_STEPS = 4  # half of the integration steps for each of the log's samples, so that their number is even; origin: by trial
_FEWEST_STEPS = 16  # of an integration, however short; origin: by trial
_INSTANTS = 129  # of a frame's interval, at which its own path is sampled; origin: by trial
_FIT_POINTS = 8  # for each coefficient of a clip's path, at which a log's poses are read; origin: by trial
_LAG = 1e-3  # s, half of the difference by which the residual's slope over the offset is measured; origin: by trial
_LEAST_SLOPE = 1e-12  # (px/s)^2 of all points; keeps the deviation finite where the camera rests
_COARSE = 4 * _CANDIDATES  # best pairs of offset and axes that are handed on from the search on the grid; origin: by trial


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """How a log fits a clip."""

    offset: float  # s, what the clip's time becomes the log's by adding
    axes: str  # the gyroscope's along the camera's right, down and forward; small letters for the opposite sense
    residual: float  # px, how far points lie from where the log moves them from frame to frame; the median
    moved: float  # px, the same without the log
    another: float  # px, the same with the next best answer; inf where there is none
    spread: float  # s, standard deviation of the offset


def movement(
    log: GyroLog,
    begins: Float[np.ndarray, " frames"],
    camera: Camera,
    *,
    offset: float,
    axes: str = "XYZ",
    tied: Sequence[bool] | None = None,
) -> Movement:
    """The motion of frames that begin at `begins` seconds of the clip, in image axes; `tied` as a clip's cuts have it."""
    if log.step > SLOWEST:
        raise ValueError(_slow(log))
    timing, lens = camera.timing, camera.intrinsics
    log = gyro.facing(log, axes)
    check_cover(log, begins, timing, offset)
    tied = [*(True,) * (len(begins) - 1), False] if tied is None else list(tied)
    duration = timing.interval[1]
    starts = np.maximum(begins + offset, 0.0)
    paths = [gyro.path(log, camera=lens, start=min(float(t), log.times[-1] - duration), duration=duration) for t in starts]
    steps = np.zeros((len(begins), 3))
    for k in np.flatnonzero(tied):
        first, second = begins[k : k + 2] + offset + timing.middle
        between = max(2 * round(_HALF_STEPS * (second - first) / log.step), _FEWEST_STEPS)
        ends = gyro.integrate(log, start=float(first), duration=float(second - first), steps=between)[[0, -1]]
        turn = (Rotation.from_rotvec(ends[0]).inv() * Rotation.from_rotvec(ends[1])).as_rotvec()
        steps[k] = gyro.poses_from_angles(turn[None], camera=lens)[0]
    return Movement(within=[*paths], steps=steps, tied=tied)


def refined(log: GyroLog, run: Run, *, offset: float, axes: str = "XYZ") -> Movement:
    """The log's motion corrected by what the points between the frames show, and by the frames' blur (`run` holds both)."""
    interval = run.camera.timing.interval
    plain = movement(log, run.begins, run.source_camera, offset=offset, axes=axes, tied=run.tied)
    start = log_path(log, run, offset=offset, axes=axes)
    everywhere = np.ones(len(run.begins), bool)
    found = clip_motion.refined_by_blur(run, clip_motion.path_from_tracks(run, start), everywhere)
    before, now = (clip_motion.movement_of(run, path.spline, everywhere) for path in (start, found))
    t = np.linspace(*interval, _INSTANTS)
    paths = []
    for fine, old, new in zip(plain.within, before.within, now.within, strict=True):
        assert fine is not None
        assert old is not None
        assert new is not None
        poses = fine.at(t)
        poses[:, : run.axes] += new.at(t) - old.at(t)
        paths.append(gyro.spline_through(poses, duration=interval[1], spacing=max(log.step / 2, t[1] * 2)))
    steps = plain.steps.copy()
    steps[:, : run.axes] += now.steps - before.steps
    return Movement(within=paths, steps=steps, tied=run.tied)


def first(path: Trajectory) -> ApproximatePath:
    """A frame's motion from a log, as what the blind method begins with and corrects."""
    return ApproximatePath(trajectory=path, drift=DRIFT, share=SHARE)


def log_path(log: GyroLog, run: Run, *, offset: float, axes: str = "XYZ") -> CameraPath:
    """The log's path over a run, along its scanlines, and how precise it is: a frame's motion to DRIFT px and its SHARE."""
    log, timing = gyro.facing(log, axes), run.camera.timing
    check_cover(log, run.begins, timing, offset)
    path = blank(run.begins, timing, run.axes)
    t = np.linspace(path.t0, path.t1, _FIT_POINTS * len(path.coefficients))
    angles = gyro.integrals(log)(np.clip(t + offset, 0, log.times[-1]))
    poses = gyro.poses_from_angles(angles - angles[len(t) // 2], camera=run.source_camera.intrinsics)[:, : run.axes]
    found = fit(path, t, run.direction.poses_along_scanlines(poses))
    assert isinstance(found, Spline)
    return trusted(found, run.camera, drift=DRIFT, share=SHARE)


def aligned(
    log: GyroLog,
    run: Run,
    *,
    offset: float | None = None,
    axes: str | None = None,
    between: tuple[float, float] | None = None,
) -> Alignment:
    """The offset and the axes, those that are not given, with which the log explains best how the run's points move.

    Offsets are sought over all the log, or `between` two. Raises ValueError where the clip hardly moves, nothing fits, or two
    answers fit alike.
    """
    if log.step > SLOWEST:
        raise ValueError(_slow(log))
    sights = _Sights.of(run, log)
    if sights is None or sights.moved < HARDLY:
        moved = "no point could be followed" if sights is None else f"points move by {sights.moved:.2g} px from frame to frame"
        raise ValueError(f"the clip must move for a gyro log to be aligned with it, {moved}; give the log's offset and axes")
    turns = [axes] if axes else list(RIGHT_ANGLES)
    if offset is None:
        reach = _sought(log, run, between)
        answers = sorted(_refined(sights, tau, turn, reach) for tau, turn in _coarse(log, run, turns, *reach))
    else:
        check_cover(log, run.begins, run.camera.timing, offset)
        answers = sorted((sights.residual(offset, camera_from_gyro(turn)), offset, turn) for turn in turns)
    best, tau, turn = answers[0]
    others = [a for a in answers[1:] if a[2] != turn or abs(a[1] - tau) > ANOTHER]
    another = others[0] if others else (np.inf, 0.0, "")
    if best > EXPLAINED * sights.moved:
        raise ValueError(
            f"the gyro log must explain how the clip moves, at best (offset {tau:.4g} s, axes {turn}) {best:.2g} of {sights.moved:.2g} px"
            " remain; is it another clip's, or was the clip stabilised?"
        )
    if another[0] < ALIKE * best:
        raise ValueError(
            f"the gyro log's place cannot be told: offset {tau:.4g} s with axes {turn} leaves {best:.2g} px, offset {another[1]:.4g} s with"
            f" axes {another[2]} {another[0]:.2g} px; give one of them"
        )
    spread = sights.spread(tau, camera_from_gyro(turn), best)
    return Alignment(offset=tau, axes=turn, residual=best, moved=sights.moved, another=another[0], spread=spread)


def _sought(log: GyroLog, run: Run, between: tuple[float, float] | None) -> tuple[float, float]:
    """The offsets at which the log covers the run, of those `between` two; refuses a log that is too short for any."""
    opens, ends = float(run.begins[0]), float(run.begins[-1] + run.camera.timing.interval[1])
    low, high = -opens - SLACK, float(log.times[-1]) - ends + SLACK
    if between:
        low, high = max(low, between[0]), min(high, between[1])
    if low > high:
        raise ValueError(
            f"the gyro log must cover the {ends - opens:.3g} s of the clip that are looked at, it lasts {log.times[-1]:.4g} s"
            + (f"; offsets are sought between {between[0]:g} and {between[1]:g} s" if between else "")
        )
    return low, high


def _refined(sights: "_Sights", tau: float, turn: str, reach: tuple[float, float]) -> tuple[float, float, str]:
    """Residual, offset and axes at the best offset near `tau`."""
    matrix, bounds = camera_from_gyro(turn), (max(tau - 2 * _GRID, reach[0]), min(tau + 2 * _GRID, reach[1]))
    options = {"xatol": _PRECISE}
    fine: Any = minimize_scalar(sights.disagreement, bounds=bounds, args=(matrix,), method="bounded", options=options)
    return sights.residual(float(fine.x), matrix), float(fine.x), turn


def _slow(log: GyroLog) -> str:
    return f"a gyro log needs at least {1 / SLOWEST:.0f} samples a second to tell motion within a frame, got {1 / log.step:.3g}"


def check_cover(log: GyroLog, begins: np.ndarray, timing: ShutterTiming, offset: float) -> None:
    """Refuse a log that does not reach over frames that begin at `begins` seconds of the clip."""
    first, last = float(begins.min()), float(begins.max() + timing.interval[1])
    slack = max(2 * log.step, SLACK)
    if first + offset < -slack or last + offset > log.times[-1] + slack:
        raise ValueError(
            f"the gyro log must cover the clip from {first:.4g} to {last:.4g} s, with an offset of {offset:.4g} s it covers"
            f" {-offset:.4g} to {log.times[-1] - offset:.4g} s; is it another clip's, or the offset's sign turned round?"
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Sights:
    """Points observed twice, each at its scanline's times: displacements = levers @ A (turned(second) - turned(first))."""

    first: Float[np.ndarray, "points samples"]  # seconds of the clip
    second: Float[np.ndarray, "points samples"]
    levers: Float[np.ndarray, "points 2 3"]  # px a radian of pitch, yaw and roll
    displacements: Float[np.ndarray, "points 2"]
    turned: CubicHermiteSpline  # radians, of the log's time
    last: float  # s, of the log

    @classmethod
    def of(cls, run: Run, log: GyroLog) -> "_Sights | None":
        lens, timing = run.camera.intrinsics, run.camera.timing
        poses = run.direction.poses_along_scanlines(gyro.poses_from_angles(np.eye(3), camera=run.source_camera.intrinsics))
        exposed = (np.arange(_SAMPLES) + 0.5) * timing.exposure / _SAMPLES
        parts = []
        for k, link in enumerate(run.links):
            if not len(link.before):
                continue
            every = max(1, len(link.before) // _POINTS)
            before, after = link.before[::every], link.after[::every]
            times = [run.begins[k + n] + p[:, 1:] * timing.row_time + exposed for n, p in enumerate((before, after))]
            middle = 0.5 * (before + after)
            parts.append((*times, lever(lens, middle[:, 0], middle[:, 1], 3) @ poses.T, before - after))
        if not parts:
            return None
        first, second, levers, displacements = (np.concatenate(part) for part in zip(*parts, strict=True))
        turned, last = gyro.integrals(log), float(log.times[-1])
        return cls(first=first, second=second, levers=levers, displacements=displacements, turned=turned, last=last)

    @property
    def moved(self) -> float:
        """px, what no motion at all leaves."""
        return float(np.median(np.linalg.norm(self.displacements, axis=1)))

    def apart(self, offset: float, matrix: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "points 2"]:
        """How far points lie from where the log moves them."""
        before, after = (self.turned(np.clip(t + offset, 0.0, self.last)).mean(axis=1) for t in (self.first, self.second))
        return self.displacements - np.einsum("nca,na->nc", self.levers, (after - before) @ matrix.T)

    def residual(self, offset: float, matrix: Float[np.ndarray, "3 3"]) -> float:
        """px, what the log leaves of half the points."""
        return float(np.median(np.linalg.norm(self.apart(offset, matrix), axis=1)))

    def disagreement(self, offset: float, matrix: Float[np.ndarray, "3 3"]) -> float:
        """What the log leaves of all points, each counted less the farther it lies; smooth in the offset."""
        scale = max(_SCALE, _SHARE * self.moved)
        return float(np.log1p((self.apart(offset, matrix) ** 2).sum(axis=1) / scale**2).mean())

    def spread(self, offset: float, matrix: Float[np.ndarray, "3 3"], residual: float) -> float:
        """s, of the offset if points err by `residual` independently of each other, but for those of one frame."""
        slope = (self.apart(offset + _LAG, matrix) - self.apart(offset - _LAG, matrix)) / (2 * _LAG)
        return residual * math.sqrt(_POINTS / max(float((slope**2).sum()), _LEAST_SLOPE))


def _coarse(log: GyroLog, run: Run, turns: Sequence[str], low: float, high: float) -> list[tuple[float, str]]:
    """The offsets and axes whose rates agree best with those that the tracks show.

    With rates w of the tracks and g of the log in px/s, sum |w|^2 - 2 w A g + |A g|^2 is what A leaves, by correlation at all offsets.
    """
    path, lens = clip_motion.path_from_tracks(run).spline, run.source_camera.intrinsics
    t = np.arange(path.t0, path.t1, _GRID)
    w = np.gradient(gyro.angles_from_poses(run.direction.poses_in_image(path.at(t)), camera=lens), _GRID, axis=0)
    w = gaussian_filter1d(w, _SMOOTH / _GRID, axis=0)
    offsets = np.arange(low, high + _GRID, _GRID)
    at = t[0] + low + np.arange(len(t) + len(offsets) - 1) * _GRID
    sums = gyro.integrals(log)(np.clip(at, 0, log.times[-1]))
    g = gaussian_filter1d(np.gradient(sums, _GRID, axis=0), _SMOOTH / _GRID, axis=0)
    radius = _RADIUS * np.hypot(lens.rows, lens.cols)
    size = np.array([lens.fy, lens.fx, radius if run.axes == 3 else 0.0]) ** 2  # px a radian, squared
    spectra = [np.fft.rfft(rates.T, len(g)) for rates in (w, g)]
    both = np.fft.irfft(spectra[0].conj()[:, None] * spectra[1], len(g))[..., : len(offsets)]  # no shift wraps: g is so much longer
    energy = np.vstack([np.zeros(3), np.cumsum(g**2, axis=0)])
    power = (energy[len(t) :] - energy[: -len(t)]).T
    found = []
    for turn in turns:
        matrix = camera_from_gyro(turn)
        left = size @ (abs(matrix) @ power) - 2 * np.einsum("i,ij,ijt->t", size, matrix, both)
        for _ in range(_CANDIDATES):
            k = int(np.argmin(left))
            if not np.isfinite(left[k]):
                break
            found.append((float(left[k]), float(offsets[k]), turn))
            left[max(0, k - round(ANOTHER / _GRID)) : k + round(ANOTHER / _GRID) + 1] = np.inf
    found.sort()
    return [(tau, turn) for _, tau, turn in found[:_COARSE]]
