"""How image points move by themselves, beyond the camera's path: near things before far ones, and whatever walks or turns.

The velocity u(x) of that motion is a Gaussian process with the kernel k (Rasmussen and Williams, "Gaussian Processes for Machine
Learning", 2006), taken as constant while a frame is read. A point x_i that moves by e_i in the time T_i, both beyond the path,
obeys

    e_i = T_i u(x_i) + noise,    E[u | e] = s^2 sum_i k(x, x_i) T_i a_i,    (s^2 T k T + sigma^2 / w) a = e,

with sigma of tracking and weights w that let points lie (Cauchy's). How fast (s) and how smooth (the kernel's length) the field is,
is what predicts points best that are left out: a_i / [C^-1]_ii off (ibid., Eq. 5.12). Where that is hardly better than no motion
there is no field.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Real
from scipy import linalg
from scipy.spatial.distance import cdist

from rsvideo import threads
from rsvideo.physics import tiles
from rsvideo.physics.camera import Camera
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tiles import Tile
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.nodes import nodes
from rsvideo.restoration.tracks import TRACKED

SPEEDS = (0.5, 2.0, 8.0)  # px in the points' time, s T
LENGTHS = (1 / 16, 1 / 8, 1 / 4, 1 / 2)  # of the frame's longer side
MOST = 300  # points a field; inverting their covariance costs their cube
EXPLAINS = 0.6  # of what points miss without a field, which one may leave; tracks' and paths' own errors are smooth too, at 0.7 to 1
PROBES = 4  # frames of a run that choose its fields' speed and length
_ROUNDS = 4  # of reweighting
_OUTLIER = 2  # times the typical misfit, at which a point counts half (Cauchy's weights)


@dataclass(frozen=True, kw_only=True, eq=False)
class Points:
    """What the points of one frame do beyond the path, along its scanlines."""

    at: Float[np.ndarray, "points 2"]  # px
    moved: Float[np.ndarray, "points 2"]  # px, e
    elapsed: Float[np.ndarray, " points"]  # s, T

    @property
    def thinned(self) -> "Points":
        """At most MOST of them, evenly taken."""
        every = slice(None, None, -(-len(self.at) // MOST) or 1)
        return Points(at=self.at[every], moved=self.moved[every], elapsed=self.elapsed[every])


@dataclass(frozen=True, kw_only=True, eq=False)
class Flow:
    """The field u, along the scanlines."""

    points: Float[np.ndarray, "points 2"]  # px
    weights: Float[np.ndarray, "points 2"]  # px/s
    length: float  # px

    def displacement(self, column: float, timing: ShutterTiming, samples: int) -> Float[np.ndarray, "rows samples 2"]:
        """How far this motion moves where the scanlines sample the latent image at a column, over their exposures."""
        return (timing.middle - timing.sample_times(samples))[..., None] * self.everywhere(np.array([column]), timing.rows)

    def tiles_needed(self, camera: Camera, tolerance: float) -> int:
        """How many column tiles keep what the motion at a tile's middle leaves of a blur at its edge below `tolerance` px."""
        lens, timing = camera.intrinsics, camera.timing
        most = max(1, lens.cols // tiles.NARROWEST)
        x, y = np.meshgrid(np.linspace(0, lens.cols - 1, most + 1), np.linspace(0, lens.rows - 1, most))
        velocity = self.at(np.stack([x, y], axis=-1).reshape(-1, 2)).reshape(most, most + 1, 2)
        change = float(np.linalg.norm(np.diff(velocity, axis=1), axis=-1).max())  # px/s between columns NARROWEST px apart
        count = most * change / (2 * tolerance) * max(timing.exposure, timing.interval[1] / (2 * tiles.BLENDED))
        return int(np.clip(np.ceil(count), 1, most))

    def scaled(self, factor: float) -> "Flow":
        """In px of the picture made smaller by a factor."""
        return replace(self, points=factor * (self.points + 0.5) - 0.5, weights=factor * self.weights, length=factor * self.length)

    def from_column(self, first: int) -> "Flow":
        """In the columns from `first` on."""
        return replace(self, points=self.points - (first, 0))

    def times(self, factor: float) -> "Flow":
        """So many times the velocities."""
        return replace(self, weights=factor * self.weights)

    @property
    def across(self) -> "Flow":
        """The same velocities turned by a right angle, as restoration.verdict.across turns a path."""
        return replace(self, weights=self.weights[:, ::-1] * (-1, 1))

    def at(self, places: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """px/s at each place (column, row)."""
        return _kernel(places, self.points, self.length) @ self.weights

    def everywhere(self, columns: Real[np.ndarray, " columns"], rows: int) -> Float[np.ndarray, "rows columns 2"]:
        """The same in these columns of all rows, from every few of them."""
        some = nodes(rows)
        found = self.at(np.stack(np.meshgrid(columns, some), axis=-1).reshape(-1, 2).astype(float)).reshape(len(some), -1)
        return np.stack([np.interp(np.arange(rows), some, column) for column in found.T], axis=1).reshape(rows, len(columns), 2)


def displacement(tile: Tile, path: Trajectory, flow: Flow | None, camera: Camera, samples: int) -> Float[np.ndarray, "rows samples 2"]:
    """Where the tile's scanlines sample the latent image over their exposures, relative to the pixel: along the path, less the flow."""
    return displacements([tile], path, flow, camera, samples)[0]


def displacements(
    cut: Sequence[Tile], path: Trajectory, flow: Flow | None, camera: Camera, samples: int
) -> Float[np.ndarray, "tiles rows samples 2"]:
    """The same of several tiles at once."""
    offsets = tiles.displacements(cut, path, camera, samples)
    return offsets + np.stack([flow.displacement(tile.middle, camera.timing, samples) for tile in cut]) if flow else offsets


def concatenated(parts: Sequence[Points]) -> Points:
    """The points of a frame that were followed from the one before, and to the next."""
    nothing = Points(at=np.zeros((0, 2)), moved=np.zeros((0, 2)), elapsed=np.zeros(0))
    at, moved, elapsed = zip(*((p.at, p.moved, p.elapsed) for p in (nothing, *parts)), strict=True)
    return Points(at=np.concatenate(at), moved=np.concatenate(moved), elapsed=np.concatenate(elapsed))


def flows(frames: Sequence[Points], longer: int) -> list[Flow | None]:
    """The field of each of a run's frames, whose longer side has `longer` px; None where points show nothing."""
    few = [points.thinned for points in frames]
    shown = [k for k, points in enumerate(few) if points.elapsed.any()]
    if not shown:
        return [None] * len(frames)
    probes = [few[k] for k in np.unique(np.array(shown)[np.linspace(0, len(shown) - 1, PROBES).round().astype(int)])]
    tried = [(speed, share * longer) for speed, share in itertools.product(SPEEDS, LENGTHS)]
    missed = threads.each(lambda how: sum(_missed(_solved(points, *how)[1], points) for points in probes), tried)
    best = int(np.argmin(missed))
    if missed[best] >= EXPLAINS * sum(_missed(points.moved, points) for points in probes):
        return [None] * len(frames)
    found = dict(zip(shown, threads.each(lambda k: _solved(few[k], *tried[best])[0], shown), strict=True))
    return [found.get(k) for k in range(len(few))]


def _solved(points: Points, speed: float, length: float) -> tuple[Flow, Float[np.ndarray, "points 2"]]:
    """The field, and how far each point lies from where the others predict it."""
    typical = float(np.sqrt(np.mean(points.elapsed**2)))
    kernel = _kernel(points.at, points.at, length)
    signal = (speed / typical) ** 2 * points.elapsed[:, None] * kernel * points.elapsed
    solved, off = np.zeros_like(points.moved), points.moved
    for _ in range(_ROUNDS):
        size = np.linalg.norm(off, axis=1)
        doubt = 1 + (size / (_OUTLIER * _scale(size))) ** 2  # 1 / w
        inverse = linalg.inv(signal + np.diag(TRACKED**2 * doubt), assume_a="pos", check_finite=False)
        solved = inverse @ points.moved
        off = solved / np.diag(inverse)[:, None]
    return Flow(points=points.at, weights=(speed / typical) ** 2 * points.elapsed[:, None] * solved, length=length), off


def _missed(off: Float[np.ndarray, "points 2"], points: Points) -> float:
    """Cauchy's measure of how far points lie off, in units of what no field leaves."""
    scale = _OUTLIER * _scale(np.linalg.norm(points.moved, axis=1))
    return float(np.log1p((off**2).sum(axis=1) / scale**2).mean())


def _scale(size: Float[np.ndarray, " points"]) -> float:
    return max(float(np.median(size)), TRACKED)


def _kernel(places: Float[np.ndarray, "n 2"], points: Float[np.ndarray, "m 2"], length: float) -> Float[np.ndarray, "n m"]:
    """Matern's of order 3/2: once differentiable."""
    away = np.sqrt(3) / length * cdist(places, points)
    return (1 + away) * np.exp(-away)
