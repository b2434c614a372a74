"""The readout that owners of a camera published."""

import re

from calibration.timing.readout_measurement import ReadoutMeasurement, counted
from rsvideo.config.yaml import meant
from rsvideo.shooting import readout_table

SOURCE = "public table of readout times: Gyroflow's lens profiles, CC0 1.0"
_MODE = re.compile(r"(?:(\d{1,5})x)?(\d{1,5})(?:(?:@|p)(\d{1,4}(?:\.\d*)?)|p)?", re.IGNORECASE)
_ENOUGH = 3  # owners, for a spread
_ONE_SIDED = 1.645  # deviations within which nine of ten lie
_SHOWN = 100  # letters of a name in a message
_WIDE = 16 / 9  # the picture's shape, where only its rows are given


def from_table(camera: str, mode: str) -> ReadoutMeasurement:
    """The median of what is published for a camera, such as `GoPro HERO8 Black`, in a mode such as `1920x1080@60` or `1080p60`."""
    match = _MODE.fullmatch(mode.strip())
    if not match or not int(match[2]):
        raise ValueError(f"MODE must read like 1920x1080@29.97, 3840x2160 or 1080p60, got {mode[:40]!r}")
    rows, fps = int(match[2]), (float(match[3]) if match[3] else None) or None
    cols = int(match[1]) if match[1] else round(rows * _WIDE / 2) * 2
    found = readout_table.typical(camera, rows=rows, cols=cols, fps=fps)
    if found is None:
        raise ValueError(f"the public table does not know {camera[:_SHOWN]!r}{meant(camera, readout_table.similar(camera))}")
    has_spread = found.n >= _ENOUGH
    between = f", nine of ten between {found.low * 1e3:.4g} and {found.high * 1e3:.4g} ms" if has_spread else ""
    return ReadoutMeasurement(
        value=found.median,
        std=(found.high - found.low) / (2 * _ONE_SIDED) if has_spread else None,
        direction=found.direction,
        how=f"the {'median' if found.n > 1 else 'figure'} of {counted(found.n, 'owner')} for {found.mode}{between}",
        source=SOURCE,
        rows=rows,
        cols=cols,
        fps=fps,
        camera=camera,
        notes=_notes(found, f"{cols} x {rows}" + (f" at {fps:.5g} fps" if fps else "")),
        details={"owners": found.n, "low_s": found.low, "high_s": found.high},
    )


def _notes(found: readout_table.Readout, mode: str) -> tuple[str, ...]:
    notes: tuple[str, ...] = ()
    if found.n < _ENOUGH:
        notes += (f"{counted(found.n, 'owner')} published it, too few for a spread; a measurement of your own says more",)
    if found.mode != mode:
        notes += (f"nobody published {mode}; taken from {found.mode}",)
    return notes
