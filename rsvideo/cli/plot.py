"""rsvideo plot: the motion in a sidecar, drawn."""

from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from rsvideo.cli.terminal import say


def plot(
    source: Annotated[Path, typer.Argument(metavar="SIDECAR", help="The .rsvideo.json beside a restored picture.")],
    output: Annotated[Path, Option("-o", "--output", metavar="FIG", help="Where to draw: .png, .pdf or .svg.")],
    overwrite: Annotated[bool, Option("--overwrite", help="Replace FIG.")] = False,
) -> None:
    """Draw the trajectory over time, and the blur it makes across the frame."""
    from rsvideo.cli.exit_codes import RefusedError, refusing
    from rsvideo.config import sidecar
    from rsvideo.config.files import write_whole
    from rsvideo.config.placing import check
    from rsvideo.report import plots

    kind = output.suffix.lower().removeprefix(".")
    if kind not in plots.FORMATS:
        raise RefusedError(f"{output} must end in .{', .'.join(plots.FORMATS)}, it ends in {output.suffix!r}; the ending names the format")
    if not output.parent.is_dir():
        raise RefusedError(f"the folder {output.parent} of FIG must exist; make it first, or is its name mistyped?")
    with refusing():
        check([output], [source], overwrite=overwrite)
    write_whole({output: plots.motion(sidecar.read(source, most_frames=1), kind)})
    say(f"drawn: {output}")
