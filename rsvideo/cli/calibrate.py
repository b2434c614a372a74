"""rsvideo calibrate: measures a camera with things that people have at home, and writes what it finds into its profile."""

import enum
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer import Option

from rsvideo.cli.calibrate_readout import readout
from rsvideo.cli.validate import refusing

if TYPE_CHECKING:
    from collections.abc import Iterator

    from calibration.views import Refused, Taken, View
    from rsvideo.config.camera import CameraProfile

calibrate = typer.Typer(add_completion=False, rich_markup_mode=None, no_args_is_help=True)
calibrate.command()(readout)

BOARD = "chessboard:9x6:25mm (inner corners, side of a square), charuco:5x7:DICT_6X6_250:30mm:22mm or aprilgrid:6x6:30mm:9mm."

BoardName = Annotated[str, Option("--board", metavar="BOARD", help=BOARD)]
Output = Annotated[Path | None, Option("-o", "--output", metavar="PROFILE", help="Write the profile here (.yaml); else it is printed.")]
Add = Annotated[bool, Option("--add", help="Keep what PROFILE already says of other things.")]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace what exists.")]
Name = Annotated[str | None, Option(metavar="NAME", help="The camera's model; from the pictures unless given.")]
Maker = Annotated[str | None, Option(metavar="MAKER", help="Who made the camera.")]


class Model(enum.StrEnum):
    """How lenses bend rays."""

    AUTO = "auto"
    BROWN_CONRADY = "brown-conrady"
    FISHEYE = "fisheye"


class Paper(enum.StrEnum):
    """Sheets that printers take."""

    A4 = "A4"
    A3 = "A3"
    A2 = "A2"
    A1 = "A1"
    A0 = "A0"
    LETTER = "letter"


class Form(enum.StrEnum):
    """Files that hold a camera."""

    RSVIDEO = "rsvideo"
    GYROFLOW = "gyroflow"
    KALIBR = "kalibr"
    OPENCV = "opencv"
    ROS = "ros"


@calibrate.callback()
def group() -> None:
    """Measure a camera: print a board, film it, and get a profile that --camera takes in every command."""


@calibrate.command()
def board(
    output: Annotated[Path, Option("-o", "--output", metavar="FILE", help="Where to draw it: .pdf, .svg, or .png at 10 px a mm.")],
    name: BoardName = "chessboard:9x6:25mm",
    paper: Annotated[Paper, Option(help="The sheet it is printed on.")] = Paper.A4,
    overwrite: Overwrite = False,
) -> None:
    """Draw a board to print at 100 %, glue to something flat, and film."""
    with refusing():
        from calibration.board import parse
        from calibration.sheet import FORMATS, draw
        from rsvideo.config.files import write_whole

        kind = _may_write(output, FORMATS, overwrite=overwrite)
        write_whole({output: draw(parse(name), name, paper=paper.value, kind=kind)})
    print(
        f"rsvideo: drawn: {output}; print it at 100 % and check the ruler, then: rsvideo calibrate lens VIEWS --board {name}",
        file=sys.stderr,
    )


