"""Readout time from ordinary hand-held footage: the one that best explains how tracked points move at their own rows' times.

A point seen in row y of frame k and in row y' of frame k + 1 has moved by p(t_k+1 + y' t_r) - p(t_k + y t_r). With a global shutter all
rows of a pair of frames move alike; with a rolling one each row's displacement is the path's over a window of one frame's period, which
begins later from row to row, so that how displacements change down a frame must go on in the next. A motion of constant velocity says
nothing of t_r: it takes a hand's changes of pace.

For every pair of frames the displacements are summed up robustly as cubic polynomials of the row; roll and zoom are fitted beside them, and
for all frames together the perspective, so that no lens has to be known. The path is a Gaussian process (Matern's with 5/2, twice
differentiable, and a pan). How strong and how quick it is, and how noisy the tracks are, is chosen anew for every t_r; the evidence of what
is left is compared. A negative t_r is a readout from the bottom up.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize, minimize_scalar

from calibration.bands import CannotTellError
from rsvideo.physics.shutter import Direction

FEWEST_POINTS = 48  # of a pair of frames
FEWEST_PAIRS = 8
CHUNK = 16  # pairs that are explained together
MOST_CHUNKS = 12
_TERMS = 4  # of a row polynomial
_ZOOM = 2 * _TERMS  # where the zoom stands among a pair's coefficients
_USUAL_BEND, _BEND_SPREAD = 0.1, 0.2
_NODES = 6  # rows at which the path is asked
_ROUNDS = 8  # of reweighting
_REACH = 1.05  # of a frame's period, how long a readout is thought of
_STEPS = 22  # of the first search
_PAN = 2000.0  # px/s, the spread of the mean velocity
_BOUNDS = tuple(np.log([(0.05, 3000.0), (0.03, 1.5), (0.7, 100.0)]))  # strength in px, pace in s, noise of what its variance is thought
_START = np.log([10.0, 0.1, 1.0])
_RIVAL = 10.0  # log-likelihood by which any other readout must be worse
_MODEL = 0.03  # of the readout, what tracks of windows in blurred frames may be off by at best
_VAGUE = 0.07  # of the readout; a larger deviation is no answer
_NOTHING = 0.02  # of a frame's period; deviation with which a readout of nothing is told
_APART = 9.0  # mean square of deviations by which parts of a clip may disagree


@dataclass(frozen=True, kw_only=True, eq=False)
class Pair:
    """Points (x, y) seen in two frames, and when these begin."""

    before: Float[np.ndarray, "points 2"]
    after: Float[np.ndarray, "points 2"]
    begins: tuple[float, float]  # seconds


@dataclass(frozen=True, kw_only=True, eq=False)
class Explained:
    """The readout that explains a clip best."""

    readout: float  # seconds
    std: float
    direction: Direction | None  # None: a global shutter, or none that can be told from it
    curvature: float  # of the cost (minus the log-likelihood) at its lowest, per s^2
    over_global: float  # by how much a global shutter is less likely, in log-likelihood
    pairs: int
    readouts: Float[np.ndarray, " steps"]  # seconds, negative upwards: where the cost was computed
    costs: Float[np.ndarray, " steps"]


def explain(
    pairs: Sequence[Pair],
    *,
    rows: int,
    cols: int,
    period: float,
    downwards: tuple[Direction, Direction] = (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP),
    tell: Callable[[float], object] = float,
) -> Explained:
    """The readout of a clip whose frames are `period` apart; CannotTellError where its motion does not show it.

    Rows and y count scanlines, the way `downwards` says, and so do columns and x along them. `tell` is given the fraction that is done.
    """
    seen = _summed_up(pairs, rows, cols)
    if len(seen) < FEWEST_PAIRS:
        raise CannotTellError(
            f"only {len(seen)} pairs of frames have {FEWEST_POINTS} points that could be followed, {FEWEST_PAIRS} are needed;"
            " film something with texture in the whole frame"
        )
    chunks = _chunks(seen, rows)
    grid = np.linspace(-_REACH, _REACH, _STEPS) * period
    fits: list[_Fit] = []
    for step, readout in enumerate(grid):
        fits.append(_fit(chunks, readout / rows, fits[-1:]))
        tell((step + 1) / (_STEPS + 6))
    best = fits[int(np.argmax([fit.value for fit in fits]))]
    spacing = grid[1] - grid[0]
    best = _likeliest(chunks, best, spacing / rows)
    tell((_STEPS + 3) / (_STEPS + 6))
    readout = best.row_time * rows
    curvature, std = _spread(chunks, best, rows, spacing)
    others = [fit.value for fit in fits if abs(fit.row_time * rows - readout) > max(1.5 * spacing, 4 * std)]
    if not std < max(_VAGUE * abs(readout), _NOTHING * period) or abs(readout) > 0.98 * _REACH * period:
        known = (
            f"{1e3 * abs(readout):.3g} ms is likeliest, give or take {1e3 * std:.2g} ms"
            if std < period
            else "all readouts explain it alike"
        )
        advice = "move the camera by hand, without stabilisation, for some seconds before something with texture"
        raise CannotTellError(f"its motion does not show it: {known}; {advice}")
    if best.value - max(others) < _RIVAL:
        raise CannotTellError(f"readouts far from {1e3 * abs(readout):.3g} ms explain its motion nearly as well; film for longer")
    nothing = abs(readout) < 3 * std
    if not nothing and std > _VAGUE * abs(readout):
        given = f"{1e3 * abs(readout):.2g} ms give or take {1e3 * std:.2g} ms"
        raise CannotTellError(f"its motion shows only that the readout is short, {given}")
    tell(1.0)
    return Explained(
        readout=abs(readout),
        std=std,
        direction=None if nothing else downwards[0 if readout > 0 else 1],
        curvature=curvature,
        over_global=best.value - _fit(chunks, 0.0, (best,)).value,
        pairs=len(seen),
        readouts=grid,
        costs=np.array([best.value - fit.value for fit in fits]),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Seen:
    """What a pair's points say: how far rows move, as coefficients of Legendre's polynomials of the row, in x and in y."""

    moved: Float[np.ndarray, "2 terms"]  # px
    covariance: Float[np.ndarray, "2 terms terms"]
    rows: Float[np.ndarray, "2 nodes"]  # px from the frame's middle: some rows, and where their points are found in the second frame
    begins: tuple[float, float]


def _summed_up(pairs: Sequence[Pair], rows: int, cols: int) -> list[_Seen]:
    """All pairs that have points enough, under the perspective that suits them best."""
    usable = [
        pair for pair in pairs if len(pair.before) >= FEWEST_POINTS and np.ptp(np.quantile(pair.before[:, 1], [0.02, 0.98])) > rows / 2
    ]
    bend = _bend([_fitted(pair, rows, cols, None) for pair in usable])
    return [_seen(pair, rows, cols, bend) for pair in usable]


def _bend(fits: Sequence[tuple[np.ndarray, np.ndarray]]) -> float:
    """(rows / 2 f)^2 of a lens of focal length f: how the middle's motion goes with that of the sides, over all pairs."""
    top, bottom = _USUAL_BEND / _BEND_SPREAD**2, 1 / _BEND_SPREAD**2
    for found, covariance in fits:
        for middle, side in ((0, -2), (_TERMS, -1)):
            weight = 1 / (covariance[side, side] + (0.05 * found[middle]) ** 2)
            top, bottom = top + weight * found[middle] * found[side], bottom + weight * found[middle] ** 2
    return float(top / bottom)


