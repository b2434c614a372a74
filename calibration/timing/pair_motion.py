"""How rows move from one frame to the next: points that were tracked, summed up robustly as polynomials of the row.

Roll and zoom are fitted beside them, and for all frames together the perspective, so that no lens has to be given.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre

FEWEST_POINTS = 48  # of a pair of frames
TERMS = 4  # of a polynomial of the row: cubic
_ZOOM = 2 * TERMS  # where the zoom stands among a pair's coefficients
_NODES = 6  # rows at which the path is evaluated
_ROWS_COVERED = (0.02, 0.98)  # quantiles of the points' rows, between which they speak for rows
_LEAST_SPAN = 0.5  # of the frame's height, that points must cover
_USUAL_BEND, _BEND_SPREAD = 0.1, 0.2  # (rows / 2 f)^2 of usual lenses, and how far lenses differ from it
_BEND_ERROR = 0.05  # of a displacement, by which it may bend otherwise
_MOVED = 5.0  # standard errors, by which the middle must move for a pair to say anything of the perspective
_ROUNDS = 8  # of reweighting
_CAUCHY = 2  # times the median residual, at which a point counts half
_LEAST_RESIDUAL = 0.02  # px; how well points are tracked at best
_RIDGE = 1e-9  # of the normal equations, for what the points do not show


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """Points (x, y) observed in two frames, and when these begin."""

    before: Float[np.ndarray, "points 2"]
    after: Float[np.ndarray, "points 2"]
    begins: tuple[float, float]  # seconds


@dataclass(frozen=True, kw_only=True, eq=False)
class RowMotion:
    """How far rows move from one frame to the next, as coefficients of Legendre polynomials of the row, in x and in y."""

    moved: Float[np.ndarray, "2 terms"]  # px
    covariance: Float[np.ndarray, "2 terms terms"]
    rows: Float[np.ndarray, "2 nodes"]  # px from the frame's middle: some rows, and where their points are found in the second frame
    begins: tuple[float, float]


def summarise(pairs: Sequence[Pair], rows: int, cols: int) -> list[RowMotion]:
    """All pairs that have points enough, under the perspective that suits them best."""
    usual = 1 / _BEND_SPREAD**2
    shown = perspective(pairs, rows, cols)
    bend = (usual * _USUAL_BEND + shown.precision * shown.bend) / (usual + shown.precision)
    return [_row_motion(pair, rows, cols, bend) for pair in _usable(pairs, rows)]


@dataclass(frozen=True, kw_only=True)
class Perspective:
    """(rows / 2 f)^2 of a lens of focal length f, as a clip shows it."""

    bend: float
    precision: float  # 1 / variance, which is larger where pairs disagree; 0 where the clip shows nothing


def perspective(pairs: Sequence[Pair], rows: int, cols: int) -> Perspective:
    """How much faster the sides move than the middle, over all pairs, as the camera turns."""
    moved, sides, weights = [0.0], [0.0], [0.0]
    for pair in _usable(pairs, rows):
        found, covariance = _fitted(pair, rows, cols, None)
        for middle, side in ((0, -2), (TERMS, -1)):
            if found[middle] ** 2 > _MOVED**2 * covariance[middle, middle]:
                moved.append(found[middle])
                sides.append(found[side])
                weights.append(1 / (covariance[side, side] + (_BEND_ERROR * found[middle]) ** 2))
    m, s, w = np.array(moved), np.array(sides), np.array(weights)
    precision = float(w @ m**2)
    if not precision:
        return Perspective(bend=0.0, precision=0.0)
    bend = float(w @ (m * s)) / precision
    disagreement = float(w @ (s - bend * m) ** 2) / max(len(w) - 2, 1)
    return Perspective(bend=bend, precision=precision / max(1.0, disagreement))


def _usable(pairs: Sequence[Pair], rows: int) -> list[Pair]:
    return [
        pair
        for pair in pairs
        if len(pair.before) >= FEWEST_POINTS and np.ptp(np.quantile(pair.before[:, 1], _ROWS_COVERED)) > _LEAST_SPAN * rows
    ]


def _row_motion(pair: Pair, rows: int, cols: int, bend: float) -> RowMotion:
    found, covariance = _fitted(pair, rows, cols, bend)
    low, high = np.quantile(2 * pair.before[:, 1] / rows - (rows - 1) / rows, _ROWS_COVERED).tolist()
    nodes = np.linspace(low, high, _NODES)
    in_x, in_y = slice(0, TERMS), slice(TERMS, 2 * TERMS)
    down = legendre.legvander(nodes, TERMS - 1) @ found[in_y] * (1 + bend * nodes**2) + found[_ZOOM] * nodes * rows / 2
    return RowMotion(
        moved=np.stack([found[in_x], found[in_y]]),
        covariance=np.stack([covariance[in_x, in_x], covariance[in_y, in_y]]),
        rows=np.stack([nodes * rows / 2, nodes * rows / 2 + down]),
        begins=pair.begins,
    )


def _fitted(pair: Pair, rows: int, cols: int, bend: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of a pair's displacements, with their covariance: shift in x and in y by rows, zoom, roll by rows, and, where `bend` is
    not given, the perspective of a turn about y and about x."""
    x, y = (pair.before - np.array([(cols - 1) / 2, (rows - 1) / 2])).T
    s, u = 2 * y / rows, 2 * x / rows
    row, k = legendre.legvander(s, TERMS - 1), bend or 0.0
    roll = s[:, None] ** np.arange(3)
    across = [row * (1 + k * u * u)[:, None], row * (k * u * s)[:, None], x, -y[:, None] * roll]
    down = [row * (k * u * s)[:, None], row * (1 + k * s * s)[:, None], y, x[:, None] * roll]
    if bend is None:
        across, down = [*across, u * u, u * s], [*down, u * s, s * s]
    design, moved = np.stack([np.column_stack(across), np.column_stack(down)]), pair.after - pair.before
    weights = np.ones_like(s)
    normal, found, size = np.eye(1), np.zeros(1), weights
    for _ in range(_ROUNDS):
        normal = np.einsum("cni,n,cnj->ij", design, weights, design) + _RIDGE * np.eye(design.shape[2])
        found = np.linalg.solve(normal, np.einsum("cni,n,nc->i", design, weights, moved))
        size = np.linalg.norm(moved - np.einsum("cni,i->nc", design, found), axis=1)
        weights = 1 / (1 + (size / (_CAUCHY * max(float(np.median(size)), _LEAST_RESIDUAL))) ** 2)  # Cauchy's
    return found, float(np.sum(weights * size**2) / (2 * np.sum(weights))) * np.linalg.inv(normal)
