"""rsvideo calibrate response: how codes stand for light, from an exposure series."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from rsvideo.cli.calibrate_profile import Add, Maker, Name, Output, Overwrite, earlier, finish, named, say, today
from rsvideo.cli.validate import refusing


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
        from calibration import profile as parts
        from calibration import response as fitting
        from calibration import views
        from rsvideo.cli import quiet
        from rsvideo.cli.exit_codes import RefusedError
        from rsvideo.config.quantity import seconds
        from rsvideo.shooting.camera_profile import CameraProfile, Mode
        from rsvideo.stills import still

        before = earlier(output, add=add, overwrite=overwrite)
        given = [seconds("exposures", text) for text in exposures.split(",")] if exposures else None
        if given is not None and len(given) != len(sources):
            raise RefusedError(f"--exposures must name one time for each of {len(sources)} photographs, it names {len(given)}")
        with quiet.c_libraries():
            stills = [still.read(path) for path in sources]
        times = given or [one.shot.exposure or 0.0 for one in stills]
        if missing := [path.name for path, time in zip(sources, times, strict=True) if not time]:
            raise RefusedError(f"{missing[0]} must say its exposure in EXIF, it does not; give all with --exposures 1/1000,1/500,...")
        if given is None:
            times = fitting.exact(times)
        shots = [
            fitting.Shot(name=path.name, samples=one.codes.samples, exposure=time, linear=one.format is still.Format.RAW)
            for path, one, time in zip(sources, stills, times, strict=True)
        ]
        found = fitting.measure(shots)
        rows, cols = shots[0].samples.shape[:2]
        whence = parts.found(f"{len(shots)} exposures of {min(times):.3g} to {max(times):.3g} s", views.named(sources), today())
        profile = CameraProfile(
            name=named(name, stills[0].shot.camera, output),
            maker=maker,
            mode=Mode(rows=rows, cols=cols),
            tone=parts.tone(found, whence),
            noise=parts.noise(found, whence),
        )
        if before:
            profile = parts.merged(before, profile)
    for note in found.notes:
        say(note)
    best = sorted(found.rests.items(), key=lambda one: one[1])[:4]
    say("what each curve leaves of light: " + ", ".join(f"{curve} {rest:.1%}" for curve, rest in best))
    if found.noise:
        twice = "" if "pairs" in found.noise.how else "; two photographs at each exposure tell it more surely"
        say(f"noise by {found.noise.how}; it belongs to the ISO that was set{twice}")
    else:
        say("too few flat patches to measure noise by; a defocused wall has many")
    finish(profile, output)
