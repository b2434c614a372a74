"""The readout from a clip that was filmed by hand, without any target."""

from fractions import Fraction
from pathlib import Path

from calibration.footage import Footage, frames, open_footage
from calibration.timing.pair_motion import Pair
from calibration.timing.readout_measurement import ReadoutMeasurement, counted, directions, of_footage, scanlines_are_rows
from calibration.timing.self_calibration import explain
from rsvideo.physics.shutter import Direction
from rsvideo.progress import Observer, Progress, within
from rsvideo.restoration import tracks

_TRACKING = 0.5  # of the work
_LEAST_CURVATURE = 1e-30  # per s^2; a flat cost divides by this


def from_motion(path: Path, *, rate: Fraction | None, direction: Direction | None, most: int, observer: Observer) -> ReadoutMeasurement:
    """The readout that explains how points move through the first `most` frames; CannotTellError where they do not show it."""
    footage = open_footage(path, rate)
    if footage.period is None or footage.frames < 2:
        raise ValueError(f"{path} must be a clip, a photograph shows no motion from frame to frame")
    scanlines, along = (footage.rows, footage.cols) if scanlines_are_rows(direction) else (footage.cols, footage.rows)
    explained = explain(
        _tracked(footage, directions(direction)[0], most, observer),
        rows=scanlines,
        cols=along,
        period=footage.period,
        downwards=directions(direction),
        observer=within(observer, _TRACKING, 1.0),
    )
    sharpness = f"the cost rises by 1/2 within {1e3 / max(explained.curvature, _LEAST_CURVATURE) ** 0.5:.2g} ms of its lowest"
    likelihood = f"a global shutter is less likely by {explained.over_global:.0f} in log-likelihood"
    return of_footage(
        footage,
        explained.readout,
        explained.std,
        explained.direction,
        how=f"motion of points between {counted(explained.pairs, 'pair')} of frames of hand-held footage",
        notes=(*footage.notes, f"{sharpness}; {likelihood}"),
        details={
            "curvature_per_s2": explained.curvature,
            "better_than_global": explained.over_global,
            "pairs": explained.pairs,
            "costs": [{"readout_s": float(at), "cost": float(cost)} for at, cost in zip(explained.readouts, explained.costs, strict=True)],
        },
    )


def _tracked(footage: Footage, downwards: Direction, most: int, observer: Observer) -> list[Pair]:
    """Points of each frame found again in the next."""
    pairs, before, count = list[Pair](), None, min(most, footage.frames)
    for time, light in frames(footage, most):
        observer(Progress(stage="following points", fraction=_TRACKING * len(pairs) / count))
        codes = tracks.codes(downwards.scanlines(light).mean(axis=2, dtype=float))
        if before is not None:
            found = tracks.track(before[1], codes)
            pairs.append(Pair(before=found.before, after=found.after, begins=(before[0], time)))
        before = time, codes
    return pairs
