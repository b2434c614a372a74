"""The motion of a clip from a gyroscope's log: what the paper recommends where one is there, as on drones and in phones.

A log's clock and axes are seldom the camera's. Both are found from points that move between frames: a point seen at the times t
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
from rsvideo.physics.camera import Intrinsics, lever
from rsvideo.physics.gyro import GyroLog, camera_from_gyro
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Spline, Trajectory, fit
from rsvideo.restoration import multi_frame
from rsvideo.restoration.camera_path import Path, blank, trusted
from rsvideo.restoration.multi_frame import Movement, Run
from rsvideo.restoration.single_frame import Known, intrinsics_along

SLOWEST = 0.025  # s between samples; a hand shakes at up to 20 Hz
SLACK = 0.01  # s, by which a log may begin late or end early; a frame there moves as it does that much later or earlier
RIGHT_ANGLES = tuple(
    axes
    for letters in itertools.permutations("XYZ")
    for senses in itertools.product((str.upper, str.lower), repeat=3)
    for axes in ["".join(sense(letter) for sense, letter in zip(senses, letters, strict=True))]
    if np.linalg.det(camera_from_gyro(axes)) > 0
)
HARDLY = 1.0  # px between frames, RMS; below, a clip's own motion tells nothing of a log's
EXPLAINED = 0.6  # of that, which may remain
ALIKE = 1.25  # times the best answer's residual, that another must exceed
ANOTHER = 0.05  # s; offsets closer than this are one answer
_POINTS = 40  # of a pair of frames
_GRID = 5e-3  # s, between the offsets that are tried first
_SMOOTH = 0.012  # s, a Gaussian's; faster motion is not shared by tracks and logs
_CANDIDATES = 8
_SCALE, _SHARE = 0.5, 0.1  # px, and of the points' own motion, beyond which a point counts less (Cauchy)
DRIFT, SHARE = 0.3, 0.05  # px a frame, and of a frame's motion, by which a log's path may be wrong


@dataclass(frozen=True, kw_only=True)
class Alignment:
    """How a log fits a clip."""

    offset: float  # s, what the clip's time becomes the log's by adding
    axes: str  # the gyroscope's along the camera's right, down and forward; small letters for the opposite sense
    residual: float  # px, how far points lie from where the log says they move to from frame to frame; the median
    moved: float  # px, the same without the log
    another: float  # px, the same with the next best answer; inf where there is none
    spread: float  # s, standard deviation of the offset


def movement(
    log: GyroLog,
    begins: Float[np.ndarray, " frames"],
    timing: ShutterTiming,
    intrinsics: Intrinsics,
    *,
    offset: float,
    axes: str = "XYZ",
    tied: Sequence[bool] | None = None,
) -> Movement:
    """The motion of frames that begin at `begins` seconds of the clip, in image axes; `tied` as a clip's cuts have it."""
    if log.step > SLOWEST:
        raise ValueError(_slow(log))
    log = gyro.facing(log, axes)
    check_cover(log, begins, timing, offset)
    tied = [*(True,) * (len(begins) - 1), False] if tied is None else list(tied)
    duration = timing.interval[1]
    starts = np.maximum(begins + offset, 0.0)
    ways = [gyro.path(log, camera=intrinsics, start=min(float(t), log.times[-1] - duration), duration=duration) for t in starts]
    steps = np.zeros((len(begins), 3))
    for k in np.flatnonzero(tied):
        first, second = begins[k : k + 2] + offset + timing.middle
        between = max(2 * round(4 * (second - first) / log.step), 16)
        ends = gyro.integrate(log, start=float(first), duration=float(second - first), steps=between)[[0, -1]]
        turn = (Rotation.from_rotvec(ends[0]).inv() * Rotation.from_rotvec(ends[1])).as_rotvec()
        steps[k] = gyro.poses_from_angles(turn[None], camera=intrinsics)[0]
    return Movement(within=list(ways), steps=steps, tied=tied)


