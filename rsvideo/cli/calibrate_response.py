"""rsvideo calibrate response: how codes stand for light, from an exposure series."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from rsvideo.cli.calibrate_profile import Add, Maker, Name, Output, Overwrite, earlier, finish, first_name, merged
from rsvideo.cli.terminal import say
from rsvideo.cli.validate import refusing

_CURVES = 4  # the best ones, that are named


def response(
    sources: Annotated[
        list[Path], typer.Argument(metavar="BRACKET...", help="Photographs of one still scene from a tripod, exposed for different times.")
    ],
    exposures: Annotated[
        str | None, Option(metavar="TIMES", help="In the photographs' order: 1/1000,1/500,...; from EXIF unless given.")
    ] = None,
    output: Output = None,
    name: Name = None,
    maker: Maker = None,
    add: Add = False,
    overwrite: Overwrite = False,
) -> None:
    """Measure how codes stand for light: the tone curve, where highlights clip, and the noise.

    One scene with dark and bright flat parts, ISO, aperture and white balance fixed, one or two stops from one exposure to the next.
    """
    with refusing():
        import calibration
        from rsvideo.cli import quiet
        from rsvideo.config.quantity import seconds

        before = earlier(output, add=add, overwrite=overwrite)
        times = [seconds("exposures", text) for text in exposures.split(",")] if exposures else None
        with quiet.c_libraries():
            found = calibration.response(sources, times)
        profile = merged(before, found.profile(name=first_name(name, found.camera, output), maker=maker))
    for note in found.notes:
        say(note)
    best = sorted(found.misfits.items(), key=lambda one: one[1])[:_CURVES]
    say("what each curve leaves of light: " + ", ".join(f"{curve} {misfit:.1%}" for curve, misfit in best))
    if found.noise:
        twice = "" if "pairs" in found.noise.how else "; two photographs at each exposure tell it more surely"
        say(f"noise by {found.noise.how}; it belongs to the ISO that was set{twice}")
    else:
        say("too few flat patches to measure noise by; a defocused wall has many")
    finish(profile, output)
