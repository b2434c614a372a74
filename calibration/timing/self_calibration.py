"""Readout time from ordinary hand-held footage: the one that best explains how tracked points move at their own rows' times.

A point observed in row y of frame k and in row y' of frame k + 1 has moved by p(t_k+1 + y' t_r) - p(t_k + y t_r). With a global shutter
all rows of a pair of frames move alike; with a rolling one each row's displacement is the path's over a window of one frame's period,
which begins later from row to row, so that how displacements change down a frame must go on in the next. A motion of constant velocity
says nothing of t_r: it takes a hand's changes of pace, or an engine's vibration.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from calibration.timing.cannot_tell import CannotTellError, Likeliest, StabilisedError, TooFewPointsError
from calibration.timing.pair_motion import FEWEST_POINTS, Pair, summarise
from calibration.timing.path_evidence import Chunk, PathFit, chunked, curvature, fit_path, likeliest, with_tones
from rsvideo.physics.shutter import Direction
from rsvideo.progress import Observer, Progress, ignore

FEWEST_PAIRS = 8  # of frames
_LONGEST = 1.05  # of a frame's period, up to which a readout is tried
_AT_THE_END = 0.98  # of the longest one tried; a likeliest readout beyond is none
_TRIED = 22  # readouts from the longest upwards to the longest downwards
_AROUND = 2.5  # steps of these from one that is nearly right already
_REFINING, _REFINED = 6, 3  # the work after these, and until the likeliest is found, as multiples of that for one of them
_RIVAL = 10.0  # log-likelihood by which any other readout must be worse
_NEAR_STEPS, _NEAR_STD = 1.5, 4  # readouts nearer than so many steps or deviations are no others
ASTRAY = 0.03  # of the readout, what points in blurred frames may be off by at best
LESS_ASTRAY = 0.01  # the same of points in windows that are blurred alike, whose readouts are off as they say
_VAGUE = 0.07  # of the readout; a larger deviation is no answer
_VAGUE_GLOBAL = 0.02  # of a frame's period; the largest deviation with which a global shutter is recognised
_GLOBAL = 3  # deviations, below which a readout is none
_APART = 9.0  # mean square of deviations by which parts of a clip may disagree
_SHIFTED = 0.02  # of the picture's longer side, the deviation of the shift that a stabiliser gives each pair of frames
_SHIFTED_READOUTS = (0.3, 0.6, 0.9)  # of a frame's period, with which a stabilised clip is tried: they differ little there
_CURVATURE_STEP = 0.25  # of the distance between readouts that are tried, over which the cost's curvature is measured; origin: by trial


@dataclass(frozen=True, kw_only=True, eq=False)
class Explained:
    """The readout that explains a clip best."""

    readout: float  # seconds
    std: float
    direction: Direction | None  # None: a global shutter, or none that can be distinguished from it
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
    near: float | None = None,
    astray: float = ASTRAY,
    observer: Observer = ignore,
) -> Explained:
    """The readout of a clip whose frames are `period` seconds apart; CannotTellError where its motion does not show it.

    Rows and y count scanlines, in the first direction of `downwards`, and so do columns and x along them. `near` is a readout in this
    direction that is nearly right: others far from it are not tried. `astray` is what else the points may be off by, of the readout.
    """
    motions = summarise(pairs, rows, cols)
    if len(motions) < FEWEST_PAIRS:
        raise TooFewPointsError(
            f"only {len(motions)} pairs of frames have {FEWEST_POINTS} points that could be followed, {FEWEST_PAIRS} are needed;"
            " film something with texture in the whole frame"
        )
    chunks = chunked(motions, rows)
    grid = np.linspace(-_LONGEST, _LONGEST, _TRIED) * period
    spacing = float(grid[1] - grid[0])
    if near is not None:
        grid = grid[np.abs(grid - near) < _AROUND * spacing]
    chunks, fits = with_tones(chunks, _fits(chunks, grid / rows, observer))
    best = likeliest(chunks, max(fits, key=lambda fit: fit.value), spacing / rows)
    _report(observer, (len(grid) + _REFINED) / (len(grid) + _REFINING))
    _refuse_stabilised(chunks, best, rows, cols, period)
    readout = best.row_time * rows
    of_readout, std, disagreement = _uncertainty(chunks, best, rows, spacing, astray)
    others = [fit for fit in fits if abs(fit.row_time * rows - readout) > max(_NEAR_STEPS * spacing, _NEAR_STD * std)]
    is_global = abs(readout) < _GLOBAL * std
    spread = _spread(best, others, rows, disagreement)
    found = Likeliest(readout=readout, std=float(np.hypot(std, spread))) if std < period else None
    if disagreement > _APART:
        raise CannotTellError(
            f"parts of the clip disagree by {np.sqrt(disagreement):.1f} deviations; is it stabilised, or does much of the scene move?",
            found,
        )
    _refuse_vague(readout, std, period, found)
    if best.value - max((fit.value for fit in others), default=np.inf) < _RIVAL:
        raise CannotTellError(f"readouts far from {1e3 * abs(readout):.3g} ms explain its motion nearly as well; film for longer", found)
    if not is_global and std > _VAGUE * abs(readout):
        words = f"its motion shows only that the readout is short, {1e3 * abs(readout):.2g} ms give or take {1e3 * std:.2g} ms"
        raise CannotTellError(words, found)
    _report(observer, 1.0)
    return Explained(
        readout=abs(readout),
        std=std,
        direction=None if is_global else downwards[0 if readout > 0 else 1],
        curvature=of_readout,
        over_global=best.value - fit_path(chunks, 0.0, (best,)).value,
        pairs=len(motions),
        readouts=grid,
        costs=np.array([best.value - fit.value for fit in fits]),
    )


def _fits(chunks: Sequence[Chunk], row_times: Float[np.ndarray, " steps"], observer: Observer) -> list[PathFit]:
    fits: list[PathFit] = []
    for step, row_time in enumerate(row_times):
        fits.append(fit_path(chunks, row_time, fits[-1:]))
        _report(observer, (step + 1) / (len(row_times) + _REFINING))
    return fits


def _report(observer: Observer, fraction: float) -> None:
    observer(Progress(stage="trying readouts", fraction=fraction))


def _refuse_stabilised(chunks: Sequence[Chunk], best: PathFit, rows: int, cols: int, period: float) -> None:
    """StabilisedError where a shift of each frame's own explains the clip better than any readout does without."""
    shifted = [replace(chunk, shift=_SHIFTED * max(rows, cols)) for chunk in chunks]
    if max(fit_path(shifted, part * period / rows, (best,)).value for part in _SHIFTED_READOUTS) > best.value:
        raise StabilisedError("its frames are shifted otherwise than its motion goes on within them; was it stabilised?")


