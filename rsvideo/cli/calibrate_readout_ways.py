"""The four ways to a readout: bands of a flickering light, hand-held footage, the public table, the frame rate."""

import re
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibration.footage import Footage
    from rsvideo.physics.shutter import Direction

_ENOUGH = 3  # owners, for a spread
_FREQUENCY = re.compile(r"(\d+\.?\d*|\.\d+)\s*(k?)(hz)?", re.IGNORECASE)
_LOWEST, _HIGHEST = 20.0, 100e3  # Hz
_MODE = re.compile(r"(?:(\d{1,5})x)?(\d{1,5})(?:(?:@|p)(\d{1,4}(?:\.\d*)?)|p)?", re.IGNORECASE)


@dataclass(frozen=True, kw_only=True, eq=False)
class Answer:
    """A readout, in the words of the profile."""

    readout: float  # seconds
    std: float | None
    direction: "Direction | None"  # None: not told
    how: str
    source: str | None  # of what no file holds
    rows: int
    cols: int
    fps: float | None
    files: tuple[Path, ...]
    camera: str | None
    maker: str | None
    notes: tuple[str, ...]
    more: dict[str, Any]  # for --json


Finder = Callable[[Fraction | None, "Direction | None", int], Answer]


def way(
    source: Path | None,
    flicker: str | None,
    from_clip: Path | None,
    from_table: tuple[str, str] | None,
    scanlines_total: int | None,
    *,
    wanted: bool,
) -> Finder:
    """The one way that was asked for."""
    ways: dict[str, Finder | None] = {
        "--flicker": (lambda *how: _from_flicker(_given(source), _hertz(flicker or ""), *how)) if flicker is not None else None,
        "--from-clip": (lambda *how: _from_clip(from_clip or Path(), *how)) if from_clip is not None else None,
        "--from-table": (lambda *_: _from_table(*(from_table or ("", "")))) if from_table is not None else None,
        "--from-frame-rate": (lambda *how: _from_frame_rate(_given(source), scanlines_total, *how)) if wanted else None,
    }
    chosen = {name: way for name, way in ways.items() if way is not None}
    if len(chosen) != 1:
        raise ValueError(f"the readout is measured by one of {', '.join(ways)}, got {' and '.join(chosen) or 'none'}")
    (option, way), *_ = chosen.items()
    if source is not None and option in ("--from-clip", "--from-table"):
        raise ValueError(f"{option} takes no other CLIP, got {source}")
    if scanlines_total is not None and option != "--from-frame-rate":
        raise ValueError(f"--scanlines-total belongs to --from-frame-rate, got it with {option}")
    return way


def _given(source: Path | None) -> Path:
    if source is None:
        raise ValueError("CLIP must be given, before the options")
    return source


def _hertz(text: str) -> float:
    match = _FREQUENCY.fullmatch(text.strip())
    value = float(match[1]) * (1e3 if match[2] else 1) if match else 0.0
    if not _LOWEST <= value <= _HIGHEST:
        raise ValueError(f"flicker must be a frequency from {_LOWEST:g} Hz to {_HIGHEST / 1e3:g} kHz such as 1000Hz, got {text[:40]!r}")
    return value


def _sides(direction: "Direction | None") -> "tuple[bool, tuple[Direction, Direction]]":
    """Whether scanlines are rows, and the direction in which they count and the other."""
    from rsvideo.physics.shutter import Direction

    if direction in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT):
        return False, (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT)
    return True, (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP)


def _from_flicker(path: Path, hertz: float, rate: Fraction | None, direction: "Direction | None", most: int) -> Answer:
    from calibration import footage
    from calibration.readout import measure, profile
    from rsvideo.cli.progress import bar

    _, ways = _sides(direction)
    if path.is_dir() and rate is None:
        return _from_photographs(path, hertz, ways)
    seen = footage.look(path, rate)
    profiles, times, count = [], [], min(most, seen.frames)
    with bar() as show:
        for time, light in footage.frames(seen, most):
            show("reading", len(times) / count)
            profiles.append(profile(ways[0].scanlines(light)))
            times.append(time)
    bands = measure(profiles, times, hertz, longest=seen.period, downwards=ways)
    how = f"bands of a light that flickers at {bands.light:g} Hz, {bands.period:.5g} rows apart, in {_counted(bands.frames, 'frame')}"
    more = {"row_time_s": bands.row_time, "period_rows": bands.period, "light_hz": bands.light, "frames": bands.frames}
    notes = seen.notes + bands.notes + (() if bands.frames > 1 else ("one picture tells no direction and less than a clip",))
    return _answer(seen, bands.readout, bands.std, bands.direction, how, notes, more)


