"""The table of a page: the recording, the methods and the truth, and how each is drawn everywhere."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from rsvideo.report import charts
from rsvideo.report.comparison import Comparison, Entry, best
from rsvideo.report.measures import Measure

_STYLES = 8  # colours of methods that page.css has
_TRUTH, _RECORDING = ("ink", 6), ("grey", 4)  # style and pattern of lines
_WORDS = {
    "recorded": "as the camera wrote it",
    "none": "as the camera wrote it, decoded and encoded",
    "rsvideo": "each scanline deblurred with its own piece of one motion",
    "uniform": "one kernel a frame",
    "nonuniform": "camera poses behind a global shutter",
    "rectify": "rolling shutter straightened, not deblurred",
    "rectify+uniform": "straightened, then one kernel a frame",
    "rectify+nonuniform": "straightened, then camera poses",
    "vidstab": "steadied as whole frames, not deblurred",
    "vidstab+uniform": "steadied, then one kernel a frame",
    "stitch": "blocks of rows, deblurred one by one",
    "gyro": "along the motion a gyroscope recorded",
    "gyro+refine": "rsvideo, started at the gyroscope's motion",
    "truth": "the scene itself, sharp",
}


@dataclass(frozen=True, kw_only=True)
class Cell:
    """A number of the table, as it is written."""

    text: str
    detail: str  # the worst frame's
    best: bool


@dataclass(frozen=True, kw_only=True)
class Row:
    """An entry of the table, and how it is drawn everywhere."""

    name: str
    role: str
    words: str  # what the method does
    style: str  # a class of the page's style
    pattern: int  # of dashes and markers
    key: Markup  # a sample of its line
    cells: tuple[Cell, ...]
    time: str
    memory: str
    fault: str | None


def rows(comparison: Comparison, measures: Sequence[Measure]) -> list[Row]:
    """A row for each entry, in their order, with a cell for each measure."""
    winners = {measure.key: best(comparison, measure.key) for measure in measures}
    out, number = [], 0
    for entry in comparison.entries:
        if entry.role == "truth":
            style, pattern = _TRUTH
        elif entry.name in ("none", "recorded"):
            style, pattern = _RECORDING
        else:
            style, pattern = f"c{number % _STYLES}", number
            number += 1
        out.append(
            Row(
                name=entry.name,
                role=entry.role,
                words=_WORDS.get(entry.name, ""),
                style=style,
                pattern=pattern,
                key=charts.key(style, pattern),
                cells=tuple(_cell(entry, measure, entry.name in winners[measure.key]) for measure in measures),
                time=duration(entry.seconds),
                memory=f"{entry.peak_bytes / 1e9:.2f} GB" if entry.peak_bytes else "–",
                fault=entry.fault,
            )
        )
    return out


def _cell(entry: Entry, measure: Measure, top: bool) -> Cell:
    worst = measure.written(entry.worst(measure.key)) if len(entry.values(measure.key)) > 1 else ""
    return Cell(text=measure.written(entry.mean(measure.key)), detail=worst, best=top)


def duration(seconds: float) -> str:
    """A time as people read it; a dash where there is none."""
    if not math.isfinite(seconds):
        return "–"
    return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.1f} min"
