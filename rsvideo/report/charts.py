"""Charts as SVG inside a page: distinguished by dash and marker as well as by colour, which the page's style gives by class."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from markupsafe import Markup, escape

from rsvideo.config.sidecar import FrameRecord, Sidecar

DASHES = ("", "7 4", "2 3", "9 3 2 3", "4 2", "12 4", "1 4", "6 2 1 2 1 2")
MARKERS = (
    "M-3.5,0a3.5,3.5 0 1,0 7,0a3.5,3.5 0 1,0 -7,0z",  # circle
    "M-3.2,-3.2h6.4v6.4h-6.4z",  # square
    "M0,-4.2L4,3H-4z",  # triangle
    "M0,-4.6L4.6,0L0,4.6L-4.6,0z",  # diamond
    "M0,4.2L4,-3H-4z",  # triangle that stands on its tip
    "M-3.6,-1.2h2.4v-2.4h2.4v2.4h2.4v2.4h-2.4v2.4h-2.4v-2.4h-2.4z",  # cross
    "M-4,-4L4,4M-4,4L4,-4",  # saltire
    "M0,-4.6V4.6M-4.6,0H4.6",  # plus
)
_FEW = 60  # points that are marked each
_INSTANTS = 60  # of a trajectory that are drawn
_LEAST_ROLL = 1e-4  # degrees; a smaller roll has no panel


@dataclass(frozen=True, kw_only=True, eq=False)
class Series:
    """One line of a chart; points that are nan interrupt it."""

    name: str
    style: str  # a class of the page's style: c0, c1, ... or grey, ink
    pattern: int  # of dashes and markers
    x: Sequence[float]
    y: Sequence[float]


def lines(series: Sequence[Series], *, x_label: str, y_label: str, width: int, height: int, title: str) -> Markup:
    """Lines over a common axis, each with its markers."""
    points = [(x, y) for s in series for x, y in zip(s.x, s.y, strict=True) if math.isfinite(y)]
    if not points:
        return Markup("")
    left, right, top, bottom = 46, 14, 14, 38
    xs = ticks(min(x for x, _ in points), max(x for x, _ in points), max(3, width // 110), whole=True)
    ys = ticks(min(y for _, y in points), max(y for _, y in points), 5)
    x0, x1 = min(x for x, _ in points), max(x for x, _ in points)
    x0, x1 = (x0 - 0.5, x1 + 0.5) if x0 == x1 else (x0, x1)
    across = (width - left - right) / (x1 - x0)
    up = (height - top - bottom) / (ys[-1] - ys[0])

    def at(x: float, y: float) -> tuple[float, float]:
        return left + (x - x0) * across, height - bottom - (y - ys[0]) * up

    parts = [_opened(width, height, title)]
    for y in ys:
        _, v = at(x0, y)
        parts.append(Markup('<path class="rule" d="M{},{:.1f}H{}"/>').format(left, v, width - right))
        parts.append(Markup('<text x="{}" y="{:.1f}" class="end">{}</text>').format(left - 8, v + 4, number(y, ys)))
    for x in (x for x in xs if x0 <= x <= x1):
        u, _ = at(x, ys[0])
        parts.append(Markup('<text x="{:.1f}" y="{}" class="mid">{}</text>').format(u, height - bottom + 18, number(x, xs)))
    parts.append(Markup('<text x="{}" y="{}" class="end">{}</text>').format(width - right, height - 4, x_label))
    parts.append(Markup('<text x="0" y="10">{}</text>').format(y_label))
    for s in series:
        parts += _line([at(x, y) if math.isfinite(y) else None for x, y in zip(s.x, s.y, strict=True)], s)
    return Markup("").join([*parts, Markup("</svg>")])


def key(style: str, pattern: int) -> Markup:
    """A line's sample for a legend."""
    marker = _marker((18, 8), style, pattern)
    return Markup('<svg class="key" viewBox="0 0 36 16" width="36" height="16" aria-hidden="true">{}{}</svg>').format(
        Markup('<path class="line {}" stroke-dasharray="{}" d="M0,8H36"/>').format(style, DASHES[pattern % len(DASHES)]), marker
    )