def _seen(pair: Pair, rows: int, cols: int, bend: float) -> _Seen:
    found, covariance = _fitted(pair, rows, cols, bend)
    low, high = np.quantile(2 * pair.before[:, 1] / rows - (rows - 1) / rows, [0.02, 0.98]).tolist()
    nodes = np.linspace(low, high, _NODES)
    in_x, in_y = slice(0, _TERMS), slice(_TERMS, 2 * _TERMS)
    down = legendre.legvander(nodes, _TERMS - 1) @ found[in_y] * (1 + bend * nodes**2) + found[_ZOOM] * nodes * rows / 2
    return _Seen(
        moved=np.stack([found[in_x], found[in_y]]),
        covariance=np.stack([covariance[in_x, in_x], covariance[in_y, in_y]]),
        rows=np.stack([nodes * rows / 2, nodes * rows / 2 + down]),
        begins=pair.begins,
    )


def _fitted(pair: Pair, rows: int, cols: int, bend: float | None) -> tuple[np.ndarray, np.ndarray]:
    """Coefficients of a pair's displacements, with their covariance: shift in x and in y by rows, zoom, roll by rows, and, where `bend` is
    not known, the perspective of a turn about y and about x."""
    x, y = (pair.before - np.array([(cols - 1) / 2, (rows - 1) / 2])).T
    s, u = 2 * y / rows, 2 * x / rows
    row, k = legendre.legvander(s, _TERMS - 1), bend or 0.0
    roll = s[:, None] ** np.arange(3)
    across = [row * (1 + k * u * u)[:, None], row * (k * u * s)[:, None], x, -y[:, None] * roll]
    down = [row * (k * u * s)[:, None], row * (1 + k * s * s)[:, None], y, x[:, None] * roll]
    if bend is None:
        across, down = [*across, u * u, u * s], [*down, u * s, s * s]
    design, moved = np.stack([np.column_stack(across), np.column_stack(down)]), pair.after - pair.before
    weights = np.ones_like(s)
    normal, found, size = np.eye(1), np.zeros(1), weights
    for _ in range(_ROUNDS):
        normal = np.einsum("cni,n,cnj->ij", design, weights, design) + 1e-9 * np.eye(design.shape[2])
        found = np.linalg.solve(normal, np.einsum("cni,n,nc->i", design, weights, moved))
        size = np.linalg.norm(moved - np.einsum("cni,i->nc", design, found), axis=1)
        weights = 1 / (1 + (size / (2 * max(float(np.median(size)), 0.02))) ** 2)  # Cauchy's
    return found, float(np.sum(weights * size**2) / (2 * np.sum(weights))) * np.linalg.inv(normal)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Chunk:
    """Pairs that follow each other, along one axis, as one Gaussian vector."""

    axis: int
    moved: Float[np.ndarray, " numbers"]
    noise: Float[np.ndarray, "numbers numbers"]
    terms: Float[np.ndarray, "pairs terms nodes"]  # from displacements at the nodes to coefficients
    rows: Float[np.ndarray, "2 pairs nodes"]
    begins: Float[np.ndarray, "2 pairs"]

    def evidence(self, row_time: float, hyper: np.ndarray) -> tuple[float, np.ndarray]:
        """The log-likelihood of a readout, and its slope in the logarithms of strength (px), pace (s) and noise (of variance)."""
        strength, length, noise = np.exp(hyper)
        at = self.begins[:, :, None] + row_time * self.rows
        both = np.concatenate([at[1].ravel(), at[0].ravel()])
        r = np.abs(both[:, None] - both) * (np.sqrt(5) / length)
        decay = strength**2 * np.exp(-r)
        path = self._displaced(decay * (1 + r + r * r / 3))
        slower = self._displaced(decay * (r * r * (1 + r) / 3))  # its derivative in log length
        pan = np.einsum("iap,ip->ia", self.terms, at[1] - at[0]).ravel()
        covariance = path + noise * self.noise + _PAN**2 * np.outer(pan, pan) + 1e-6 * np.eye(len(pan))
        factor = cho_factor(covariance, lower=True)
        solved = cho_solve(factor, self.moved)
        left = np.outer(solved, solved) - cho_solve(factor, np.eye(len(pan)))
        slope = 0.5 * np.array([np.sum(left * part) for part in (2 * path, slower, noise * self.noise)])
        return float(-0.5 * self.moved @ solved - np.log(np.diag(factor[0])).sum()), slope

    def _displaced(self, kernel: np.ndarray) -> np.ndarray:
        """The covariance of coefficients of displacements, from that of positions."""
        n = len(kernel) // 2
        pairs, terms, nodes = self.terms.shape
        moved = (kernel[:n, :n] - kernel[:n, n:] - kernel[n:, :n] + kernel[n:, n:]).reshape(pairs, nodes, pairs, nodes)
        half = np.einsum("iap,ipjq->iajq", self.terms, moved, optimize=True)
        return np.einsum("iajq,jbq->iajb", half, self.terms, optimize=True).reshape(pairs * terms, pairs * terms)