def _from_photographs(folder: Path, hertz: float, ways: "tuple[Direction, Direction]") -> Answer:
    """Each photograph by itself, and what all say together."""
    from calibration import footage, views
    from calibration.bands import CannotTellError
    from calibration.readout import combined, measure, profile
    from rsvideo.config.files import UnreadableError

    files = views.photographs([folder])
    if not files:
        raise UnreadableError(f"{folder} holds no photograph; is it the right folder?")
    looked, bands, notes = [], [], []
    for path in files:
        seen = footage.look(path, None)
        try:
            told = [measure([profile(ways[0].scanlines(light))], [0.0], hertz, downwards=ways) for _, light in footage.frames(seen, 1)]
        except CannotTellError as error:
            notes.append(f"not used: {path.name}: {error}")
            continue
        if looked and (seen.rows, seen.cols) != (looked[0].rows, looked[0].cols):
            raise ValueError(f"photographs must be of one size, {path.name} is {seen.cols} x {seen.rows}, {looked[0].files[0].name} is not")
        looked.append(seen)
        bands += told
    if not bands:
        raise CannotTellError(f"none of {_counted(len(files), 'photograph')} shows bands: {notes[0].split(': ', 2)[2]}")
    found = combined(bands)
    how = f"bands of a light that flickers at {found.light:g} Hz, {found.period:.5g} rows apart, in {_counted(len(bands), 'photograph')}"
    more = {"row_time_s": found.row_time, "period_rows": found.period, "light_hz": found.light, "frames": len(bands)}
    single = ("photographs tell no direction; for a clip's frames, which do, give --rate",)
    answer = _answer(looked[0], found.readout, found.std, None, how, (*notes, *found.notes, *single), more)
    return replace(answer, files=tuple(path for seen in looked for path in seen.files))


def _from_clip(path: Path, rate: Fraction | None, direction: "Direction | None", most: int) -> Answer:
    from calibration import footage
    from calibration.selfcal import Pair, explain
    from rsvideo.cli.progress import bar
    from rsvideo.restoration import tracks

    upright, ways = _sides(direction)
    seen = footage.look(path, rate)
    if seen.period is None or seen.frames < 2:
        raise ValueError(f"{path} must be a clip, a photograph shows no motion from frame to frame")
    pairs, before, count = [], None, min(most, seen.frames)
    with bar() as show:
        for time, light in footage.frames(seen, most):
            show("following points", 0.5 * len(pairs) / count)
            now = tracks.codes(ways[0].scanlines(light).mean(axis=2, dtype=float))
            if before is not None:
                found = tracks.track(before[1], now)
                pairs.append(Pair(before=found.before, after=found.after, begins=(before[0], time)))
            before = time, now
        scanlines, along = (seen.rows, seen.cols) if upright else (seen.cols, seen.rows)
        told = explain(
            pairs,
            rows=scanlines,
            cols=along,
            period=seen.period,
            downwards=ways,
            tell=lambda fraction: show("trying readouts", 0.5 + 0.5 * fraction),
        )
    how = f"motion of points between {_counted(told.pairs, 'pair')} of frames of hand-held footage"
    costs = [{"readout_s": float(at), "cost": float(cost)} for at, cost in zip(told.readouts, told.costs, strict=True)]
    more = {"curvature_per_s2": told.curvature, "better_than_global": told.over_global, "pairs": told.pairs, "costs": costs}
    curvature = f"the cost rises by 1/2 within {1e3 / max(told.curvature, 1e-30) ** 0.5:.2g} ms of its lowest"
    notes = (*seen.notes, f"{curvature}; a global shutter is less likely by {told.over_global:.0f} in log-likelihood")
    return _answer(seen, told.readout, told.std, told.direction, how, notes, more)


