"""rsvideo calibrate lensfun: a lens that was not measured, out of a database."""

from typing import Annotated

from typer import Option

from rsvideo.cli.calibrate_profile import Add, Output, Overwrite, earlier, finish, merged
from rsvideo.cli.terminal import say
from rsvideo.cli.validate import refusing


def lensfun(
    camera: Annotated[str, Option("--camera", metavar="CAMERA", help="As EXIF names it: 'Canon EOS 70D'.")],
    lens: Annotated[str, Option("--lens", metavar="LENS", help="Its name or a part of it: 'EF-S 18-135'.")],
    focal_mm: Annotated[float, Option(metavar="MM", help="The focal length that was set, not the equivalent.")],
    size: Annotated[str, Option(metavar="COLSxROWS", help="Of the pictures: 1920x1080.")],
    output: Output = None,
    add: Add = False,
    overwrite: Overwrite = False,
) -> None:
    """Look a lens up in lensfun's database, where nothing was measured; needs the extra rsvideo[lensfun]."""
    import re

    with refusing():
        import calibration
        from rsvideo.cli.exit_codes import RefusedError

        if not (sides := re.fullmatch(r"(\d{1,6})x(\d{1,6})", size)):
            raise RefusedError(f"--size must be columns x rows such as 1920x1080, got {size[:40]!r}")
        before = earlier(output, add=add, overwrite=overwrite)
        cols, rows = int(sides[1]), int(sides[2])
        prior = calibration.look_up_lens(camera, lens, focal_mm=focal_mm, rows=rows, cols=cols)
        profile = merged(before, prior.profile())
    for note in prior.notes:
        say(note)
    finish(profile, output)
