"""How likely a row time is, given how rows moved: the camera's path is a Gaussian process.

The path is Matern's with 5/2, twice differentiable, and a pan. How strong and how quick it is, and how noisy the tracks are, is chosen
anew for every row time; the evidence of what is left is compared. Where an engine shakes the camera, tones of the frequencies that
explain most are added. A negative row time is a readout from the bottom up. Where a clip was stabilised, each frame was shifted after it
was read, so that every pair has a shift of its own beside the path.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre
from scipy.linalg import block_diag, cho_factor, cho_solve
from scipy.optimize import minimize, minimize_scalar

from calibration.timing.pair_motion import TERMS, RowMotion
from rsvideo.physics import vibration

_CHUNK_PAIRS = 16  # pairs that are explained together
_MOST_CHUNKS = 12  # more add time and little else
_PAN_PX_PER_S = 2000.0  # the spread of the mean velocity
_NUGGET = 1e-6  # px^2, that keeps covariances definite
_BOUNDS = tuple(np.log([(0.05, 3000.0), (0.03, 1.5), (0.7, 100.0)]))  # strength in px, pace in s, noise of what its variance is thought
_START = np.log([10.0, 0.1, 1.0])  # of the same
_STEPS = 30  # of L-BFGS-B, for strength, pace and noise
_RESOLVED, _TRIALS = 0.01, 14  # of the search's reach, to which a row time is found; and row times tried
_QUADRATIC = 4.0  # fall of the log-likelihood over a step of both sides, up to which it is about quadratic
_TONE_STEP = 0.25  # Hz, from one tone that is tried to the next
_VIBRATING = 30.0  # of the likeliest row time, that all tones must add; vibrating clips had 58 and more, one wrong readout 13
_MOST_TONES = 2  # along either axis
_HALVINGS = 8  # of a step that costs more


@dataclass(frozen=True, kw_only=True, eq=False)
class Chunk:
    """Pairs that follow each other, along one axis, as one Gaussian vector."""

    axis: int
    moved: Float[np.ndarray, " numbers"]
    noise: Float[np.ndarray, "numbers numbers"]
    coefficients: Float[np.ndarray, "numbers places"]  # of displacements at the nodes of all pairs
    rows: Float[np.ndarray, "2 pairs nodes"]
    begins: Float[np.ndarray, "2 pairs"]
    tones: tuple[float, ...] = ()  # Hz
    shift: float = 0.0  # px, the deviation of a shift that each pair has beside the path

    def evidence(self, row_time: float, hyper: np.ndarray) -> tuple[float, np.ndarray]:
        """The log-likelihood of a readout, and its slope in the logarithms of strength (px), pace (s) and noise (of variance)."""
        path, slower, covariance = self._covariances(row_time, hyper)
        factor = cho_factor(covariance, lower=True, check_finite=False)
        inverse = cho_solve(factor, np.eye(len(covariance)), check_finite=False)
        solved = inverse @ self.moved
        left = np.outer(solved, solved) - inverse
        slope = 0.5 * np.array([np.vdot(left, part) for part in (2 * path, slower, np.exp(hyper[2]) * self.noise)])
        return float(-0.5 * self.moved @ solved - np.log(np.diag(factor[0])).sum()), slope

    def gains(self, row_time: float, hyper: np.ndarray, tones: Float[np.ndarray, " tones"]) -> Float[np.ndarray, " tones"]:
        """By how much each tone adds to the log-likelihood."""
        factor = cho_factor(self._covariances(row_time, hyper)[2], lower=True)
        waves = self._waves(self._times(row_time), tones)
        solved = cho_solve(factor, waves.reshape(len(waves), -1)).reshape(waves.shape)
        precision = np.einsum("nfi,nfj->fij", waves, solved) + np.eye(2) / vibration.SPREAD**2
        right = np.einsum("nfi,n->fi", solved, self.moved)
        explained = (right * np.linalg.solve(precision, right[..., None])[..., 0]).sum(axis=1)
        return 0.5 * explained - 0.5 * np.linalg.slogdet(vibration.SPREAD**2 * precision)[1]

    def _covariances(self, row_time: float, hyper: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Of the coefficients: by the path, its derivative in log pace, and by all that moves them."""
        strength, length, noise = np.exp(hyper)
        at = self._times(row_time)
        path, slower = (
            self.coefficients @ (here + there - across - across.T) @ self.coefficients.T
            for here, there, across in zip(*(_matern(at[i], at[j], strength, length) for i, j in ((0, 0), (1, 1), (0, 1))), strict=True)
        )
        pan = self.coefficients @ (at[1] - at[0])
        tones = vibration.SPREAD * self._waves(at, np.array(self.tones)).reshape(len(pan), 2 * len(self.tones))
        sure = noise * self.noise + _PAN_PX_PER_S**2 * np.outer(pan, pan) + tones @ tones.T + _NUGGET * np.eye(len(pan))
        sure[::TERMS, ::TERMS] += self.shift**2 * np.eye(len(pan) // TERMS)
        return path, slower, path + sure

    def _times(self, row_time: float) -> Float[np.ndarray, "2 places"]:
        return (self.begins[:, :, None] + row_time * self.rows).reshape(2, -1)

    def _waves(self, at: Float[np.ndarray, "2 places"], tones: Float[np.ndarray, " tones"]) -> Float[np.ndarray, "numbers tones 2"]:
        """The coefficients of displacements by the cosine and the sine of each tone."""
        phases = 2 * np.pi * at[..., None] * tones
        moved = np.stack([np.cos(phases[1]) - np.cos(phases[0]), np.sin(phases[1]) - np.sin(phases[0])], axis=-1)
        return (self.coefficients @ moved.reshape(len(moved), -1)).reshape(len(self.moved), len(tones), 2)


def _matern(
    one: Float[np.ndarray, " m"], other: Float[np.ndarray, " n"], strength: float, length: float
) -> tuple[Float[np.ndarray, "m n"], Float[np.ndarray, "m n"]]:
    """Matern's covariance with 5/2 of positions at such times, and its derivative in the logarithm of the length."""
    r = np.abs(one[:, None] - other) * (np.sqrt(5) / length)
    decay, curve = strength**2 * np.exp(-r), r * r / 3
    return decay * (1 + r + curve), decay * curve * (1 + r)


def chunked(motions: Sequence[RowMotion], rows: int) -> list[Chunk]:
    """Pairs in groups that are explained together, along x and along y."""
    count = max(1, round(len(motions) / _CHUNK_PAIRS))
    found = []
    for part in np.array_split(np.arange(len(motions)), count)[:_MOST_CHUNKS]:
        chosen = [motions[k] for k in part]
        to_coefficients = [np.linalg.pinv(legendre.legvander(2 * one.rows[0] / rows, TERMS - 1)) for one in chosen]
        for axis in (0, 1):
            found.append(
                Chunk(
                    axis=axis,
                    moved=np.concatenate([one.moved[axis] for one in chosen]),
                    noise=np.asarray(block_diag(*(one.covariance[axis] for one in chosen))),
                    coefficients=np.asarray(block_diag(*to_coefficients)),
                    rows=np.stack([one.rows for one in chosen], axis=1),
                    begins=np.array([one.begins for one in chosen]).T,
                )
            )
    return found


@dataclass(frozen=True, kw_only=True, eq=False)
class PathFit:
    """The likeliest path and noise at one row time."""

    row_time: float  # seconds, negative upwards
    value: float  # log-likelihood
    hyper: tuple[np.ndarray, np.ndarray]  # of x and of y


def fit_path(chunks: Sequence[Chunk], row_time: float, others: Sequence[PathFit], *, warm: bool = False) -> PathFit:
    """From where others ended, and from a usual start unless `warm`."""
    values, hypers = [], []
    for axis in (0, 1):
        mine = [chunk for chunk in chunks if chunk.axis == axis]
        if not mine:
            hypers.append(others[0].hyper[axis])
            continue

        def cost(hyper: np.ndarray, mine: Sequence[Chunk] = mine) -> tuple[float, np.ndarray]:
            parts = [chunk.evidence(row_time, hyper) for chunk in mine]
            return -sum(part[0] for part in parts), -np.sum([part[1] for part in parts], axis=0)

        starts = [other.hyper[axis] for other in others] + ([] if warm else [_START])
        tried = [minimize(cost, start, jac=True, method="L-BFGS-B", bounds=_BOUNDS, options={"maxiter": _STEPS}) for start in starts]
        best = min(tried, key=lambda one: one.fun)
        values.append(-float(best.fun))
        hypers.append(np.asarray(best.x))
    return PathFit(row_time=row_time, value=sum(values), hyper=(hypers[0], hypers[1]))


def with_tones(chunks: Sequence[Chunk], fits: Sequence[PathFit]) -> tuple[list[Chunk], list[PathFit]]:
    """Fits of many row times, each with the tones that explain most there, and the chunks with the likeliest one's, if tones do enough."""
    toned = [_with_tones(chunks, fit) for fit in fits]
    likely = max(toned, key=lambda each: each[1].value)
    if likely[1].value - max(fit.value for fit in fits) < _VIBRATING:
        return [*chunks], [*fits]
    return likely[0], [fit for _, fit in toned]


def _with_tones(chunks: Sequence[Chunk], fit: PathFit) -> tuple[list[Chunk], PathFit]:
    """One tone after the other along either axis, as long as each adds enough."""
    found = [*chunks]
    for _ in range(_MOST_TONES):
        more = [one for axis in (0, 1) for one in _one_more([chunk for chunk in found if chunk.axis == axis], fit)]
        if sum(len(chunk.tones) for chunk in more) == sum(len(chunk.tones) for chunk in found):
            break
        found, fit = more, fit_path(more, fit.row_time, (fit,))
    return found, fit


def _one_more(chunks: Sequence[Chunk], fit: PathFit) -> list[Chunk]:
    """The chunks of one axis with the tone that adds most, if it adds enough."""
    period = float(np.median([np.median(np.diff(chunk.begins[0])) for chunk in chunks])) if chunks else 0.0
    tones = vibration.frequencies(_TONE_STEP, period)
    if not len(tones):
        return [*chunks]
    gains = np.sum([chunk.gains(fit.row_time, fit.hyper[chunk.axis], tones) for chunk in chunks], axis=0)
    best = float(tones[gains.argmax()])
    return [replace(chunk, tones=(*chunk.tones, best)) if gains.max() >= vibration.EVIDENCE else chunk for chunk in chunks]


def likeliest(chunks: Sequence[Chunk], near: PathFit, reach: float) -> PathFit:
    """The likeliest row time within `reach` of one, path and noise chosen for each."""
    fits = [near]

    def cost(at: float) -> float:
        fits.append(fit_path(chunks, float(at), fits[:1], warm=True))
        return -fits[-1].value

    bounds = (near.row_time - reach, near.row_time + reach)
    minimize_scalar(cost, bounds=bounds, method="bounded", options={"xatol": _RESOLVED * reach, "maxiter": _TRIALS})
    return max(fits, key=lambda fit: fit.value)


def curvature(chunks: Sequence[Chunk], at: PathFit, step: float) -> float:
    """Minus the second derivative of the log-likelihood in the row time, over a step that costs about one."""
    for _ in range(_HALVINGS):
        sides = [fit_path(chunks, at.row_time + side * step, (at,), warm=True).value for side in (-1, 1)]
        if (cost := 2 * at.value - sum(sides)) < _QUADRATIC:
            return max(cost, 0.0) / step**2
        step /= 2
    return _QUADRATIC / (4 * step**2)
