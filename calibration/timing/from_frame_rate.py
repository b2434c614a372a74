"""The readout from the frame rate and the number of scanlines in all, visible and blanking."""

from fractions import Fraction
from pathlib import Path

from calibration.footage import open_footage
from calibration.timing.readout_measurement import ReadoutMeasurement, of_footage, scanlines_are_rows
from rsvideo.physics.shutter import Direction

_MOST_TIMES = 20  # the stored scanlines; more in all are a slip


def from_frame_rate(path: Path, total: int | None, *, rate: Fraction | None, direction: Direction | None) -> ReadoutMeasurement:
    """The readout of a sensor that reads `total` scanlines evenly in a frame's period (Forssen & Ringaby): 1/f = rows t_r + t_d."""
    footage = open_footage(path, rate)
    if footage.period is None:
        raise ValueError(f"{path} has no frame rate; give --rate, or measure with --flicker")
    stored = footage.rows if scanlines_are_rows(direction) else footage.cols
    bound = f"a frame's period of {footage.period * 1e3:.4g} ms"
    if total is None:
        raise ValueError(
            f"--from-frame-rate needs --scanlines-total N; without it {bound} is only an upper bound, cameras read in about half"
        )
    if not stored <= total <= _MOST_TIMES * stored:
        raise ValueError(
            f"scanlines-total must be from the {stored} that are stored to twenty times as many, got {total};"
            " it counts blanking lines too; was the clip scaled?"
        )
    row_time = footage.period / total
    delay = (total - stored) * row_time
    note = (
        f"{bound} is the readout and an inter-frame delay of {delay * 1e3:.3g} ms, in which {total - stored} lines that are"
        " not stored go by (Forssen & Ringaby); true only if all lines are read evenly"
    )
    return of_footage(
        footage,
        stored * row_time,
        None,
        None,
        how=f"frame rate of {footage.fps:.5g} and {total} scanlines in all, {stored} of them stored",
        notes=(*footage.notes, note),
        details={"row_time_s": row_time, "inter_frame_delay_s": delay},
    )