def _line(points: Sequence[tuple[float, float] | None], s: Series) -> list[Markup]:
    path, pen = [], "M"
    for point in points:
        if point is None:
            pen = "M"
            continue
        path.append(f"{pen}{point[0]:.1f},{point[1]:.1f}")
        pen = "L"
    drawn = Markup('<path class="line {}" stroke-dasharray="{}" d="{}"/>').format(s.style, DASHES[s.pattern % len(DASHES)], "".join(path))
    marked = [point for point in points if point is not None]
    return [
        drawn,
        *(_marker(point, s.style, s.pattern) for point in marked[:: max(1, len(marked) // _FEW + 1) if len(marked) > _FEW else 1]),
    ]


def _marker(point: tuple[float, float], style: str, pattern: int) -> Markup:
    shape = MARKERS[pattern % len(MARKERS)]
    return Markup('<path class="dot {}" transform="translate({:.1f} {:.1f})" d="{}"/>').format(style, *point, shape)


def _opened(width: int, height: int, title: str) -> Markup:
    return Markup('<svg viewBox="0 0 {} {}" role="img" aria-label="{}">').format(width, height, escape(title))


def trajectory(sidecar: Sidecar, record: FrameRecord, *, width: int = 330, height: int = 250) -> Markup:
    """Position in pixels over time, with degrees on the right where the sidecar holds a focal length, and the roll below."""
    ms = 1e3 * np.array(record.trajectory.t_s)
    thin = np.unique(np.linspace(0, len(ms) - 1, _INSTANTS).round().astype(int))
    x, y = np.array(record.trajectory.x_px)[thin], np.array(record.trajectory.y_px)[thin]
    roll = np.degrees(record.trajectory.roll_rad)[thin]
    turns = bool(np.abs(roll).max() > _LEAST_ROLL)
    left, right, top, bottom = 40, 58, 22, 36
    low = 76 if turns else 0
    main = height - bottom - low
    ys = ticks(float(min(x.min(), y.min(), -0.5)), float(max(x.max(), y.max(), 0.5)), 5)
    across = (width - left - right) / (ms[-1] - ms[0])
    up = (main - top) / (ys[-1] - ys[0])
    u = left + (ms[thin] - ms[0]) * across
    camera = sidecar.settings.camera
    parts = [_opened(width, height, "the camera's path over the frame's time")]
    for value in ys:
        v = main - (value - ys[0]) * up
        parts.append(Markup('<path class="{}" d="M{},{:.1f}H{}"/>').format("axis" if value == 0 else "rule", left, v, width - right))
        parts.append(Markup('<text x="{}" y="{:.1f}" class="end">{}</text>').format(left - 6, v + 4, number(value, ys)))
        if camera.source != "assumed":
            degrees = math.degrees(math.atan(value / camera.fx))
            parts.append(
                Markup('<text x="{}" y="{:.1f}">{}°</text>').format(width - right + 6, v + 4, f"{degrees + 0.0:.2g}".replace("-", "−"))
            )
    timing = sidecar.timing(record)
    middle = left + (1e3 * timing.middle - ms[0]) * across
    parts.append(Markup('<path class="axis" stroke-dasharray="2 3" d="M{:.1f},{}V{}"/>').format(middle, top, height - bottom))
    parts.append(Markup('<text x="0" y="11">px</text>'))
    for name, values, style, pattern in (("x", x, "c0", 0), ("y", y, "c1", 1)):
        path = "M" + "L".join(f"{a:.1f},{main - (b - ys[0]) * up:.1f}" for a, b in zip(u, values, strict=True))
        parts.append(Markup('<path class="line {}" stroke-dasharray="{}" d="{}"/>').format(style, DASHES[pattern], path))
        place = left + 30 + 62 * pattern
        parts.append(Markup('<path class="line {}" stroke-dasharray="{}" d="M{},7h24"/>').format(style, DASHES[pattern], place))
        parts.append(Markup('<text x="{}" y="11">{}</text>').format(place + 30, name))
    if turns:
        reach = float(np.abs(roll).max())
        centre = main + 0.5 * low + 12
        path = "M" + "L".join(f"{a:.1f},{centre - 0.32 * low * b / reach:.1f}" for a, b in zip(u, roll, strict=True))
        parts.append(Markup('<path class="rule" d="M{},{:.1f}H{}"/>').format(left, centre, width - right))
        parts.append(Markup('<path class="line c2" stroke-dasharray="{}" d="{}"/>').format(DASHES[2], path))
        parts.append(Markup('<text x="{}" y="{:.1f}">{:.2g}°</text>').format(width - right + 6, centre - 0.32 * low + 4, reach))
        parts.append(Markup('<text x="0" y="{:.1f}">roll</text>').format(centre + 4))
    for value in ticks(float(ms[0]), float(ms[-1]), 4):
        if ms[0] <= value <= ms[-1]:
            place = left + (value - ms[0]) * across
            parts.append(Markup('<text x="{:.1f}" y="{}" class="mid">{:g}</text>').format(place, height - bottom + 16, value))
    parts.append(Markup('<text x="{}" y="{}" class="end">ms; dotted: what the result shows</text>').format(width - right, height - 4))
    return Markup("").join([*parts, Markup("</svg>")])


def falling(values: Sequence[float], *, width: int = 330, height: int = 160) -> Markup:
    """How an objective fell, step by step."""
    steps = list(range(len(values)))
    series = Series(name="objective", style="c0", pattern=0, x=steps, y=list(values))
    return lines(
        [series], x_label="step", y_label="objective", width=width, height=height, title="how the objective fell from step to step"
    )


def ticks(low: float, high: float, about: int, *, whole: bool = False) -> list[float]:
    """Round numbers that enclose an interval, about so many."""
    if not high > low:
        low, high = low - (0.5 if whole else 0.05 * max(abs(low), 0.1)), high + (0.5 if whole else 0.05 * max(abs(high), 0.1))
    rough = (high - low) / max(about - 1, 1)
    power = 10.0 ** math.floor(math.log10(rough))
    step = next(m * power for m in (1, 2, 5, 10) if m * power >= rough * 0.999)
    step = max(step, 1.0) if whole else step
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [k * step + 0.0 for k in range(first, max(last, first + 1) + 1)]


def number(value: float, among: Sequence[float]) -> str:
    """A tick's label, with as many digits as its neighbours need."""
    step = among[1] - among[0] if len(among) > 1 else 1.0
    return f"{value:.{max(0, -math.floor(math.log10(step) + 1e-9))}f}".replace("-", "−")