def _from_frame_rate(path: Path, total: int | None, rate: Fraction | None, direction: "Direction | None", _: int) -> Answer:
    from calibration import footage

    seen = footage.look(path, rate)
    if seen.period is None:
        raise ValueError(f"{path} has no frame rate; give --rate, or measure with --flicker")
    scanlines = seen.rows if _sides(direction)[0] else seen.cols
    bound = f"a frame's period of {seen.period * 1e3:.4g} ms"
    if total is None:
        raise ValueError(
            f"--from-frame-rate needs --scanlines-total N; without it {bound} is only an upper bound, cameras read in about half"
        )
    if not scanlines <= total <= 20 * scanlines:
        raise ValueError(
            f"scanlines-total must be from the {scanlines} that are stored to twenty times as many, got {total};"
            " it counts blanking lines too; was the clip scaled?"
        )
    row_time = seen.period / total  # Forssen & Ringaby: 1/f = rows t_r + t_d
    how = f"frame rate of {seen.fps:.5g} and {total} scanlines in all, {scanlines} of them stored"
    delay = (total - scanlines) * row_time
    notes = (
        f"{bound} is the readout and an inter-frame delay of {delay * 1e3:.3g} ms, in which {total - scanlines} lines that are"
        " not stored go by (Forssen & Ringaby); true only if all lines are read evenly",
    )
    return _answer(seen, scanlines * row_time, None, None, how, seen.notes + notes, {"row_time_s": row_time, "inter_frame_delay_s": delay})


def _from_table(camera: str, mode: str) -> Answer:
    from rsvideo.config.yaml import meant
    from rsvideo.shooting import readout_table as table

    match = _MODE.fullmatch(mode.strip())
    if not match or not int(match[2]):
        raise ValueError(f"MODE must read like 1920x1080@29.97, 3840x2160 or 1080p60, got {mode[:40]!r}")
    rows, fps = int(match[2]), float(match[3]) if match[3] else None
    cols = int(match[1]) if match[1] else round(rows * 16 / 9 / 2) * 2
    found = table.typical(camera, rows=rows, cols=cols, fps=fps or None)
    if found is None:
        near = table.similar(camera)
        raise ValueError(f"the public table does not know {camera[:100]!r}{meant(camera, near)}")
    std = (found.high - found.low) / (2 * 1.645) if found.n >= _ENOUGH else None  # nine of ten lie between
    between = f", nine of ten between {found.low * 1e3:.4g} and {found.high * 1e3:.4g} ms" if found.n >= _ENOUGH else ""
    notes: tuple[str, ...] = ()
    if found.n < _ENOUGH:
        notes += (f"{_counted(found.n, 'owner')} published it, too few for a spread; a measurement of your own says more",)
    asked = f"{cols} x {rows}" + (f" at {fps:.5g} fps" if fps else "")
    if found.mode != asked:
        notes += (f"nobody published {asked}; taken from {found.mode}",)
    return Answer(
        readout=found.median,
        std=std,
        direction=found.direction,
        how=f"the {'median' if found.n > 1 else 'figure'} of {_counted(found.n, 'owner')} for {found.mode}{between}",
        source="public table of readout times: Gyroflow's lens profiles, CC0 1.0",
        rows=rows,
        cols=cols,
        fps=fps or None,
        files=(),
        camera=camera,
        maker=None,
        notes=notes,
        more={"owners": found.n, "low_s": found.low, "high_s": found.high},
    )


def _answer(
    seen: "Footage",
    readout: float,
    std: float | None,
    direction: "Direction | None",
    how: str,
    notes: tuple[str, ...],
    more: dict[str, Any],
) -> Answer:
    return Answer(
        readout=readout,
        std=std,
        direction=direction,
        how=how,
        source=None,
        rows=seen.rows,
        cols=seen.cols,
        fps=seen.fps,
        files=seen.files,
        camera=seen.camera,
        maker=None,
        notes=notes,
        more=more,
    )


def _counted(number: int, noun: str) -> str:
    return f"{number} {noun}{'' if number == 1 else 's'}"
