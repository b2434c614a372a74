"""What the points between neighbouring frames say of a path: equations that are linear in its coefficients.

A point tracked from one frame to the next observes the mean pose over one scanline's exposure against that over another's, each at its
own time. What the scene's depth adds to that is smooth over the picture: a quadratic field of each pair beside the path.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from rsvideo.physics.camera import Camera, lever
from rsvideo.physics.trajectory import Spline
from rsvideo.restoration.tracks import Tracks

INDEPENDENT = 20  # points of a pair that count; the others share their errors, which blur causes; origin: by trial
OUTLIER = 2.0  # times the typical residual, at which a point counts half (Cauchy's weights)
NODES = 33  # rows at which the basis is averaged; others by linear interpolation
SAMPLES = 8  # of a row's exposure, over which the basis is averaged
FIELDS = 9  # vector fields that are quadratic in the place, but for shifts and roll, which are the camera's
_ROUNDING = 1e-9  # rows: keeps the last of a range inside it


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """The points between two frames as linear equations: moved = design @ coefficients."""

    design: Float[np.ndarray, "points terms"]  # of the mean pose at the second sight, less that at the first
    levers: Float[np.ndarray, "points 2 axes"]
    fields: Float[np.ndarray, "points 2 fields"]  # what the scene's depth may add
    elapsed: Float[np.ndarray, " points"]  # s, from the middle of the first sight's exposure to that of the second
    moved: Float[np.ndarray, "points 2"]
    error: float  # px, of a point at best

    @classmethod
    def of(cls, tracks: Tracks, begins: np.ndarray, back: list[bool], camera: Camera, path: Spline) -> "Pair":
        timing = camera.timing
        nodes = np.linspace(0, timing.rows - 1, NODES)
        times = nodes[:, None] * timing.row_time + timing.sample_times(SAMPLES)[0]
        poses, when = [], []
        for at, turned, points in zip(begins, back, (tracks.before, tracks.after), strict=True):
            open_at = (times[::-1] if turned else times) + at
            basis = path.basis(open_at).mean(axis=1)
            place = np.clip(points[:, 1] / (timing.rows - 1) * (NODES - 1), 0, NODES - 1 - _ROUNDING)
            low, share = place.astype(int), (place % 1)[:, None]
            poses.append((1 - share) * basis[low] + share * basis[low + 1])
            when.append(np.interp(points[:, 1], nodes, open_at.mean(axis=1)))
        middle = 0.5 * (tracks.before + tracks.after)
        return cls(
            design=poses[1] - poses[0],
            levers=lever(camera.intrinsics, middle[:, 0], middle[:, 1], path.coefficients.shape[1]),
            fields=_fields(camera, middle) * float(begins[1] != begins[0]),  # two views of one moment show the same depth
            elapsed=when[1] - when[0],
            moved=tracks.before - tracks.after,  # a camera that moves right moves the image left
            error=tracks.error,
        )

    @cached_property
    def unknowns(self) -> Int[np.ndarray, " touched"]:
        """The numbers of those coefficients of the path, row by row, that the points depend on: a spline's pieces are local."""
        axes = self.levers.shape[-1]
        return (axes * np.flatnonzero(self.design.any(axis=0))[:, None] + np.arange(axes)).ravel()

    @cached_property
    def path(self) -> Float[np.ndarray, "points 2 touched"]:
        """How far these coefficients move each point."""
        moved = np.einsum("nca,nt->ncta", self.levers, self.design[:, self.design.any(axis=0)])
        return moved.reshape(len(moved), 2, -1)

    def residual(self, coefficients: Float[np.ndarray, "terms axes"]) -> Float[np.ndarray, "points 2"]:
        """What a path leaves of how far the camera seems to have moved."""
        return self.moved - np.einsum("nca,na->nc", self.levers, self.design @ coefficients)

    def weights(self, coefficients: Float[np.ndarray, "terms axes"], field: Float[np.ndarray, " fields"]) -> Float[np.ndarray, " points"]:
        """Of the points, in 1 / px^2: by how well they fit the path and a field (Cauchy), and as if a few were independent."""
        size = np.linalg.norm(self.residual(coefficients) - self.fields @ field, axis=1)
        scale = max(float(np.median(size)), self.error)
        return min(1.0, INDEPENDENT / len(size)) / (1 + (size / (OUTLIER * scale)) ** 2) / scale**2

    def field_covariance(
        self, weight: Float[np.ndarray, " points"], variance: Float[np.ndarray, " fields"]
    ) -> Float[np.ndarray, "fields fields"]:
        """Of the pair's field, for a given path."""
        fields = self.fields.reshape(2 * len(weight), -1)
        return np.linalg.inv(np.diag(1 / variance) + (fields.T * np.repeat(weight, 2)) @ fields)

    def system(
        self, weight: Float[np.ndarray, " points"], common: Float[np.ndarray, " fields"], variance: Float[np.ndarray, " fields"]
    ) -> "System":
        """The pair's equations without its field, which lies about the `common` one."""
        path, beside = (each.reshape(2 * len(weight), -1) for each in (self.path, self.fields))
        moved = self.moved.ravel() - beside @ common
        weighted = beside.T * np.repeat(weight, 2)
        covariance = self.field_covariance(weight, variance)
        across, by_field = weighted @ path, weighted @ moved
        own = path.T * np.repeat(weight, 2)
        return System(
            unknowns=self.unknowns,
            precision=own @ path - across.T @ covariance @ across,
            right=own @ moved - across.T @ covariance @ by_field,
            covariance=covariance,
            across=across,
            by_field=by_field,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class System:
    """Normal equations of a pair in those coefficients of the path that it touches, its field eliminated (Schur complement)."""

    unknowns: Int[np.ndarray, " touched"]  # the numbers of these coefficients, row by row
    precision: Float[np.ndarray, "touched touched"]
    right: Float[np.ndarray, " touched"]
    covariance: Float[np.ndarray, "fields fields"]  # of the field, for a given path
    across: Float[np.ndarray, "fields touched"]
    by_field: Float[np.ndarray, " fields"]

    def deviation(self, coefficients: Float[np.ndarray, "terms axes"]) -> Float[np.ndarray, " fields"]:
        """Of the likeliest field beside a path from the common one, px."""
        return self.covariance @ (self.by_field - self.across @ coefficients.ravel()[self.unknowns])

    def field_variance(self, covariance: Float[np.ndarray, "unknowns unknowns"]) -> Float[np.ndarray, " fields"]:
        """How uncertain the field is, if the path has this covariance."""
        by_path = self.covariance @ self.across
        touched = covariance[np.ix_(self.unknowns, self.unknowns)]
        return np.diag(self.covariance) + (by_path @ touched * by_path).sum(axis=1)


def _fields(camera: Camera, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2 fields"]:
    """The vector fields at each point; places are from the picture's centre, in halves of its longer side."""
    lens = camera.intrinsics
    x, y = ((points - (lens.cx, lens.cy)) / (max(lens.rows, lens.cols) / 2)).T
    bent, none = [x * x, x * y, y * y], 0 * x
    sideways = [x, x, y, *bent, none, none, none]  # zoom, two kinds of shear, and curvature
    down = [y, -y, x, none, none, none, *bent]
    return np.stack([np.stack(sideways, axis=1), np.stack(down, axis=1)], axis=1)


def pairs_of(tracks: Sequence[Tracks], begins: np.ndarray, backwards: Sequence[int], camera: Camera, path: Spline) -> list[Pair]:
    """The equations of all neighbouring frames, in the coefficients of paths like this one."""
    back = [k in backwards for k in range(len(begins))]
    return [Pair.of(t, begins[k : k + 2], back[k : k + 2], camera, path) for k, t in enumerate(tracks)]
