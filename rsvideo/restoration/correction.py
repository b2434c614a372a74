"""An approximate trajectory, as a gyroscope measures it, corrected by the picture's sparsity."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rsvideo.physics.shutter import Direction
from rsvideo.physics.trajectory import Spline, Trajectory, fit, still
from rsvideo.restoration.estimate import ESTIMATED, Estimate
from rsvideo.restoration.extent import sampled
from rsvideo.restoration.hand_shake import SPREAD, pose_unit
from rsvideo.restoration.refinement import Prior, refine
from rsvideo.restoration.scanlines import path_along_scanlines
from rsvideo.restoration.scene import Scene, windowed
from rsvideo.restoration.settings import Settings

TRUST = 2e-3  # in the path, against the sparsity of a picture of ENOUGH pixels or more; origin: by trial
ENOUGH = 30_000  # pixels; sparsity of fewer is less certain
STEPS = 16  # of L-BFGS
TIMES = 129  # at which the given path is compared with the polynomial beside it
KNOTS = 64  # of the corrected path at least, so that it keeps motion finer than the correction
_FIT_POINTS = 4  # for each knot of the corrected path, at which it is fitted; origin: by trial
_BEGUN = 0.1  # of the whole work, after which the first path is shown; origin: by trial


@dataclass(frozen=True, kw_only=True, eq=False)
class ApproximatePath:
    """A trajectory, and how far it may be wrong."""

    trajectory: Trajectory
    drift: float  # px over the frame's interval
    share: float  # and of its own length

    def along_scanlines(self, direction: Direction) -> "ApproximatePath":
        """The same along the scanlines, for one in image axes."""
        return replace(self, trajectory=path_along_scanlines(self.trajectory, direction))


def corrected(scene: Scene, start: ApproximatePath, settings: Settings) -> Iterator[Estimate]:
    """The given trajectory and a polynomial beside it, as large as the trajectory may be wrong; all along the scanlines."""
    given, interval = start.trajectory, scene.camera.timing.interval
    t = np.linspace(*interval, TIMES)
    first = fit(still(interval, degree=settings.degree, axes=given.coefficients.shape[1]), t, given.at(t))
    part = sampled(windowed(scene), first)
    yield Estimate(stage="path", fraction=_BEGUN, trajectory=given)
    best = refine(part, first, _prior(start, first, part, settings.degree), ridge=part.ridge, steps=STEPS)
    finer = Spline(t0=t[0], t1=t[-1], coefficients=np.zeros((max(KNOTS, len(given.coefficients)), given.coefficients.shape[1])))
    t = np.linspace(*interval, _FIT_POINTS * len(finer.coefficients))
    path = fit(finer, t, given.at(t) + best.trajectory.at(t) - first.at(t))
    yield Estimate(stage="path", fraction=ESTIMATED, trajectory=path, values=best.values)


def _prior(start: ApproximatePath, first: Trajectory, part: Scene, degree: int) -> Prior:
    poses = first.at(np.linspace(*part.camera.timing.interval, TIMES))
    length = float(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum())
    unit = pose_unit(part.camera.intrinsics, poses.shape[1])
    spread = SPREAD * (start.drift + start.share * length) * np.tile(unit, degree)
    weight = TRUST * max(1.0, ENOUGH / part.frame.size)
    return Prior(mean=first.coefficients[1:], curvature=np.diag(spread**-2), weight=weight)