def refined(log: GyroLog, run: Run, *, offset: float, axes: str = "XYZ") -> Movement:
    """The log's motion corrected by what the points between the frames show, and by the frames' blur (`run` holds both)."""
    plain = movement(log, run.begins, run.timing, run.intrinsics, offset=offset, axes=axes, tied=run.tied)
    start = known(log, run, offset=offset, axes=axes)
    everywhere = np.ones(len(run.begins), bool)
    found = multi_frame.sharpened(run, multi_frame.tracked(run, start), everywhere)
    before, now = (multi_frame.told(path.spline, run.begins, run.timing, everywhere, run.tied) for path in (start, found))
    t = np.linspace(*run.timing.interval, 129)
    ways = []
    for fine, old, new in zip(plain.within, before.within, now.within, strict=True):
        assert fine is not None
        assert old is not None
        assert new is not None
        poses = fine.at(t)
        poses[:, : run.axes] += new.at(t) - old.at(t)
        ways.append(gyro.spline_through(poses, duration=run.timing.interval[1], spacing=max(log.step / 2, t[1] * 2)))
    steps = plain.steps.copy()
    steps[:, : run.axes] += now.steps - before.steps
    return Movement(within=ways, steps=steps, tied=run.tied)


def first(way: Trajectory) -> Known:
    """A frame's motion from a log, as what the blind method begins with and corrects."""
    return Known(trajectory=way, drift=DRIFT, share=SHARE)


