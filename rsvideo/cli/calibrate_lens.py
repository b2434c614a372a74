"""rsvideo calibrate lens: focal length, principal point and distortion from views of a board."""

import enum
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from rsvideo.cli.calibrate_board import BoardName
from rsvideo.cli.calibrate_profile import Add, Maker, Name, Output, Overwrite, earlier, finish, may_write, named, print_json, say, today
from rsvideo.cli.validate import refusing

if TYPE_CHECKING:
    from collections.abc import Iterator, Sequence

    from calibration.views import Refused, Taken, View

_FEW = 5  # views that are not used for the same reason are told each


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
        from calibration import lens as fitting
        from calibration import profile as parts
        from calibration import residuals, views
        from calibration.board import parse
        from rsvideo.cli import quiet
        from rsvideo.config.files import write_whole
        from rsvideo.config.quantity import hand_held, seconds
        from rsvideo.report.plots import FORMATS
        from rsvideo.shooting.camera_profile import CameraProfile, Mode

        target = parse(board)
        rolling = None if readout is None else hand_held("readout", seconds("readout", readout), zero=True)
        kind = may_write(figure, FORMATS, overwrite=overwrite) if figure else ""
        before = earlier(output, add=add, overwrite=overwrite)
        with quiet.c_libraries():
            taken, files, fps, model_name = _taken(sources, target, rolling)
        if len(taken.views) < fitting.FEWEST:
            _say_refused(taken.refused)
        with quiet.c_libraries():
            fit = fitting.calibrate(taken.views, model=None if model is Model.AUTO else model.value, bent=bent)
        reached = fitting.reach(fit.views, fit.lens.numbers, taken.rows, taken.cols)
        how = f"{len(fit.views)} views of {board}, {fit.rms:.3f} px left"
        how += f", the board's corners found up to {fit.off * 1e3:.2g} mm off their places" if fit.off else ""
        profile = CameraProfile(
            name=named(name, model_name, output),
            maker=maker,
            mode=Mode(rows=taken.rows, cols=taken.cols, fps=fps),
            intrinsics=parts.lens(fit, parts.found(how, _used(files, fit, taken), today())),
        )
        if before:
            profile = parts.merged(before, profile)
        notes = [*taken.notes, *_doubts(fit, taken, reached)]
        refused = [*taken.refused, *fit.refused]
        if figure:
            write_whole({figure: residuals.draw(fit, taken, kind)})
    if json:
        print_json(
            {
                "model": fit.lens.model,
                "rms_px": fit.rms,
                "left_out_rms_px": fit.left_out,
                "left_out_rms_px_if_bent": fit.bent,
                "board_off_m": fit.off,
                "coverage": views.coverage(fit.views, taken.rows, taken.cols),
                "reach": reached,
                "views": [{"name": view.name, "corners": len(view.at), "weight": view.weight, "edge_px": view.edge} for view in fit.views],
                "refused": [{"name": one.name, "why": one.why} for one in refused],
                "notes": notes,
                "profile": profile.model_dump(mode="json", exclude_none=True),
            }
        )
    _say_refused(refused)
    for note in notes:
        say(note)
    errors = ", ".join(f"{which} {error:.3f}" for which, error in fit.left_out.items())
    say(f"{fit.lens.model}: {how}" + (f"; of views left out, px: {errors}" if errors else ""))
    finish(profile, output, printed=not json)


def _taken(sources: list[Path], target: Any, rolling: float | None) -> "tuple[Taken, dict[str, Path], float | None, str | None]":
    """The views, the files they are in, and the clip's rate and the camera's name where these are known."""
    from calibration import views
    from rsvideo.cli.exit_codes import RefusedError
    from rsvideo.stills import still
    from rsvideo.video import decode, metadata

    clips = [path for path in sources if views.is_clip(path)]
    if clips and len(sources) > 1:
        raise RefusedError(f"views must be photographs or one clip, got {len(sources)} files with {clips[0].name} among them")
    if clips:
        stream = decode.probe(clips[0])
        found = _watched(views.of_clip(stream, target), min(stream.frames, views.MOST_LOOKED_AT))
        taken = views.chosen(found, clip=True, readout=rolling)
        return taken, views.named(clips), round(float(stream.rate), 3), metadata.shot(stream).camera
    files = list(views.photographs(sources))
    if not files:
        raise RefusedError(f"{sources[0]} holds no photograph; is it the right folder?")
    taken = views.chosen(_watched(views.of_photographs(files, target), len(files)), clip=False, readout=rolling)
    by_name = views.named(files)
    return taken, by_name, None, still.read(by_name[taken.views[0].name]).shot.camera


def _watched(found: "Iterator[View | Refused]", count: int) -> "list[View | Refused]":
    """All of them, with a bar while they come."""
    from rsvideo.cli.progress import bar

    seen: list[Any] = []
    with bar() as tell:
        for one in found:
            seen.append(one)
            tell("looking for the board", min(1.0, len(seen) / count))
    return seen


def _used(files: "dict[str, Path]", fit: Any, taken: "Taken") -> "dict[str, Path]":
    """The files that went into the lens."""
    names = {view.name for view in fit.views}
    return {name: path for name, path in files.items() if taken.clip or name in names}


def _say_refused(refused: "Sequence[Refused]") -> None:
    """One line for each that stands out, and one for all that are refused alike."""
    alike: dict[str, list[Refused]] = {}
    for one in refused:
        alike.setdefault(re.split(r"\d|:", one.why)[0], []).append(one)
    for group in alike.values():
        told = group if len(group) <= _FEW else group[:1]
        for one in told:
            more = f"; {len(group) - 1} more alike, --json lists them" if len(group) > _FEW else ""
            say(f"not used: {one.name}: {one.why}{more}")


def _doubts(fit: Any, taken: "Taken", reached: float) -> list[str]:
    """What a person should know before they trust the lens."""
    from calibration import lens as fitting
    from calibration import views

    doubts = []
    if len(fit.views) < fitting.ENOUGH:
        doubts.append(f"{len(fit.views)} views are few, {fitting.ENOUGH} or more tell more; the stated deviations may be too small")
    if (covered := views.coverage(fit.views, taken.rows, taken.cols)) < 0.5:
        doubts.append(f"the board was seen in {covered:.0%} of the picture only; bring it into the corners too")
    if reached < 0.8:
        doubts.append(f"no corner lies farther out than {reached:.0%} of the way; beyond, the distortion is a guess")
    if fit.bent and not fit.off and fit.bent < fitting.BENT * (error := min(fit.left_out.values())):
        doubts.append(
            f"the board is not what --board says: if it may be bent, {fit.bent:.3f} instead of {error:.3f} px are left in views left out;"
            " --bent finds its shape, a flat and exact one is better; the stated deviations allow for it"
        )
    if fit.lens.std[0] > 0.01 * fit.lens.numbers[0]:
        doubts.append(f"the focal length is known to {fit.lens.std[0] / fit.lens.numbers[0]:.1%} only; tilt the board more")
    return doubts
