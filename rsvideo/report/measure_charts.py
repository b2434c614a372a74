"""Each measure over the frames of a clip, as a chart and as a table."""

from collections.abc import Sequence
from dataclasses import dataclass

from markupsafe import Markup

from rsvideo.report import charts
from rsvideo.report.comparison import Comparison
from rsvideo.report.entry_table import Row
from rsvideo.report.measures import Measure

_WIDE, _NARROW = (1080, 340), (380, 280)  # px of a chart on a screen, and on a phone


@dataclass(frozen=True, kw_only=True)
class Chart:
    """One measure over the frames."""

    measure: Measure
    wide: Markup
    narrow: Markup


def over_frames(comparison: Comparison, measures: Sequence[Measure], rows: Sequence[Row]) -> list[Chart]:
    """A chart for each measure that some entry has on more than one frame."""
    by_name = {row.name: row for row in rows}
    out = []
    for measure in measures:
        series = [
            charts.Series(
                name=entry.name,
                style=by_name[entry.name].style,
                pattern=by_name[entry.name].pattern,
                x=[frame.index for frame in entry.frames],
                y=[frame.value(measure.key) for frame in entry.frames],
            )
            for entry in comparison.entries
            if len(entry.values(measure.key)) > 1
        ]
        if series:
            title = f"{measure.name} of each frame, by method; the numbers stand in the table below"
            wide, narrow = (
                charts.lines(series, x_label="frame", y_label=measure.unit or measure.name, width=width, height=height, title=title)
                for width, height in (_WIDE, _NARROW)
            )
            out.append(Chart(measure=measure, wide=wide, narrow=narrow))
    return out


def as_table(comparison: Comparison, measure: Measure) -> list[list[str]]:
    """The chart as a table: a row for each frame, a column for each entry."""
    columns = [{frame.index: frame for frame in entry.frames} for entry in comparison.shown]
    indices = sorted(set().union(*columns)) if columns else []
    return [
        [str(index), *(measure.written(column[index].value(measure.key)) if index in column else "–" for column in columns)]
        for index in indices
    ]
