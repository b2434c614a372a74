"""The comparison as one HTML file that needs nothing else: pictures, charts, style and script are inside it."""

import base64
import hashlib
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from urllib.parse import quote

import cv2
import numpy as np
from jaxtyping import Float
from jinja2 import Environment, StrictUndefined
from markupsafe import Markup

from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.report import charts, plots
from rsvideo.report.comparison import NAMED, Comparison, Entry, Look, Measure, best, measures, summary

_STYLES = 8  # colours of methods
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
    words: str
    style: str
    look: int
    key: Markup
    cells: tuple[Cell, ...]
    time: str
    memory: str
    fault: str | None


@dataclass(frozen=True, kw_only=True)
class Chart:
    """One measure over the frames."""

    measure: Measure
    wide: Markup
    narrow: Markup


@dataclass(frozen=True, kw_only=True)
class Motion:
    """What explains one frame of one method."""

    name: str
    path: Markup
    psfs: str
    psf_words: str
    residual: str
    convergence: Markup


def render(comparison: Comparison) -> bytes:
    """The HTML file."""
    told = measures(comparison)
    rows = _rows(comparison, told)
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    style, script = (Markup(_text(name)) for name in ("page.css", "page.js"))
    shown = [row for row in rows if row.fault is None]
    html = environment.from_string(_text("page.html.j2")).render(
        c=comparison,
        policy=f"default-src 'none'; img-src data:; media-src data:; style-src '{_hash(style)}'; script-src '{_hash(script)}';"
        " base-uri 'none'; form-action 'none'",
        style=style,
        script=script,
        measures=told,
        rows=rows,
        shown=shown,
        lede=summary(comparison),
        charts=_charts(comparison, told, rows),
        motions=[_motions(comparison, look) for look in comparison.looks],
        thumbnails=[_data(look.thumbnail, "image/webp") for look in comparison.looks],
        first=_first(comparison),
        video=None if comparison.video is None else _data(comparison.video, "video/mp4"),
        before=shown[0].name,
        after=_after(shown),
        data=_json(_state(comparison, shown)),
        looks=[_json(_pictures(look)) for look in comparison.looks],
        table=[_frame_rows(comparison, measure) for measure in told],
        duration=_duration,
        size=_size(comparison),
    )
    return html.encode()


def index(title: str, comparisons: Sequence[tuple[str, Comparison]]) -> bytes:
    """A page that leads to those of several comparisons, by the names of their folders."""
    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    style = Markup(_text("page.css"))
    parts = [
        {
            "href": quote(f"{name}/index.html"),
            "title": comparison.title,
            "words": summary(comparison),
            "picture": _data(comparison.looks[comparison.key].thumbnail, "image/webp"),
            "size": _size(comparison),
        }
        for name, comparison in comparisons
    ]
    policy = f"default-src 'none'; img-src data:; style-src '{_hash(style)}'; base-uri 'none'; form-action 'none'"
    return environment.from_string(_text("index.html.j2")).render(title=title, policy=policy, style=style, parts=parts).encode()


def _text(name: str) -> str:
    return resources.files("rsvideo.report").joinpath(name).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _data(data: bytes, kind: str) -> str:
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"


def _json(value: object) -> Markup:
    """JSON that may stand inside a script element."""
    return Markup(json.dumps(value, ensure_ascii=True).replace("<", "\\u003c").replace("&", "\\u0026"))


def _rows(comparison: Comparison, told: Sequence[Measure]) -> list[Row]:
    winners = {measure.key: best(comparison, measure.key) for measure in told}
    rows, number = [], 0
    for entry in comparison.entries:
        if entry.role == "truth" or entry.name in ("none", "recorded"):
            style, look = ("ink", 6) if entry.role == "truth" else ("grey", 4)
        else:
            style, look = f"c{number % _STYLES}", number
            number += 1
        rows.append(
            Row(
                name=entry.name,
                role=entry.role,
                words=_WORDS.get(entry.name, ""),
                style=style,
                look=look,
                key=charts.key(style, look),
                cells=tuple(_cell(entry, measure, entry.name in winners[measure.key]) for measure in told),
                time=_duration(entry.seconds),
                memory=f"{entry.peak_bytes / 1e9:.2f} GB" if entry.peak_bytes else "–",
                fault=entry.fault,
            )
        )
    return rows


def _cell(entry: Entry, measure: Measure, top: bool) -> Cell:
    many = sum(math.isfinite(frame.values.get(measure.key, math.nan)) for frame in entry.frames) > 1
    worst = f"{measure.written(entry.worst(measure.key))}" if many else ""
    return Cell(text=measure.written(entry.mean(measure.key)), detail=worst, best=top)


def _duration(seconds: float) -> str:
    if not math.isfinite(seconds):
        return "–"
    return f"{seconds:.2g} s" if seconds < 10 else f"{seconds:.0f} s" if seconds < 100 else f"{seconds / 60:.1f} min"


