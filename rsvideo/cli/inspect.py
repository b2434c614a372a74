"""rsvideo inspect: everything that is stated of a clip, and by whom."""

import sys
from pathlib import Path
from typing import Annotated, Any

import typer
from typer import Option

from rsvideo.cli import options
from rsvideo.cli.exit_codes import refusing
from rsvideo.cli.terminal import say
from rsvideo.config.printable import printable

Line = tuple[str, str, str]  # what, its value, who stated it
_WIDTH = 160  # an output that is no terminal has no width


@options.offers(
    *("camera.profile", "camera.exposure", "camera.shutter_angle", "camera.readout", "camera.row_time", "camera.scanlines_total"),
    *("camera.direction", "camera.force", "input.rate"),
)
def inspect(
    source: Annotated[Path, typer.Argument(metavar="CLIP", help="An MP4, MOV or MKV file, or a sequence's folder.")],
    given: options.Given,
    measure: Annotated[bool, Option("--measure", help="Measure from the clip's own frames what nobody states.")] = False,
    json: Annotated[bool, Option("--json", help="Print JSON.")] = False,
) -> None:
    """Show what a clip states, what other sources add, and what is missing.

    Sources of the timing, first hit wins: options, the clip's metadata, --camera, the public table of readout times, the frame rate.
    """
    from rsvideo.cli import quiet
    from rsvideo.pipeline import measuring, stated
    from rsvideo.pipeline.clip_facts import gather

    with refusing():
        typed = options.sections(given)
        with quiet.c_libraries():
            clip = gather(source, camera=typed.camera.profile, rate=typed.input.frame_rate)
            clip = measuring.with_measured(clip, typed.camera) if measure else clip
        values = stated.values(clip, typed.camera)
    if json:
        _print_json(values)
    else:
        _print_table(values)


def _print_json(values: dict[str, Any]) -> None:
    import json

    print(json.dumps(values, indent=1, allow_nan=False))


def _print_table(values: dict[str, Any]) -> None:
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True, style="bold")
    table.add_column(overflow="fold")
    table.add_column(overflow="fold", style="dim")
    for line in _lines(values):
        table.add_row(*(Text(printable(cell)) for cell in line))
    console = Console(file=sys.stdout, highlight=False, width=None if sys.stdout.isatty() else _WIDTH)
    with console.capture() as drawn:
        console.print(table)
    print("\n".join(line.rstrip() for line in drawn.get().splitlines()))
    for note in values["notes"]:
        say(f"note: {note}")


def _lines(values: dict[str, Any]) -> list[Line]:
    colour = values["colour"]
    tags = ", ".join((colour["matrix"], colour["transfer"], colour["primaries"], "full range" if colour["full_range"] else "limited range"))
    rate = f"{values['frame_rate']:.6g} fps" + (", varying" if values["variable_frame_rate"] else "")
    lines = [
        ("clip", values["clip"], ""),
        ("codec", values["codec"], ""),
        (
            "size",
            f"{values['cols']} x {values['rows']}, as stored",
            f"shown turned by {values['rotation_deg']} degrees" if values["rotation_deg"] else "",
        ),
        ("frames", f"{values['frames']}, {values['duration_s']:.3f} s at {rate}", ""),
        ("pixels", f"{colour['depth']} bits, {colour['subsampling']}, {colour['pixel_format']}", ""),
        ("colour", tags, f"assumed: {', '.join(colour['assumed']).replace('_', ' ')}" if colour["assumed"] else "the clip's tags"),
        ("tracks", "; ".join(" ".join(filter(None, track.values())) for track in values["tracks"]) or "no others", ""),
    ]
    if values["timecode"]:
        lines.append(("timecode", values["timecode"], ""))
    for name, key, unit in (("make", "make", ""), ("model", "model", ""), ("captured", "captured", ""), ("ISO", "iso", "g")):
        lines += [(name, format(values[key]["value"], unit), values[key]["source"])] if values[key] else []
    times = ("exposure", "exposure_s"), ("readout", "readout_s")
    lines += [_ranged(name, values[key], "ms", ".4g", 1e3) for name, key in times if values[key]]
    if row := values["row_time_s"]:
        lines.append(("row time", f"{row['value'] * 1e6:.4g} us", row["source"]))
    lines.append(("direction", str(values["direction"]["value"]), values["direction"]["source"]))
    if focal := values["focal_px"]:
        lines.append(_ranged("focal length", focal, "px", ".1f"))
    return lines + [("missing", what, f"{option} would say it") for what, option in values["missing"].items()]


def _ranged(name: str, fact: dict[str, Any], unit: str, form: str, factor: float = 1.0) -> Line:
    """A number, and where it lies."""
    value, low, high = (format(number * factor, form) for number in (fact["value"], *fact.get("within", (0.0, 0.0))))
    return name, f"{value} {unit}" + (f", {low} to {high} {unit}" if low != high else ""), fact["source"]
