"""The comparison as one HTML file that needs nothing else: pictures, charts, style and script are inside it."""

import math
from collections.abc import Sequence
from urllib.parse import quote

from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rsvideo.config.printable import printable
from rsvideo.report import embedded, entry_table, measure_charts, motion_figures
from rsvideo.report.comparison import Comparison, Entry, KeyFrame, measures_of
from rsvideo.report.entry_table import Row
from rsvideo.report.measures import BY_KEY, Measure
from rsvideo.report.summary import OURS, summary


def render(comparison: Comparison) -> bytes:
    """The HTML file."""
    measures = measures_of(comparison)
    rows = entry_table.rows(comparison, measures)
    shown = [row for row in rows if row.fault is None]
    style, script = Markup(embedded.text("page.css")), Markup(embedded.text("page.js"))
    html = _template("page.html.j2").render(
        c=comparison,
        policy=embedded.policy(style, script),
        style=style,
        script=script,
        measures=measures,
        rows=rows,
        shown=shown,
        lede=summary(comparison),
        charts=measure_charts.over_frames(comparison, measures, rows),
        table=[measure_charts.as_table(comparison, measure) for measure in measures],
        motions=[motion_figures.motions(comparison, frame) for frame in comparison.key_frames],
        thumbnails=[embedded.data_uri(frame.thumbnail, "image/webp") for frame in comparison.key_frames],
        first=_pictures(comparison.key_frames[comparison.first_shown]),  # in the page itself, for readers without scripts and for print
        video=None if comparison.video is None else embedded.data_uri(comparison.video, "video/mp4"),
        before=shown[0].name,
        after=_after(shown),
        data=embedded.json_text(_state(comparison, shown)),
        key_frame_pictures=[embedded.json_text(_pictures(frame)) for frame in comparison.key_frames],
        duration=entry_table.duration,
        size=_size(comparison),
    )
    return html.encode()


def index(title: str, comparisons: Sequence[tuple[str, Comparison]]) -> bytes:
    """A page that leads to those of several comparisons, by the names of their folders."""
    style = Markup(embedded.text("page.css"))
    parts = [
        {
            "href": quote(f"{name}/index.html"),
            "title": comparison.title,
            "words": summary(comparison),
            "picture": embedded.data_uri(comparison.key_frames[comparison.first_shown].thumbnail, "image/webp"),
            "size": _size(comparison),
        }
        for name, comparison in comparisons
    ]
    return _template("index.html.j2").render(title=title, policy=embedded.policy(style), style=style, parts=parts).encode()


def _template(name: str):
    environment = Environment(autoescape=True, finalize=_finalized, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    return environment.from_string(embedded.text(name))


def _finalized(value: object) -> object:
    """Names as they may stand in a page; what is markup already stays."""
    return printable(value, keep="\n\t") if isinstance(value, str) and not isinstance(value, Markup) else value


def _after(shown: Sequence[Row]) -> str:
    """The entry that stands on the right at first."""
    names = [row.name for row in shown]
    return OURS if OURS in names else next((row.name for row in shown[1:] if row.role == "method"), names[-1])


def _pictures(frame: KeyFrame) -> dict[str, str]:
    return {name: embedded.data_uri(data, "image/webp") for name, data in frame.pictures.items()}


def _state(comparison: Comparison, shown: Sequence[Row]) -> dict[str, object]:
    """What the script needs to know."""
    key = "psnr" if any(math.isfinite(entry.mean("psnr")) for entry in comparison.entries) else "edge_width"
    return {
        "rows": comparison.rows,
        "cols": comparison.cols,
        "key": comparison.first_shown,
        "frames": [{"index": frame.index, "time": round(frame.time_s, 3)} for frame in comparison.key_frames],
        "entries": [row.name for row in shown],
        "crops": [[crop.x, crop.y, crop.w, crop.h] for crop in comparison.crops],
        "captions": [
            {entry.name: _caption(entry, BY_KEY[key], frame.index) for entry in comparison.shown} for frame in comparison.key_frames
        ],
    }


def _caption(entry: Entry, measure: Measure, index: int) -> str:
    for frame in entry.frames:
        if frame.index == index and math.isfinite(value := frame.value(measure.key)):
            return f"{measure.written(value)} {measure.unit}"
    return ""


def _size(comparison: Comparison) -> str:
    words = f"{comparison.cols} × {comparison.rows} px"
    if comparison.kind == "clip":
        count = max((len(entry.frames) for entry in comparison.shown), default=0)
        words += f", {count} frames at {comparison.rate:.4g} a second"
    return words
