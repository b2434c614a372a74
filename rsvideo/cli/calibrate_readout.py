"""rsvideo calibrate readout: how long a camera takes from its first row to its last."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from rsvideo.cli.calibrate_profile import Add, Maker, Name, Output, Overwrite, earlier, finish, named, print_json, say, today
from rsvideo.cli.options import Way
from rsvideo.cli.validate import refusing

MOST_FRAMES = 10_000


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
    direction: Annotated[Way | None, Option(help="The way the readout runs over the picture as stored, if it is known.")] = None,
    frames: Annotated[int, Option(min=1, max=MOST_FRAMES, help="How many of CLIP's frames are used.")] = 120,
    output: Output = None,
    name: Name = None,
    maker: Maker = None,
    add: Add = False,
    overwrite: Overwrite = False,
    json: Annotated[bool, Option("--json", help="Print all that was found, as JSON.")] = False,
) -> None:
    """Measure the time from the first row to the last: from bands of a flickering light, or from ordinary footage.

    Best is an LED that flickers at a known 500 to 1000 Hz, close to a white wall or the lens, filmed with a short exposure.
    """
    from rsvideo.cli import exit_codes

    with refusing():
        from calibration import profile as parts
        from calibration import views
        from calibration.bands import CannotTellError
        from rsvideo.cli import quiet
        from rsvideo.cli.calibrate_readout_ways import way
        from rsvideo.config.quantity import frame_rate
        from rsvideo.physics.shutter import Direction
        from rsvideo.shooting.camera_profile import CameraProfile, Clock, Measured, Mode

        before = earlier(output, add=add, overwrite=overwrite)
        find = way(source, flicker, from_clip, from_table, scanlines_total, wanted=from_frame_rate)
        try:
            with quiet.c_libraries():
                found = find(None if rate is None else frame_rate(rate), Direction(direction) if direction else None, frames)
        except CannotTellError as error:
            say(f"cannot tell the readout: {error}")
            raise typer.Exit(exit_codes.Code.FAILED) from error
        asked = Direction(direction) if direction else None
        notes = list(found.notes)
        if found.direction is None and asked is None:
            notes.append("the direction is taken to be top-to-bottom; --direction says another")
        if asked is not None and found.direction not in (None, asked):
            notes.append(f"the direction is {asked.value} as asked for, though it looks {found.direction.value}")
        whence = parts.found(found.how, views.named(found.files[:frames]), today())
        if found.source:
            whence = whence.model_copy(update={"source": found.source})
        profile = CameraProfile(
            name=named(name, found.camera, output),
            maker=maker or found.maker,
            mode=Mode(rows=found.rows, cols=found.cols, fps=None if found.fps is None else round(found.fps, 3)),
            timing=Clock(
                readout_s=Measured(value=round(found.readout, 9), std=None if found.std is None else float(f"{found.std:.3g}")),
                direction=asked or found.direction or Direction.TOP_TO_BOTTOM,
                found=whence,
            ),
        )
        if before:
            profile = parts.merged(before, profile)
    if json:
        facts = {"readout_s": found.readout, "std_s": found.std, "direction": found.direction.value if found.direction else None}
        whole = profile.model_dump(mode="json", exclude_none=True)
        print_json({**facts, "how": found.how, **found.more, "notes": notes, "profile": whole})
    for note in notes:
        say(f"note: {note}")
    say(f"readout {found.readout * 1e3:.5g} ms" + (f", give or take {found.std * 1e3:.2g} ms" if found.std else "") + f": {found.how}")
    finish(profile, output, printed=not json)
