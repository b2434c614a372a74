"""rsvideo calibrate show, convert and schema: a profile for eyes, for other programs and for editors."""

import enum
import sys
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from rsvideo.cli.calibrate_profile import Overwrite, print_json
from rsvideo.cli.terminal import say
from rsvideo.cli.validate import refusing


class Form(enum.StrEnum):
    """Files that hold a camera."""

    RSVIDEO = "rsvideo"
    GYROFLOW = "gyroflow"
    KALIBR = "kalibr"
    OPENCV = "opencv"
    ROS = "ros"


def show(
    camera: Annotated[str, typer.Argument(metavar="PROFILE", help="A profile by name or file; lens profiles of other programs too.")],
    output: Annotated[Path, Option("-o", "--output", metavar="FIG", help="Where to draw: .png, .pdf or .svg.")],
    overwrite: Overwrite = False,
) -> None:
    """Draw a profile on one page: lens, timing, tone curve and noise."""
    with refusing():
        from calibration import profile

        profile.show(camera, output, overwrite=overwrite)
    say(f"drawn: {output}")


def convert(
    camera: Annotated[str, typer.Argument(metavar="PROFILE", help="A profile by name or file, in any of the forms.")],
    to: Annotated[Form, Option(help="Whose form to write.")],
    output: Annotated[Path | None, Option("-o", "--output", metavar="FILE", help="Where to write; else it is printed.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a profile as Gyroflow, OpenCV, kalibr or ROS read it, or theirs as ours."""
    with refusing():
        from calibration import profile
        from calibration.output import file_format
        from rsvideo.config.files import write_whole

        text, notes = profile.convert(camera, to.value)
        if output is None:
            sys.stdout.write(text)
        else:
            file_format(output, (), overwrite=overwrite, read=[Path(camera)])
            write_whole({output: text.encode()})
    for note in notes:
        say(note)
    if output:
        say(f"written: {output}")


def schema() -> None:
    """Print the JSON Schema of a profile, by which editors complete and check it."""
    from rsvideo.shooting.camera_profile import CameraProfile

    print_json(CameraProfile.model_json_schema())
