"""rsvideo inspect: everything that is known of a clip, and who said so."""

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from rsvideo.cli.options import Way

if TYPE_CHECKING:
    from rsvideo.pipeline.clip_facts import KnownClip
    from rsvideo.shooting.fact import Fact
    from rsvideo.shooting.timing import Asked

Line = tuple[str, str, str]  # what, its value, who said so
_WIDTH = 160  # where the output is no terminal, whose width is not known


def inspect(
    source: Annotated[Path, typer.Argument(metavar="CLIP", help="An MP4, MOV or MKV file, or a sequence's folder.")],
    camera: Annotated[
        str | None, Option(metavar="NAME|FILE", help="The camera's profile by name or file, or its name in the public table.")
    ] = None,
    exposure: Annotated[str | None, Option(metavar="TIME", help="How long each row collects light: 1/50, 20ms, 0.02.")] = None,
    shutter_angle: Annotated[float | None, Option(metavar="DEG", help="The same, in degrees of a frame's period.")] = None,
    readout: Annotated[
        str | None, Option(metavar="TIME", help="From the first row's opening to the last one's; 0 is a global shutter.")
    ] = None,
    row_time: Annotated[str | None, Option(metavar="TIME", help="From one row's opening to the next one's.")] = None,
    scanlines_total: Annotated[
        int | None, Option(metavar="N", help="Visible and blanking lines: row time is 1 / (frame rate * N).")
    ] = None,
    direction: Annotated[Way | None, Option(help="The way the readout runs over the picture as stored.")] = None,
    rate: Annotated[str | None, Option(metavar="FPS", help="Of a sequence: 25, 24000/1001.")] = None,
    force: Annotated[bool, Option("--force", help="Take times longer than a frame's period.")] = False,
    json: Annotated[bool, Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show what is known of a clip, from where, and what is missing.

    Sources of the timing, first hit wins: options, the clip's metadata, --camera, the public table of readout times, the frame rate.
    """
    from rsvideo.cli import quiet
    from rsvideo.cli.exit_codes import RefusedError
    from rsvideo.config.files import UnreadableError
    from rsvideo.config.quantity import frame_rate, seconds
    from rsvideo.physics.shutter import Direction
    from rsvideo.pipeline.clip_facts import gather
    from rsvideo.shooting.timing import Asked

    try:
        asked = Asked(
            exposure=None if exposure is None else seconds("exposure", exposure),
            shutter_angle=shutter_angle,
            readout=None if readout is None else seconds("readout", readout),
            row_time=None if row_time is None else seconds("row-time", row_time),
            scanlines_total=scanlines_total,
            direction=Direction(direction) if direction else None,
            force=force,
        )
        with quiet.c_libraries():
            clip = gather(source, camera=camera, rate=None if rate is None else frame_rate(rate))
        told = _told(clip, asked)
    except UnreadableError:
        raise
    except ValueError as error:
        raise RefusedError(str(error)) from error
    if json:
        _print_json(told)
    else:
        _print_table(told)


def _told(clip: "KnownClip", asked: "Asked") -> dict[str, Any]:
    """All facts, under the names of the JSON output."""
    from rsvideo.physics.shutter import Direction
    from rsvideo.shooting.timing import direction_of, exposure_of, readout_of

    stream, facts = clip.stream, clip.facts
    exposure, notes = exposure_of(asked, clip.shutter)
    readout, more = readout_of(asked, clip.shutter)
    direction = direction_of(asked, clip.shutter)
    scanlines = stream.rows if direction.value in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP) else stream.cols
    colour = stream.colour
    missing = {
        "exposure": None if exposure else "--exposure 1/50 or --shutter-angle 180",
        "readout, but for its upper bound": None
        if readout and readout.source != "frame rate"
        else "--readout, --camera or --scanlines-total",
        "focal length": None if clip.focal else "--focal-px, or --camera with a profile that holds the lens",
    }
    return {
        "clip": str(stream.path),
        "codec": stream.codec,
        "cols": stream.cols,
        "rows": stream.rows,
        "rotation_deg": stream.rotation,
        "frame_rate": float(stream.rate),
        "variable_frame_rate": stream.variable,
        "frames": stream.frames,
        "duration_s": stream.duration_s,
        "timecode": stream.timecode,
        "created": stream.created,
        "colour": {
            "pixel_format": colour.pixel_format,
            "depth": colour.depth,
            "subsampling": colour.subsampling,
            "matrix": colour.matrix.value,
            "transfer": colour.transfer.value,
            "primaries": colour.primaries,
            "full_range": colour.full_range,
            "assumed": sorted(colour.assumed),
        },
        "tracks": [{"kind": track.kind, "codec": track.codec, "name": track.name} for track in stream.tracks],
        "make": _said(facts.make),
        "model": _said(facts.model),
        "captured": _said(facts.captured),
        "iso": _said(facts.iso),
        "recorded_frame_rate": _said(facts.frame_rate),
        "exposure_s": _said(exposure),
        "readout_s": _said(readout),
        "row_time_s": {"value": readout.value / scanlines, "source": f"readout / {scanlines}"} if readout else None,
        "direction": _said(direction),
        "focal_px": _said(clip.focal),
        "missing": {what: option for what, option in missing.items() if option},
        "notes": [*clip.notes, *notes, *more],
    }


def _said(said: "Fact[Any] | None") -> dict[str, Any] | None:
    if said is None:
        return None
    return {"value": said.value, "source": said.source, **({"within": list(said.within)} if said.within else {})}


def _print_json(told: dict[str, Any]) -> None:
    import json

    print(json.dumps(told, indent=1, allow_nan=False))


def _print_table(told: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    table.add_column(overflow="fold", style="dim")
    for line in _lines(told):
        table.add_row(*(Text(_printable(cell)) for cell in line))
    console = Console(file=sys.stdout, highlight=False, width=None if sys.stdout.isatty() else _WIDTH)
    with console.capture() as drawn:
        console.print(table)
    print("\n".join(line.rstrip() for line in drawn.get().splitlines()))
    for note in told["notes"]:
        print(f"rsvideo: note: {_printable(note)}", file=sys.stderr)


def _lines(told: dict[str, Any]) -> list[Line]:
    colour = told["colour"]
    tags = ", ".join((colour["matrix"], colour["transfer"], colour["primaries"], "full range" if colour["full_range"] else "limited range"))
    rate = f"{told['frame_rate']:.6g} fps" + (", varying" if told["variable_frame_rate"] else "")
    lines = [
        ("clip", told["clip"], ""),
        ("codec", told["codec"], ""),
        (
            "size",
            f"{told['cols']} x {told['rows']}, as stored",
            f"shown turned by {told['rotation_deg']} degrees" if told["rotation_deg"] else "",
        ),
        ("frames", f"{told['frames']}, {told['duration_s']:.3f} s at {rate}", ""),
        ("pixels", f"{colour['depth']} bits, {colour['subsampling']}, {colour['pixel_format']}", ""),
        ("colour", tags, f"assumed: {', '.join(colour['assumed']).replace('_', ' ')}" if colour["assumed"] else "the clip's tags"),
        ("tracks", "; ".join(" ".join(filter(None, track.values())) for track in told["tracks"]) or "no others", ""),
    ]
    if told["timecode"]:
        lines.append(("timecode", told["timecode"], ""))
    for name, key, unit in (("make", "make", ""), ("model", "model", ""), ("captured", "captured", ""), ("ISO", "iso", "g")):
        lines += [(name, format(told[key]["value"], unit), told[key]["source"])] if told[key] else []
    lines += [_timed(name, told[key]) for name, key in (("exposure", "exposure_s"), ("readout", "readout_s")) if told[key]]
    if row := told["row_time_s"]:
        lines.append(("row time", f"{row['value'] * 1e6:.4g} us", row["source"]))
    lines.append(("direction", str(told["direction"]["value"]), told["direction"]["source"]))
    if focal := told["focal_px"]:
        lines.append(("focal length", f"{focal['value']:.1f} px", focal["source"]))
    return lines + [("missing", what, f"{option} would say it") for what, option in told["missing"].items()]


def _timed(name: str, fact: dict[str, Any]) -> Line:
    low, high = (f"{time * 1e3:.4g}" for time in fact.get("within", (0.0, 0.0)))
    return name, f"{fact['value'] * 1e3:.4g} ms" + (f", {low} to {high} ms" if low != high else ""), fact["source"]


def _printable(text: str) -> str:
    return "".join(letter if letter.isprintable() else "?" for letter in text)