def _chunks(seen: Sequence[_Seen], rows: int) -> list[_Chunk]:
    count = max(1, round(len(seen) / CHUNK))
    found = []
    for part in np.array_split(np.arange(len(seen)), count)[:MOST_CHUNKS]:
        chosen = [seen[k] for k in part]
        for axis in (0, 1):
            noise = np.zeros((len(chosen), _TERMS, len(chosen), _TERMS))
            for k, one in enumerate(chosen):
                noise[k, :, k] = one.covariance[axis]
            found.append(
                _Chunk(
                    axis=axis,
                    moved=np.concatenate([one.moved[axis] for one in chosen]),
                    noise=noise.reshape(len(chosen) * _TERMS, -1),
                    terms=np.stack([np.linalg.pinv(legendre.legvander(2 * one.rows[0] / rows, _TERMS - 1)) for one in chosen]),
                    rows=np.stack([one.rows for one in chosen], axis=1),
                    begins=np.array([one.begins for one in chosen]).T,
                )
            )
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class _Fit:
    """The likeliest path and noise at one row time."""

    row_time: float  # seconds, negative upwards
    value: float  # log-likelihood
    hyper: tuple[np.ndarray, np.ndarray]  # of x and of y


def _fit(chunks: Sequence[_Chunk], row_time: float, others: Sequence[_Fit], *, warm: bool = False) -> _Fit:
    """From where others ended, and from a usual start unless `warm`."""
    values, hypers = [], []
    for axis in (0, 1):
        mine = [chunk for chunk in chunks if chunk.axis == axis]
        if not mine:
            hypers.append(others[0].hyper[axis])
            continue

        def cost(hyper: np.ndarray, mine: Sequence[_Chunk] = mine) -> tuple[float, np.ndarray]:
            parts = [chunk.evidence(row_time, hyper) for chunk in mine]
            return -sum(part[0] for part in parts), -np.sum([part[1] for part in parts], axis=0)

        starts = [other.hyper[axis] for other in others] + ([] if warm else [_START])
        tried = [minimize(cost, start, jac=True, method="L-BFGS-B", bounds=_BOUNDS, options={"maxiter": 30}) for start in starts]
        best = min(tried, key=lambda one: one.fun)
        values.append(-float(best.fun))
        hypers.append(np.asarray(best.x))
    return _Fit(row_time=row_time, value=sum(values), hyper=(hypers[0], hypers[1]))