@calibrate.command()
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
        from rsvideo.config.camera import CameraProfile, Mode
        from rsvideo.config.files import write_whole
        from rsvideo.config.quantity import hand_held, seconds
        from rsvideo.report.plots import FORMATS

        target = parse(board)
        rolling = None if readout is None else hand_held("readout", seconds("readout", readout), zero=True)
        kind = _may_write(figure, FORMATS, overwrite=overwrite) if figure else ""
        before = _before(output, add=add, overwrite=overwrite)
        with quiet.c_libraries():
            taken, files, fps, model_name = _taken(sources, target, rolling)
            fit = fitting.calibrate(taken.views, model=None if model is Model.AUTO else model.value, bent=bent)
        reached = fitting.reach(fit.views, fit.lens.numbers, taken.rows, taken.cols)
        how = f"{len(fit.views)} views of {board}, {fit.rms:.3f} px left"
        how += f", the board's corners found up to {fit.off * 1e3:.2g} mm off their places" if fit.off else ""
        profile = CameraProfile(
            name=_named(name, model_name, output),
            maker=maker,
            mode=Mode(rows=taken.rows, cols=taken.cols, fps=fps),
            intrinsics=parts.lens(fit, parts.found(how, _used(files, fit, taken), _today())),
        )
        if before:
            profile = parts.merged(before, profile)
        notes = [*taken.notes, *_doubts(fit, taken, reached)]
        refused = [*taken.refused, *fit.refused]
        if figure:
            write_whole({figure: residuals.draw(fit, taken, kind)})
    if json:
        _print_json(
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
    for one in refused[:50]:
        _say(f"not used: {one.name}: {one.why}")
    if len(refused) > 50:
        _say(f"not used: {len(refused) - 50} more; --json lists them")
    for note in notes:
        _say(note)
    errors = ", ".join(f"{which} {error:.3f}" for which, error in fit.left_out.items())
    _say(f"{fit.lens.model}: {how}" + (f"; of views left out, px: {errors}" if errors else ""))
    _finish(profile, output, printed=not json)


@calibrate.command()
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
        from calibration import lensfun as database
        from calibration.profile import merged
        from rsvideo.cli.ending import RefusedError
        from rsvideo.config.camera import CameraProfile, Mode

        if not (sides := re.fullmatch(r"(\d{1,6})x(\d{1,6})", size)):
            raise RefusedError(f"--size must be columns x rows such as 1920x1080, got {size[:40]!r}")
        before = _before(output, add=add, overwrite=overwrite)
        cols, rows = int(sides[1]), int(sides[2])
        prior = database.look_up(camera, lens, focal_mm=focal_mm, rows=rows, cols=cols, when=_today())
        profile = CameraProfile(name=prior.camera[:100], maker=prior.maker, mode=Mode(rows=rows, cols=cols), intrinsics=prior.lens)
        if before:
            profile = merged(before, profile)
    for note in prior.notes:
        _say(note)
    _finish(profile, output)


@calibrate.command()
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
        from rsvideo.cli.ending import RefusedError
        from rsvideo.config.camera import CameraProfile, Mode
        from rsvideo.config.quantity import seconds
        from rsvideo.video import still

        before = _before(output, add=add, overwrite=overwrite)
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
        whence = parts.found(f"{len(shots)} exposures of {min(times):.3g} to {max(times):.3g} s", views.named(sources), _today())
        profile = CameraProfile(
            name=_named(name, stills[0].shot.camera, output),
            maker=maker,
            mode=Mode(rows=rows, cols=cols),
            tone=parts.tone(found, whence),
            noise=parts.noise(found, whence),
        )
        if before:
            profile = parts.merged(before, profile)
    for note in found.notes:
        _say(note)
    best = sorted(found.rests.items(), key=lambda one: one[1])[:4]
    _say("what each curve leaves of light: " + ", ".join(f"{curve} {rest:.1%}" for curve, rest in best))
    if found.noise:
        twice = "" if "pairs" in found.noise.how else "; two photographs at each exposure tell it more surely"
        _say(f"noise by {found.noise.how}; it belongs to the ISO that was set{twice}")
    else:
        _say("too few flat patches to measure noise by; a defocused wall has many")
    _finish(profile, output)


@calibrate.command()
def show(
    camera: Annotated[str, typer.Argument(metavar="PROFILE", help="A profile by name or file; lens profiles of other programs too.")],
    output: Annotated[Path, Option("-o", "--output", metavar="FIG", help="Where to draw: .png, .pdf or .svg.")],
    overwrite: Overwrite = False,
) -> None:
    """Draw a profile on one page: lens, timing, tone curve and noise."""
    with refusing():
        from calibration import page
        from rsvideo.config import profile
        from rsvideo.config.files import write_whole
        from rsvideo.report.plots import FORMATS

        kind = _may_write(output, FORMATS, overwrite=overwrite)
        write_whole({output: page.draw(profile.find(camera), kind)})
    _say(f"drawn: {output}")


@calibrate.command()
def convert(
    camera: Annotated[str, typer.Argument(metavar="PROFILE", help="A profile by name or file, in any of the forms.")],
    to: Annotated[Form, Option(help="Whose form to write.")],
    output: Annotated[Path | None, Option("-o", "--output", metavar="FILE", help="Where to write; else it is printed.")] = None,
    overwrite: Overwrite = False,
) -> None:
    """Write a profile as Gyroflow, OpenCV, kalibr or ROS read it, or theirs as ours."""
    with refusing():
        from rsvideo.config import profile
        from rsvideo.config.files import write_whole

        data, notes = profile.encode(profile.find(camera), to.value)
        if output is None:
            sys.stdout.write(data.decode())
        else:
            _may_write(output, (), overwrite=overwrite)
            write_whole({output: data})
    for note in notes:
        _say(note)
    if output:
        _say(f"written: {output}")


@calibrate.command()
def schema() -> None:
    """Print the JSON Schema of a profile, by which editors complete and check it."""
    from rsvideo.config.camera import CameraProfile

    _print_json(CameraProfile.model_json_schema())


def _taken(sources: list[Path], target: Any, rolling: float | None) -> "tuple[Taken, dict[str, Path], float | None, str | None]":
    """The views, the files they are in, and the clip's rate and the camera's name where these are known."""
    from calibration import views
    from rsvideo.cli.ending import RefusedError
    from rsvideo.video import decode, metadata, still

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


def _named(*names: "str | Path | None") -> str:
    """The first name there is."""
    found = next((name for name in names if name), "unnamed")
    return (found.stem if isinstance(found, Path) else found)[:100]


def _used(files: "dict[str, Path]", fit: Any, taken: "Taken") -> "dict[str, Path]":
    """The files that went into the lens."""
    names = {view.name for view in fit.views}
    return {name: path for name, path in files.items() if taken.clip or name in names}


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


def _may_write(path: Path, kinds: tuple[str, ...], *, overwrite: bool) -> str:
    """The kind that a file's ending names, if it may be written."""
    from rsvideo.cli.ending import RefusedError

    kind = path.suffix.lower().removeprefix(".")
    if kinds and kind not in kinds:
        raise RefusedError(f"{path} must end in .{', .'.join(kinds)}, it ends in {path.suffix!r}; the ending names the format")
    if not path.parent.is_dir():
        raise RefusedError(f"the folder {path.parent} must exist; make it first, or is its name mistyped?")
    if path.exists() and not overwrite:
        raise FileExistsError(f"{path} exists already; give --overwrite to replace it")
    return kind


def _before(output: Path | None, *, add: bool, overwrite: bool) -> "CameraProfile | None":
    """The profile that is added to, if there is one."""
    from rsvideo.cli.ending import RefusedError
    from rsvideo.config import profile

    if output is None:
        if add:
            raise RefusedError("--add needs -o PROFILE, the profile that is added to")
        return None
    exists = output.exists() and add
    _may_write(output, ("yaml", "yml"), overwrite=overwrite or exists)
    return profile.read(output) if exists else None


def _finish(profile: "CameraProfile", output: Path | None, *, printed: bool = True) -> None:
    from rsvideo.config.files import write_whole
    from rsvideo.config.profile import encode

    data, _ = encode(profile)
    if output is not None:
        write_whole({output: data})
        _say(f"written: {output}; use it with --camera {output}, see it with rsvideo calibrate show {output} -o FIG.png")
    elif printed:
        sys.stdout.write(data.decode())


def _today() -> str:
    import datetime

    return datetime.datetime.now(tz=datetime.UTC).date().isoformat()


def _print_json(told: dict[str, Any]) -> None:
    import json

    print(json.dumps(told, indent=1, allow_nan=False))


def _say(words: str) -> None:
    print(f"rsvideo: {words}", file=sys.stderr)
