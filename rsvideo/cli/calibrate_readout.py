"""rsvideo calibrate readout: how long a camera takes from its first row to its last."""

import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from rsvideo.cli.calibrate_profile import Add, Maker, Name, Output, Overwrite, earlier, finish, first_name, merged, print_json
from rsvideo.cli.options import DirectionName
from rsvideo.cli.terminal import say
from rsvideo.cli.validate import refusing

if TYPE_CHECKING:
    from calibration import ReadoutMeasurement
    from rsvideo.shooting.camera_profile import CameraProfile

MOST_FRAMES, FRAMES = 10_000, 120  # as in calibration.timing.measure, whose libraries take time to load
_FREQUENCY = re.compile(r"(\d+\.?\d*|\.\d+)\s*(k?)(hz)?", re.IGNORECASE)


def readout(
    source: Annotated[Path | None, typer.Argument(metavar="[CLIP]", help="A clip, a photograph, or the folder of a sequence.")] = None,
    flicker: Annotated[
        str | None, Option(metavar="HZ", help="CLIP is lit by a light that flickers so often: 1000Hz; 100Hz or 120Hz for lamps on mains.")
    ] = None,
    from_clip: Annotated[Path | None, Option(metavar="CLIP", help="Hand-held footage of anything with texture, not stabilised.")] = None,
    from_table: Annotated[
        tuple[str, str] | None, Option(metavar="CAMERA MODE", help="What owners published: 'GoPro HERO8 Black' 1920x1080@60, or 1080p60.")
    ] = None,
    from_frame_rate: Annotated[bool, Option("--from-frame-rate", help="CLIP's frame rate, with --scanlines-total.")] = False,
    scanlines_total: Annotated[int | None, Option(metavar="N", help="Visible and blanking lines of the sensor's mode.")] = None,
    rate: Annotated[str | None, Option(metavar="FPS", help="Of the recording, where CLIP does not say it: 25, 24000/1001.")] = None,
    direction: Annotated[DirectionName | None, Option(help="The way the readout runs over the picture as stored, if it is known.")] = None,
    frames: Annotated[int, Option(min=1, max=MOST_FRAMES, help="How many of CLIP's frames are used.")] = FRAMES,
    output: Output = None,
    name: Name = None,
    maker: Maker = None,
    add: Add = False,
    overwrite: Overwrite = False,
    json: Annotated[bool, Option("--json", help="Print all that was found, as JSON.")] = False,
) -> None:
    """Measure the time from the first row to the last: from bands of a flickering light, or from ordinary footage.

    Best is an LED that flickers at an exact 500 to 1000 Hz, close to a white wall or the lens, filmed with a short exposure.
    """
    from rsvideo.cli import exit_codes

    with refusing():
        import calibration
        from rsvideo.cli.progress import progress_bar
        from rsvideo.config.quantity import frame_rate

        before = earlier(output, add=add, overwrite=overwrite)
        _check_method(source, flicker, from_clip, from_table, scanlines_total, from_frame_rate=from_frame_rate)
        fps = None if rate is None else frame_rate(rate)
        hertz = None if flicker is None else _hertz(flicker)
        with progress_bar() as observe:
            found = calibration.readout(
                from_clip or source,
                flicker=hertz,
                from_clip=from_clip is not None,
                table=from_table,
                from_frame_rate=from_frame_rate,
                scanlines_total=scanlines_total,
                frame_rate=fps,
                direction=direction,
                frames=frames,
                observer=observe,
            )
        if isinstance(found, calibration.CannotTell):
            say(f"cannot tell the readout: {found.reason}")
            raise typer.Exit(exit_codes.Code.FAILED)
        profile = merged(before, found.profile(name=first_name(name, found.camera, output), maker=maker))
    if json:
        _print_json(found, profile)
    for note in found.notes:
        say(f"note: {note}")
    say(f"readout {found.value * 1e3:.5g} ms" + (f", give or take {found.std * 1e3:.2g} ms" if found.std else "") + f": {found.how}")
    finish(profile, output, printed=not json)


def _check_method(
    source: Path | None,
    flicker: str | None,
    from_clip: Path | None,
    from_table: tuple[str, str] | None,
    scanlines_total: int | None,
    *,
    from_frame_rate: bool,
) -> None:
    """Refuse options that do not name exactly one method and its material."""
    methods = {
        "--flicker": flicker is not None,
        "--from-clip": from_clip is not None,
        "--from-table": from_table is not None,
        "--from-frame-rate": from_frame_rate,
    }
    chosen = [name for name, is_chosen in methods.items() if is_chosen]
    if len(chosen) != 1:
        raise ValueError(f"the readout is measured by one of {', '.join(methods)}, got {' and '.join(chosen) or 'none'}")
    if source is not None and chosen[0] in ("--from-clip", "--from-table"):
        raise ValueError(f"{chosen[0]} takes no other CLIP, got {source}")
    if scanlines_total is not None and not from_frame_rate:
        raise ValueError(f"--scanlines-total belongs to --from-frame-rate, got it with {chosen[0]}")
    if source is None and chosen[0] in ("--flicker", "--from-frame-rate"):
        raise ValueError("CLIP must be given, before the options")


def _hertz(text: str) -> float:
    """The frequency that `1000Hz`, `1 kHz` or `1000` writes."""
    from calibration.timing.measure import FLICKER_HZ

    lowest, highest = FLICKER_HZ
    match = _FREQUENCY.fullmatch(text.strip())
    value = float(match[1]) * (1e3 if match[2] else 1) if match else 0.0
    if not lowest <= value <= highest:
        raise ValueError(f"flicker must be a frequency from {lowest:g} Hz to {highest / 1e3:g} kHz such as 1000Hz, got {text[:40]!r}")
    return value


def _print_json(found: "ReadoutMeasurement", profile: "CameraProfile") -> None:
    """All that was found, for machines."""
    facts = {"readout_s": found.value, "std_s": found.std, "direction": found.direction.value if found.direction else None}
    whole = profile.model_dump(mode="json", exclude_none=True)
    print_json({**facts, "how": found.how, **found.details, "notes": list(found.notes), "profile": whole})