def _charts(comparison: Comparison, told: Sequence[Measure], rows: Sequence[Row]) -> list[Chart]:
    drawn = {row.name: row for row in rows}
    out = []
    for measure in told:
        series = [
            charts.Series(
                name=entry.name,
                style=drawn[entry.name].style,
                look=drawn[entry.name].look,
                x=[frame.index for frame in entry.frames],
                y=[frame.values.get(measure.key, math.nan) for frame in entry.frames],
            )
            for entry in comparison.entries
            if sum(math.isfinite(frame.values.get(measure.key, math.nan)) for frame in entry.frames) > 1
        ]
        if series:
            title = f"{measure.name} of each frame, by method; the numbers stand in the table below"
            unit = measure.unit or measure.name
            wide, narrow = (
                charts.lines(series, x_label="frame", y_label=unit, width=width, height=height, title=title)
                for width, height in ((1080, 340), (380, 280))
            )
            out.append(Chart(measure=measure, wide=wide, narrow=narrow))
    return out


def _frame_rows(comparison: Comparison, measure: Measure) -> list[list[str]]:
    """The chart as a table: a row for each frame, a column for each entry."""
    columns = [{frame.index: frame for frame in entry.frames} for entry in comparison.shown]
    indices = sorted(set().union(*columns)) if columns else []
    return [
        [str(index), *(measure.written(column[index].values.get(measure.key, math.nan)) if index in column else "–" for column in columns)]
        for index in indices
    ]


def _motions(comparison: Comparison, look: Look) -> list[Motion]:
    out = []
    for entry in comparison.methods:
        record = look.records.get(entry.name)
        if record is None or entry.sidecar is None:
            continue
        moved = bool(np.any(record.trajectory.poses()))
        if not moved and record.psfs is None:
            continue
        tiles, across = _tiles(entry.sidecar, record)
        steps = record.convergence
        out.append(
            Motion(
                name=entry.name,
                path=charts.trajectory(entry.sidecar, record) if moved else Markup(""),
                psfs=_data(_drawn(tiles, across), "image/png"),
                psf_words=f"what a point of light becomes across the frame; each tile is {tiles.shape[-1]} px wide",
                residual=_data(look.residuals[entry.name], "image/webp") if entry.name in look.residuals else "",
                convergence=charts.falling(steps) if len(steps) > 1 else Markup(""),
            )
        )
    return out


def _tiles(said: Sidecar, record: FrameRecord) -> tuple[Float[np.ndarray, "tiles k k"], int]:
    if record.psfs is not None:
        psfs = np.asarray(record.psfs, float)
        return psfs.reshape(-1, *psfs.shape[2:]), psfs.shape[1]
    return plots.psfs(said, record)[1], plots.grid(said)[1]


def _drawn(tiles: Float[np.ndarray, "tiles k k"], across: int) -> bytes:
    """Kernels in a grid, as opaque as they are strong, so that they can stand on any paper."""
    k, scale = tiles.shape[-1], max(1, 56 // tiles.shape[-1])
    gap = max(1, k * scale // 12)
    cell = k * scale + gap
    down = -(-len(tiles) // across)
    alpha = np.zeros((down * cell + gap, across * cell + gap), np.uint8)
    for n, tile in enumerate(tiles):
        y, x = gap + n // across * cell, gap + n % across * cell
        strong = np.clip(255 * np.sqrt(np.maximum(tile, 0) / max(float(tile.max()), 1e-12)), 8, 255).astype(np.uint8)
        alpha[y : y + k * scale, x : x + k * scale] = np.kron(strong, np.ones((scale, scale), np.uint8))
    picture = np.zeros((*alpha.shape, 4), np.uint8)
    picture[..., 3] = alpha
    return cv2.imencode(".png", picture)[1].tobytes()


def _first(comparison: Comparison) -> Mapping[str, str]:
    """The pictures of the frame that is shown first: they stand in the page itself, for readers without scripts and for print."""
    return {name: _data(data, "image/webp") for name, data in comparison.looks[comparison.key].pictures.items()}


def _after(shown: Sequence[Row]) -> str:
    names = [row.name for row in shown]
    return "rsvideo" if "rsvideo" in names else next((row.name for row in shown[1:] if row.role == "method"), names[-1])


def _pictures(look: Look) -> dict[str, str]:
    return {name: _data(data, "image/webp") for name, data in look.pictures.items()}


def _state(comparison: Comparison, shown: Sequence[Row]) -> dict[str, object]:
    """What the script needs to know."""
    key = "psnr" if any(math.isfinite(entry.mean("psnr")) for entry in comparison.entries) else "edge_width"
    return {
        "rows": comparison.rows,
        "cols": comparison.cols,
        "key": comparison.key,
        "frames": [{"index": look.index, "time": round(look.time_s, 3)} for look in comparison.looks],
        "entries": [row.name for row in shown],
        "crops": [[crop.x, crop.y, crop.w, crop.h] for crop in comparison.crops],
        "captions": [{entry.name: _caption(entry, NAMED[key], look.index) for entry in comparison.shown} for look in comparison.looks],
    }


def _caption(entry: Entry, measure: Measure, index: int) -> str:
    for frame in entry.frames:
        if frame.index == index and math.isfinite(value := frame.values.get(measure.key, math.nan)):
            return f"{measure.written(value)} {measure.unit}"
    return ""


def _size(comparison: Comparison) -> str:
    words = f"{comparison.cols} × {comparison.rows} px"
    if comparison.kind == "clip":
        count = max((len(entry.frames) for entry in comparison.shown), default=0)
        words += f", {count} frames at {comparison.rate:.4g} a second"
    return words
