"""Tones beside a camera's path, as an engine shakes it: the frequencies that the points between frames ask for.

A hand's path is smooth, and a vibration of a few px at 25 to 90 Hz is not among those that its prior believes. Points show it all the
same, each at its own scanline's time. A tone of frequency f and slowly changing strength is linear in its coefficients, like the path
itself. With the path's precision P and the normal equations of the tone Q and b beside the likeliest path, which R couples with it,

    E(f) = b^T S^-1 b / 2 - log det(r^2 S) / 2,    S = Q - R^T P^-1 R + 1 / r^2

is the logarithm of how much likelier the points are with a tone along one axis, whose coefficients spread by r, than without it.
"""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve

from rsvideo.physics.trajectory import Spline, VibratingSpline
from rsvideo.physics.vibration import EVIDENCE, SPREAD, frequencies, telling
from rsvideo.restoration.point_equations import Pair

STEP, FINE_STEP = 1.0, 0.25  # Hz, from one frequency to the next, and about the best one
STEADY = 0.5  # s, over which a tone's strength and phase change evenly
MOST = 3  # tones: an engine's, and those of what it shakes
FAINTEST = 0.2  # sinc(f e), below which points hardly show a tone's strength
AT_REST = 1e-3  # px: the spread along axes that no tone shakes


@dataclass(frozen=True, kw_only=True)
class Tone:
    """A frequency, and the axes along which it shakes the camera."""

    frequency: float  # Hz
    axes: tuple[bool, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Explained:
    """The likeliest path, for what is believed of points and fields."""

    path: Spline
    precision: Float[np.ndarray, "unknowns unknowns"]  # of its coefficients
    weights: list[np.ndarray]  # of the points of each pair, 1 / px^2
    common: Float[np.ndarray, " fields"]  # beside the path, the mean of all pairs
    variance: Float[np.ndarray, " fields"]  # about that


def vibrating(path: Spline, hertz: Iterable[float]) -> VibratingSpline:
    """A path at rest with tones of these frequencies beside it."""
    tones, nodes = tuple(map(float, hertz)), 1 + max(1, round((path.t1 - path.t0) / STEADY))
    coefficients = np.zeros((len(path.coefficients) + 2 * nodes * len(tones), path.coefficients.shape[1]))
    return VibratingSpline(t0=path.t0, t1=path.t1, coefficients=coefficients, frequencies=tones, nodes=nodes)


def spreads(tones: Sequence[Tone], path: Spline) -> Float[np.ndarray, "terms axes"]:
    """What is believed of the tones' coefficients, px."""
    each = np.array([np.where(tone.axes, SPREAD, AT_REST) for tone in tones]).reshape(len(tones), path.coefficients.shape[1])
    return each.repeat((len(path.coefficients) - len(path.smooth.coefficients)) // max(1, len(tones)), axis=0)


def exposed(path: Spline, believed: float, exposure: float) -> Spline:
    """A path that points show if frames were exposed for `believed` s, if they were for `exposure` s: points move by means over exposures.

    The mean of a tone over e seconds is sinc(f e) of it.
    """
    if not isinstance(path, VibratingSpline):
        return path
    before, after = (np.sinc(np.array(path.frequencies) * seconds) for seconds in (believed, exposure))
    factors = before * np.sign(after) / np.maximum(np.abs(after), FAINTEST)
    coefficients = path.coefficients.copy()
    coefficients[len(path.smooth.coefficients) :] *= factors.repeat(2 * path.nodes)[:, None]
    return path.with_coefficients(coefficients)


def strongest(
    pairs: Sequence[Pair], found: Explained, begins: Float[np.ndarray, " frames"], equations: Callable[[Spline], list[Pair]]
) -> Tone | None:
    """The tone that the points of pairs of frames ask for most beside a path, if they do; `equations` are theirs in any path."""
    period, smooth = float(np.median(np.diff(begins))), found.path.smooth
    grid = frequencies(STEP, period)
    if not len(grid):
        return None

    def of(tried: np.ndarray) -> np.ndarray:
        designs = [pair.design[:, len(smooth.coefficients) :] for pair in equations(vibrating(smooth, tried))]
        return _evidence(pairs, found, designs, len(tried))

    best = grid[of(grid).max(axis=1).argmax()]
    fine = telling(best + np.arange(-STEP, STEP + FINE_STEP, FINE_STEP), period)
    shown = of(fine)
    at = int(shown.max(axis=1).argmax())
    if shown[at].max() < EVIDENCE:
        return None
    return Tone(frequency=float(fine[at]), axes=(*(shown[at] >= EVIDENCE).tolist(), False)[: smooth.coefficients.shape[1]])


def _evidence(
    pairs: Sequence[Pair], found: Explained, tones: Sequence[Float[np.ndarray, "_ terms"]], count: int
) -> Float[np.ndarray, "tones axes"]:
    """E of `count` tones, whose coefficients move the points of each pair by `tones`."""
    unknowns, terms = len(found.precision), tones[0].shape[1]
    coupled, own, right = np.zeros((2, unknowns, terms)), np.zeros((2, count, terms // count, terms // count)), np.zeros((2, terms))
    for pair, weight, tone in zip(pairs, found.weights, tones, strict=True):
        covariance = pair.field_covariance(weight, found.variance)
        rest = pair.residual(found.path.coefficients) - pair.fields @ found.common
        weighted = pair.fields * weight[:, None, None]
        across = np.einsum("ncf,ncu->fu", weighted, pair.path, optimize=True)
        by_field = np.einsum("ncf,nc->f", weighted, rest)
        each = tone.reshape(len(tone), count, -1)
        for a in range(2):
            lever = pair.levers[:, :, a]
            fields = np.einsum("ncf,nc->nf", weighted, lever).T @ tone
            coupled[a][pair.unknowns] += (
                np.einsum("ncu,nc,n->nu", pair.path, lever, weight, optimize=True).T @ tone - across.T @ covariance @ fields
            )
            right[a] += np.einsum("nc,nc,n->n", lever, rest, weight) @ tone - by_field @ covariance @ fields
            shared = fields.reshape(len(fields), count, -1)
            own[a] += np.einsum("nki,nkj->kij", each * ((lever**2).sum(axis=1) * weight)[:, None, None], each, optimize=True)
            own[a] -= np.einsum("fki,fg,gkj->kij", shared, covariance, shared, optimize=True)
    factor = cho_factor(found.precision)
    out = np.empty((count, 2))
    for a in range(2):
        taken = cho_solve(factor, coupled[a]).reshape(unknowns, count, -1)
        explained = np.einsum("uki,ukj->kij", coupled[a].reshape(unknowns, count, -1), taken, optimize=True)
        s = own[a] - explained + np.eye(own.shape[-1]) / SPREAD**2
        b = right[a].reshape(count, -1)
        out[:, a] = 0.5 * (b * np.linalg.solve(s, b[..., None])[..., 0]).sum(axis=1) - 0.5 * np.linalg.slogdet(SPREAD**2 * s)[1]
    return out
