"""rsvideo calibrate lens: focal length, principal point and distortion from views of a board."""

import enum
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from rsvideo.cli.calibrate_board import BoardName
from rsvideo.cli.calibrate_profile import Add, Maker, Name, Output, Overwrite, earlier, finish, first_name, merged, print_json
from rsvideo.cli.terminal import say
from rsvideo.cli.validate import refusing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from calibration import LensMeasurement
    from calibration.intrinsics.views import Refused
    from rsvideo.shooting.camera_profile import CameraProfile

_FEW = 5  # views that are refused for the same reason are named each


class Model(enum.StrEnum):
    """How lenses bend rays."""

    AUTO = "auto"
    BROWN_CONRADY = "brown-conrady"
    FISHEYE = "fisheye"


def lens(
    sources: Annotated[list[Path], typer.Argument(metavar="VIEWS...", help="Photographs of the board, their folder, or one clip of it.")],
    board: BoardName,
    output: Output = None,
    figure: Annotated[Path | None, Option(metavar="FIG", help="Draw what is left at each corner: .png, .pdf or .svg.")] = None,
    model: Annotated[Model, Option(help="How the lens bends rays; chosen by views that are left out, unless given.")] = Model.AUTO,
    bent: Annotated[bool, Option("--bent", help="Find the board's shape too, for one that is not flat or not printed to scale.")] = False,
    readout: Annotated[str | None, Option(metavar="TIME", help="Of the rolling shutter; views in motion are then told.")] = None,
    name: Name = None,
    maker: Maker = None,
    add: Add = False,
    overwrite: Overwrite = False,
    json: Annotated[bool, Option("--json", help="Print what was done with each view, as JSON.")] = False,
) -> None:
    """Measure focal length, principal point and distortion from views of a board.

    Hold the board still in each view; let the views cover the whole picture, near and far, and tilt it to all sides.
    """
    with refusing():
        import calibration
        from calibration.boards.target import parse
        from calibration.output import file_format
        from rsvideo.cli.progress import progress_bar
        from rsvideo.config.quantity import hand_held, seconds
        from rsvideo.report.plots import FORMATS

        parse(board)
        rolling = None if readout is None else hand_held("readout", seconds("readout", readout), zero=True)
        if figure:
            file_format(figure, FORMATS, overwrite=overwrite, read=sources)
        before = earlier(output, add=add, overwrite=overwrite)
        try:
            with progress_bar() as observe:
                found = calibration.lens(
                    sources,
                    board,
                    model=None if model is Model.AUTO else model.value,
                    find_shape=bent,
                    readout=rolling,
                    observer=observe,
                )
        except calibration.TooFewViewsError as error:
            _say_refused(error.refused)
            raise
        profile = merged(before, found.profile(name=first_name(name, found.camera, output), maker=maker))
        if figure:
            found.draw_residuals(figure, overwrite=overwrite)
    if json:
        _print_json(found, profile)
    _say_refused(found.refused)
    for note in found.notes:
        say(note)
    errors = ", ".join(f"{which} {error:.3f}" for which, error in found.fit.left_out.items())
    say(f"{found.model}: {found.how}" + (f"; of views left out, px: {errors}" if errors else ""))
    finish(profile, output, printed=not json)


def _print_json(found: "LensMeasurement", profile: "CameraProfile") -> None:
    """All that was found, for machines."""
    fit = found.fit
    print_json(
        {
            "model": found.model,
            "rms_px": found.rms_px,
            "left_out_rms_px": fit.left_out,
            "left_out_rms_px_if_bent": fit.left_out_if_bent,
            "board_off_m": fit.displacement,
            "coverage": found.coverage,
            "reach": found.reach,
            "views": [
                {"name": view.name, "corners": len(view.object_points), "weight": view.weight, "edge_px": view.edge_width}
                for view in fit.views
            ],
            "refused": [{"name": one.name, "why": one.reason} for one in found.refused],
            "notes": list(found.notes),
            "profile": profile.model_dump(mode="json", exclude_none=True),
        }
    )


def _say_refused(refused: "Sequence[Refused]") -> None:
    """One line for each that stands out, and one for all that are refused alike."""
    alike: dict[str, list[Refused]] = {}
    for one in refused:
        alike.setdefault(re.split(r"\d|:", one.reason)[0], []).append(one)
    for group in alike.values():
        for one in group if len(group) <= _FEW else group[:1]:
            more = f"; {len(group) - 1} more alike, --json lists them" if len(group) > _FEW else ""
            say(f"not used: {one.name}: {one.reason}{more}")