def _refuse_vague(readout: float, std: float, period: float, found: Likeliest | None) -> None:
    """CannotTellError where the deviation is too large for an answer, or the likeliest readout is the longest one tried."""
    if std < max(_VAGUE * abs(readout), _VAGUE_GLOBAL * period) and not _at_the_end(readout, period):
        return
    likeliest_readout = (
        f"{1e3 * abs(readout):.3g} ms is likeliest, give or take {1e3 * std:.2g} ms" if std < period else "all readouts explain it alike"
    )
    advice = "move the camera by hand, without stabilisation, for some seconds before something with texture"
    raise CannotTellError(f"its motion does not show it: {likeliest_readout}; {advice}", found)


def _at_the_end(readout: float, period: float) -> bool:
    return abs(readout) > _AT_THE_END * _LONGEST * period


def _spread(best: PathFit, others: Sequence[PathFit], rows: int, disagreement: float) -> float:
    """How far others that explain the clip nearly as well make a readout uncertain, s: the likelier, the more."""
    odds = [np.exp((fit.value - best.value) / disagreement) for fit in others]
    return float(rows * np.sqrt(sum(p * (fit.row_time - best.row_time) ** 2 for p, fit in zip(odds, others, strict=True))))


def _uncertainty(chunks: Sequence[Chunk], fit: PathFit, rows: int, spacing: float, astray: float) -> tuple[float, float, float]:
    """The curvature of the cost in the readout, its standard deviation, and the mean square of those by which parts of the clip disagree.

    Parts that disagree make the deviation larger.
    """
    step = _CURVATURE_STEP * spacing / rows
    total = curvature(chunks, fit, step)
    misfits = []
    for chunk in chunks:
        own = likeliest([chunk], fit_path([chunk], fit.row_time, (fit,), warm=True), 2 * spacing / rows)
        misfits.append((own.row_time - fit.row_time) ** 2 * curvature([chunk], own, step))
    factor = max(1.0, sum(misfits) / max(len(misfits) - 1, 1))
    std = np.inf if total <= 0 else rows * np.sqrt(factor / total)
    return total / rows**2, float(np.hypot(std, astray * max(abs(fit.row_time) * rows, spacing))), factor
