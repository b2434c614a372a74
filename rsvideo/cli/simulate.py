"""rsvideo simulate: a sharp photograph or clip in, a blurred one out, and its truth."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from rsvideo.cli import options
from rsvideo.cli.exit_codes import note, refusing
from rsvideo.cli.options import NOTHING, Given
from rsvideo.cli.terminal import say

if TYPE_CHECKING:
    from rsvideo.config.simulation import Simulation

Source = Annotated[Path | None, typer.Argument(metavar="SHARP", help="A sharp PNG, TIFF, JPEG or raw photograph, larger than the frame.")]
FromClip = Annotated[
    Path | None, Option("--from-clip", metavar="CLIP", help="Instead of a photograph: a clip of short exposures, taken as instants.")
]
Output = Annotated[
    Path,
    Option(
        "-o",
        "--output",
        metavar="OUT",
        help="The blurred frame; motion.csv and case.json go beside it. Of --from-clip: a folder for clip.mp4, truth.mp4 and case.json.",
    ),
]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace what stands under these names.")]


@options.offers(
    *("camera.exposure", "camera.readout", "camera.row_time", "camera.direction", "camera.profile", "camera.focal_px"),
    *("motion", "frame", "film", "grain"),
    of="simulation",
)
def simulate(
    output: Output, source: Source = None, from_clip: FromClip = None, given: Given = NOTHING, overwrite: Overwrite = False
) -> None:
    """Render what a rolling-shutter camera would record of a photograph or of a clip's scene, with its truth.

    Of a photograph: the frame is the middle of SHARP, so much smaller that its borders show real content however the camera moves.
    """
    with refusing():
        simulation = options.simulation(given)
        if (source is None) == (from_clip is None):
            raise ValueError(f"either SHARP, a photograph, or --from-clip must be given, got {'neither' if source is None else 'both'}")
        simulation.check_kind(of_clip=from_clip is not None)
    if source is not None:
        _photograph(source, simulation, output, overwrite=overwrite)
    elif from_clip is not None:
        _film(from_clip, simulation, output, overwrite=overwrite)


def _photograph(source: Path, simulation: "Simulation", output: Path, *, overwrite: bool) -> None:
    from rsvideo.cli.progress import progress_bar
    from rsvideo.pipeline.simulated_photograph import carry_out, prepare

    with refusing():
        plan = prepare(source, simulation, output, overwrite=overwrite)
    with progress_bar() as observe:
        made = carry_out(plan, observe)
    say(f"rendered {made.cols} x {made.rows}, {made.blur:.1f} px of blur: {output}")


def _film(source: Path, simulation: "Simulation", output: Path, *, overwrite: bool) -> None:
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import progress_bar
    from rsvideo.pipeline.simulated_clip import Filming, carry_out, prepare

    with refusing(), quiet.c_libraries():
        plan = prepare(Filming.of(source, simulation), output, overwrite=overwrite)
    note(plan.notes)
    with progress_bar() as observe:
        made = carry_out(plan, observe)
    note(made.notes)
    say(f"filmed {made.frames} frames of {made.cols} x {made.rows}, {made.blur:.1f} px of blur: {output}")
