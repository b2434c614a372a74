"""A hand-held camera's path over eight frames: `from tests.restoration.swaying import sway`."""

import numpy as np

from rsvideo.physics.camera import Intrinsics, turned
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Spline, Trajectory, fit
from rsvideo.restoration.tracks import Tracks

CAMERA = Intrinsics.centred(focal=300.0, rows=120, cols=160)
TIMING = ShutterTiming.from_readout(exposure=0.01, readout=0.03, rows=120)
BEGINS = np.arange(8) / 24
END = float(BEGINS[-1]) + TIMING.interval[1]


def spline(t: np.ndarray, poses: np.ndarray, terms: int = 40) -> Spline:
    found = fit(Spline(t0=0.0, t1=END, coefficients=np.zeros((terms, poses.shape[1]))), t, poses)
    assert isinstance(found, Spline)
    return found


def sway(axes: int) -> Spline:
    """Some 4 Hz, as a hand does, on top of a pan to the right."""
    t = np.linspace(0, END, 400)
    x = 60 * t + 6 * np.sin(2 * np.pi * 4 * t)
    y = 8 * np.cos(2 * np.pi * 3 * t)
    roll = 0.02 * np.sin(2 * np.pi * 2.5 * t)
    return spline(t, np.stack([x, y, roll], axis=1)[:, :axes])


def shaken(axes: int, *, hertz: float, reach: float) -> Spline:
    """The same, and a tone along x."""
    t = np.linspace(0, END, 4000)
    poses = sway(axes).at(t)
    poses[:, 0] += reach * np.sin(2 * np.pi * hertz * t + 1)
    return spline(t, poses, terms=300)


def sights(path: Trajectory, begin: float, points: np.ndarray, timing: ShutterTiming) -> np.ndarray:
    """Where a frame shows points of the latent image: each moved by the mean over its own row's exposure."""
    at = points.copy()
    for _ in range(30):
        lines = at[:, 1:] if timing.direction is Direction.TOP_TO_BOTTOM else timing.rows - 1 - at[:, 1:]
        poses = path.at(lines * timing.row_time + timing.sample_times(16)[0] + begin)
        moves = turned(CAMERA, np.repeat(at[:, :1], 16, 1), np.repeat(at[:, 1:], 16, 1), poses)
        at = points - moves.mean(axis=1)
    return at


def exact(path: Trajectory, timing: ShutterTiming = TIMING) -> list[Tracks]:
    """Tracks without an error: between neighbours, of points that both show."""
    x, y = np.meshgrid(np.linspace(-40, 220, 16), np.linspace(-40, 160, 14))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    seen = [sights(path, float(t), points, timing) for t in BEGINS]
    inside = [((s > 2) & (s < [CAMERA.cols - 3, CAMERA.rows - 3])).all(axis=1) for s in seen]
    return [Tracks(before=seen[k][both], after=seen[k + 1][both]) for k in range(7) for both in [inside[k] & inside[k + 1]]]
