"""A frame as column tiles, in each of which the path depends on the scanline alone.

With roll, or a wide lens, the path of a pixel also depends on its column, but slowly: within a narrow tile the path at
its middle column serves them all, and the tile keeps the exact row-Fourier solver of a shift.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from jaxtyping import Float

from rsvideo.physics.camera import Camera, Intrinsics, lever, turned
from rsvideo.physics.trajectory import Trajectory

NARROWEST = 32  # columns a tile keeps for itself; narrower ones cost more and gain nothing
_INSTANTS = 33  # of a frame's interval, at which the tiles' errors are measured; origin: by trial
_PARTS, _ROWS = 2, 2  # parts across and lines down the frame whose moves are compared: a homography's change is smooth
_BENT_PARTS, _BENT_ROWS = 16, 3  # the same through a lens, which bends paths quickest somewhere between middle and edge; origin: by trial
BLENDED = 3  # times the error of a blur that a shift of whole scanlines may have, since blending between tiles hides it; origin: by trial


@dataclass(frozen=True, kw_only=True)
class Tile:
    """Columns [first, last) are read by the tile, columns [start, stop) of them belong to it."""

    first: int
    last: int
    start: int
    stop: int

    @property
    def columns(self) -> slice:
        """What the tile reads of a frame's columns."""
        return slice(self.first, self.last)

    @property
    def middle(self) -> float:
        """The column whose path stands for the tile."""
        return 0.5 * (self.start + self.stop - 1)

    def weight(self, overlap: int) -> Float[np.ndarray, " cols"]:
        """Of each column the tile reads, where its picture is blended with its neighbours' over `overlap` columns beyond its own."""
        columns = np.arange(self.first, self.last)
        depth = np.minimum(columns - self.start, self.stop - 1 - columns) + overlap + 1  # 1 at the outermost shared column
        return np.clip(depth / (2 * overlap), 0, 1).astype(np.float32)


class MadeAnew(Sequence[Any]):
    """What belongs to each tile, made on its use, and not kept."""

    def __init__(self, make: Callable[[int], Any], count: int) -> None:
        self._make, self._count = make, count

    def __len__(self) -> int:
        return self._count

    def __getitem__(self, k: Any) -> Any:
        """Of tile `k`."""
        if not 0 <= k < self._count:
            raise IndexError(k)
        return self._make(k)


def split(cols: int, count: int, overlap: int) -> list[Tile]:
    """`count` tiles of equal width that see `overlap` columns beyond their own on either side."""
    edges = np.linspace(0, cols, count + 1).round().astype(int).tolist()
    return [Tile(first=max(0, a - overlap), last=min(cols, b + overlap), start=a, stop=b) for a, b in pairwise(edges)]


def tiles_needed(trajectory: Trajectory, camera: Camera, tolerance: float) -> int:
    """How many tiles keep the path's error at a tile's edge below `tolerance` px (two axes: one tile)."""
    intrinsics, timing = camera.intrinsics, camera.timing
    times = np.linspace(*timing.interval, _INSTANTS)
    poses = trajectory.at(times)
    if poses.shape[1] == 2:
        return 1
    parts, rows = (_BENT_PARTS, _BENT_ROWS) if intrinsics.distortion else (_PARTS, _ROWS)
    x, y = np.meshgrid(np.linspace(0, intrinsics.cols - 1, parts + 1), np.linspace(0, intrinsics.rows - 1, rows))
    moved = turned(intrinsics, x[..., None] + 0 * times, y[..., None] + 0 * times, np.broadcast_to(poses, (*x.shape, *poses.shape)))
    within = max(1, round(len(times) * timing.exposure / timing.interval[1]))  # only what moves within one exposure blurs
    change = np.diff(moved, axis=1)  # between columns
    spread = max(
        float(np.linalg.norm(change[:, :, i : i + within].max(axis=2) - change[:, :, i : i + within].min(axis=2), axis=-1).max())
        for i in range(len(times) - within + 1)
    )
    whole = float(np.linalg.norm(change, axis=-1).max())  # a shift of whole scanlines, blended between tiles
    count = parts / 2 * max(spread / (2 * tolerance), whole / (2 * BLENDED * tolerance))
    return int(np.clip(np.ceil(count), 1, max(1, intrinsics.cols // NARROWEST)))


def displacement(tile: Tile, trajectory: Trajectory, camera: Camera, samples: int) -> Float[np.ndarray, "rows samples 2"]:
    """Where the tile's scanlines sample the latent image over their exposures, relative to the pixel."""
    return displacements([tile], trajectory, camera, samples)[0]


def displacements(cut: Sequence[Tile], trajectory: Trajectory, camera: Camera, samples: int) -> Float[np.ndarray, "tiles rows samples 2"]:
    """The same of several tiles at once, which share the rotations."""
    poses = trajectory.at(camera.timing.sample_times(samples))
    middles = np.array([tile.middle for tile in cut])
    rows = np.arange(camera.timing.rows, dtype=float)
    return turned(camera.intrinsics, middles[:, None, None], rows[None, :, None], poses[None])


def levers(tile: Tile, intrinsics: Intrinsics, rows: int, axes: int) -> Float[np.ndarray, "rows 2 axes"]:
    """The derivative of `displacement` in each scanline's pose."""
    return lever(intrinsics, np.full(rows, tile.middle), np.arange(rows, dtype=float), axes)