def known(log: GyroLog, run: Run, *, offset: float, axes: str = "XYZ") -> Path:
    """The log's path over a run, along its scanlines, and how well it is known: a frame's motion to DRIFT px and its SHARE."""
    log = gyro.facing(log, axes)
    check_cover(log, run.begins, run.timing, offset)
    path = blank(run.begins, run.timing, run.axes)
    t = np.linspace(path.t0, path.t1, 8 * len(path.coefficients))
    angles = gyro.integrals(log)(np.clip(t + offset, 0, log.times[-1]))
    poses = gyro.poses_from_angles(angles - angles[len(t) // 2], camera=run.intrinsics)[:, : run.axes]
    found = fit(path, t, poses @ run.timing.direction.pose_from_scanlines[: run.axes, : run.axes])
    assert isinstance(found, Spline)
    return trusted(found, run.timing, run.intrinsics, drift=DRIFT, share=SHARE)


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
    opens, ends = float(run.begins[0]), float(run.begins[-1] + run.timing.interval[1])
    widest = -opens - SLACK, float(log.times[-1]) - ends + SLACK
    low, high = (max(widest[0], between[0]), min(widest[1], between[1])) if between else widest
    if offset is None and low > high:
        raise ValueError(
            f"the gyro log must cover the {ends - opens:.3g} s of the clip that are looked at, it lasts {log.times[-1]:.4g} s"
            + (f"; offsets are sought between {between[0]:g} and {between[1]:g} s" if between else "")
        )
    if offset is not None:
        check_cover(log, run.begins, run.timing, offset)
        tried = [(offset, turn) for turn in turns]
    else:
        tried = _coarse(log, run, turns, low, high)
    answers: list[tuple[float, float, str]] = []  # residual, offset, axes
    for tau, turn in tried:
        matrix = camera_from_gyro(turn)
        if offset is None:
            reach = (max(tau - 2 * _GRID, low), min(tau + 2 * _GRID, high))
            options = {"xatol": 1e-5}
            fine: Any = minimize_scalar(sights.disagreement, bounds=reach, args=(matrix,), method="bounded", options=options)
            tau = float(fine.x)
        answers.append((sights.residual(tau, matrix), tau, turn))
    answers.sort()
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
    """Points seen twice, each at its scanline's times: displacements = levers @ A (turned(second) - turned(first))."""

    first: Float[np.ndarray, "points samples"]  # seconds of the clip
    second: Float[np.ndarray, "points samples"]
    levers: Float[np.ndarray, "points 2 3"]  # px a radian of pitch, yaw and roll
    displacements: Float[np.ndarray, "points 2"]
    turned: CubicHermiteSpline  # radians, of the log's time
    last: float  # s, of the log

    @classmethod
    def of(cls, run: Run, log: GyroLog) -> "_Sights | None":
        camera, timing = intrinsics_along(run.intrinsics, run.timing), run.timing
        poses = gyro.poses_from_angles(np.eye(3), camera=run.intrinsics) @ timing.direction.pose_from_scanlines  # along the scanlines
        exposed = (np.arange(4) + 0.5) * timing.exposure / 4
        parts = []
        for k, link in enumerate(run.links):
            if not len(link.before):
                continue
            every = max(1, len(link.before) // _POINTS)
            before, after = link.before[::every], link.after[::every]
            times = [run.begins[k + n] + p[:, 1:] * timing.row_time + exposed for n, p in enumerate((before, after))]
            middle = 0.5 * (before + after)
            parts.append((*times, lever(camera, middle[:, 0], middle[:, 1], 3) @ poses.T, before - after))
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
        """How far points lie from where the log says."""
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
        h = 1e-3
        slope = (self.apart(offset + h, matrix) - self.apart(offset - h, matrix)) / (2 * h)
        return residual * math.sqrt(_POINTS / max(float((slope**2).sum()), 1e-12))


def _coarse(log: GyroLog, run: Run, turns: Sequence[str], low: float, high: float) -> list[tuple[float, str]]:
    """The offsets and axes whose rates agree best with those that the tracks show.

    With rates w of the tracks and g of the log in px/s, sum |w|^2 - 2 w A g + |A g|^2 is what A leaves, by correlation at all offsets.
    """
    path = multi_frame.tracked(run).spline
    t = np.arange(path.t0, path.t1, _GRID)
    way = path.at(t) @ run.timing.direction.pose_from_scanlines[: run.axes, : run.axes].T
    w = np.gradient(gyro.angles_from_poses(way, camera=run.intrinsics), _GRID, axis=0)
    w = gaussian_filter1d(w, _SMOOTH / _GRID, axis=0)
    offsets = np.arange(low, high + _GRID, _GRID)
    at = t[0] + low + np.arange(len(t) + len(offsets) - 1) * _GRID
    sums = gyro.integrals(log)(np.clip(at, 0, log.times[-1]))
    g = gaussian_filter1d(np.gradient(sums, _GRID, axis=0), _SMOOTH / _GRID, axis=0)
    radius = 0.25 * np.hypot(run.intrinsics.rows, run.intrinsics.cols)
    size = np.array([run.intrinsics.fy, run.intrinsics.fx, radius if run.axes == 3 else 0.0]) ** 2  # px a radian, squared
    spectra = [np.fft.rfft(rates.T, len(g)) for rates in (w, g)]
    both = np.fft.irfft(spectra[0].conj()[:, None] * spectra[1], len(g))[..., : len(offsets)]  # no shift wraps: g is so much longer
    energy = np.vstack([np.zeros(3), np.cumsum(g**2, axis=0)])
    own = (energy[len(t) :] - energy[: -len(t)]).T
    found = []
    for turn in turns:
        matrix = camera_from_gyro(turn)
        left = size @ (abs(matrix) @ own) - 2 * np.einsum("i,ij,ijt->t", size, matrix, both)
        for _ in range(_CANDIDATES):
            k = int(np.argmin(left))
            if not np.isfinite(left[k]):
                break
            found.append((float(left[k]), float(offsets[k]), turn))
            left[max(0, k - round(ANOTHER / _GRID)) : k + round(ANOTHER / _GRID) + 1] = np.inf
    found.sort()
    return [(tau, turn) for _, tau, turn in found[: 4 * _CANDIDATES]]