def _likeliest(chunks: Sequence[_Chunk], near: _Fit, reach: float) -> _Fit:
    """The likeliest row time within `reach` of one, path and noise chosen for each."""
    fits = [near]

    def cost(at: float) -> float:
        fits.append(_fit(chunks, float(at), fits[:1], warm=True))
        return -fits[-1].value

    bounds = (near.row_time - reach, near.row_time + reach)
    minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": 0.01 * reach, "maxiter": 14})
    return max(fits, key=lambda fit: fit.value)


def _curvature(chunks: Sequence[_Chunk], fit: _Fit, step: float) -> float:
    """Minus the second derivative of the log-likelihood in the row time, over a step that costs about one."""
    for _ in range(8):
        sides = [_fit(chunks, fit.row_time + way * step, (fit,), warm=True).value for way in (-1, 1)]
        if (cost := 2 * fit.value - sum(sides)) < 4:
            return max(cost, 0.0) / step**2
        step /= 2
    return 4 / (4 * step**2)


def _spread(chunks: Sequence[_Chunk], fit: _Fit, rows: int, spacing: float) -> tuple[float, float]:
    """The curvature of the cost in the readout, and its standard deviation, larger where parts of the clip disagree."""
    step = spacing / rows / 4
    total = _curvature(chunks, fit, step)
    misfits = []
    for chunk in chunks:
        own = _likeliest([chunk], _fit([chunk], fit.row_time, (fit,), warm=True), 2 * spacing / rows)
        misfits.append((own.row_time - fit.row_time) ** 2 * _curvature([chunk], own, step))
    factor = max(1.0, sum(misfits) / max(len(misfits) - 1, 1))
    if factor > _APART:
        raise CannotTellError(
            f"parts of the clip disagree by {np.sqrt(factor):.1f} deviations; is it stabilised, or does much of the scene move?"
        )
    std = np.inf if total <= 0 else rows * np.sqrt(factor / total)
    return total / rows**2, float(np.hypot(std, _MODEL * max(abs(fit.row_time) * rows, spacing)))
