"""rsvideo simulate: a sharp photograph or clip in, a blurred one out, and its truth."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Option

from rsvideo.cli import simulate_clip
from rsvideo.cli.exit_codes import refusing
from rsvideo.cli.options import DirectionName
from rsvideo.cli.terminal import say

if TYPE_CHECKING:
    import numpy as np

    from rsvideo.physics.camera import Intrinsics
    from rsvideo.physics.noise import Noise
    from rsvideo.physics.shutter import Direction
    from rsvideo.physics.simulate import Rendering
    from rsvideo.physics.staging import Motion, Stage
    from rsvideo.stills.still import Still

MOST_LOG_BYTES = 500_000_000

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
Exposure = Annotated[str, Option(metavar="TIME", help="How long each row collects light: 1/50, 20ms, 0.02.")]
FocalPx = Annotated[float | None, Option(metavar="PX", help="Focal length in pixels of SHARP. [default: the profile's]")]
Camera = Annotated[
    str | None,
    Option(
        metavar="NAME",
        help="A profile by name or file: focal length, distortion, noise and readout are its own. SHARP is taken to show what"
        " its lens shows, and the frame is its whole picture.",
    ),
]
Readout = Annotated[str | None, Option(metavar="TIME", help="Rows times row time; 0 is a global shutter. [default: the profile's]")]
RowTime = Annotated[str | None, Option(metavar="TIME", help="From one row's opening to the next one's, instead of --readout.")]
ReadoutDirection = Annotated[
    DirectionName | None, Option(help="The way the readout runs over the picture as stored. [default: the profile's, or top-to-bottom]")
]
GyroLog = Annotated[Path | None, Option(metavar="LOG", help="Motion recorded as lines `t_ns wx wy wz` in rad/s.")]
Start = Annotated[float, Option(metavar="S", help="When the frame opens, in seconds from the first line of --gyro.")]
GyroAxes = Annotated[
    str, Option(metavar="XYZ", help="The gyro's axes along the camera's right, down and forward; small letters turn them round.")
]
Polynomial = Annotated[
    str | None,
    Option(metavar="TEXT", help="`x:0,12,-4;y:0,5;roll:0,0.01` in px and rad, by powers of u = 0..1 through the frame; or a .yaml."),
]
Shake = Annotated[bool, Option("--shake", help="A random hand-shake, by --seed.")]
Seed = Annotated[int, Option(min=0, help="Of the hand-shake and of the noise.")]
BlurPx = Annotated[float | None, Option(metavar="PX", help="Scale the motion so that the longest streak of any row spans this.")]
Axes = Annotated[Literal["rotation", "shift"], Option(help="All three angles, or no roll.")]
NoiseSigma = Annotated[
    float | None,
    Option(
        metavar="SIGMA",
        help="Read and shot noise at half of white, in linear light; white is 1. [default: the profile's, or 0.003]",
    ),
]
Gain = Annotated[float, Option(help="Multiplies the light, so that highlights clip.")]
Size = Annotated[str | None, Option(metavar="COLSxROWS", help="Of the frame. [default: all that the motion leaves in view]")]
Samples = Annotated[int, Option(min=1, max=4096, help="Time samples a row.")]
Bits = Annotated[Literal["8", "16"] | None, Option(help="A sample of OUT. [default: as in SHARP]")]
Curve = Annotated[Literal["srgb", "bt709", "linear"] | None, Option(help="How codes stand for light. [default: srgb]")]
Truth = Annotated[Path | None, Option(metavar="FILE", help="The sharp frame. [default: truth beside OUT, with OUT's ending]")]
LastExposure = Annotated[
    str | None,
    Option(
        metavar="TIME",
        help="Of --from-clip: the last frame's exposure; from --exposure on it changes evenly, as automatic exposure does."
        " [default: --exposure]",
    ),
]
Speed = Annotated[float | None, Option(metavar="N", help="Of --from-clip: its frames a frame, 1.5 or 3, for faster motion. [default: 1]")]
FrameRate = Annotated[str | None, Option("--rate", metavar="FPS", help="Of --from-clip: frames a second, 30. [default: CLIP's]")]
First = Annotated[int | None, Option(metavar="N", help="Of --from-clip: its first frame that is used. [default: 0]")]
Frames = Annotated[int | None, Option(metavar="N", help="Of --from-clip: how many are made. [default: all, up to a cut]")]
LargestSide = Annotated[
    int | None, Option(metavar="PX", help="Of --from-clip: average a larger picture down to this. [default: CLIP's own]")
]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace what stands under these names.")]


def simulate(
    output: Output,
    exposure: Exposure,
    source: Source = None,
    from_clip: FromClip = None,
    focal_px: FocalPx = None,
    camera: Camera = None,
    readout: Readout = None,
    row_time: RowTime = None,
    direction: ReadoutDirection = None,
    gyro: GyroLog = None,
    start: Start = 0.0,
    gyro_axes: GyroAxes = "XYZ",
    polynomial: Polynomial = None,
    shake: Shake = False,
    seed: Seed = 0,
    blur_px: BlurPx = None,
    motion: Axes = "rotation",
    noise: NoiseSigma = None,
    gain: Gain = 1.0,
    size: Size = None,
    samples: Samples = 64,
    bits: Bits = None,
    transfer: Curve = None,
    truth: Truth = None,
    last_exposure: LastExposure = None,
    speed: Speed = None,
    rate: FrameRate = None,
    first: First = None,
    frames: Frames = None,
    largest_side: LargestSide = None,
    overwrite: Overwrite = False,
) -> None:
    """Render what a rolling-shutter camera would record of a photograph or of a clip's scene, with its truth.

    Of a photograph: the frame is the middle of SHARP, so much smaller that its borders show real content however the camera moves.
    """
    values = locals().copy()
    from rsvideo.physics.tone import Transfer
    from rsvideo.stills import still

    with refusing():
        simulate_clip.check_options(simulate, values)
        if source is None:
            shutter = {"exposure": exposure, "readout": readout, "row_time": row_time, "direction": direction}
            chosen = {"speed": speed, "first": first, "frames": frames, "largest_side": largest_side, "noise": noise, "seed": seed}
            chosen |= {"last_exposure": last_exposure}
            return simulate_clip.film(from_clip, output, shutter, rate, chosen, overwrite=overwrite)
        files, kinds = _files(output, truth, [source, gyro, polynomial, camera], overwrite=overwrite)
        optics = _optics(camera, focal_px, readout, row_time, direction, noise)
        moved, motion_words = _motion(gyro, start, gyro_axes, polynomial, shake, seed)
        photo = still.read(source, Transfer(transfer) if transfer else None)
        staged = _staged(photo, moved, optics, exposure, size, roll=motion == "rotation", blur=blur_px)
        _check_gain(gain)
    rendering = _rendered(photo, staged, optics.noise, gain=gain, samples=samples, seed=seed)
    case = {"source": source.name, "motion": motion_words, "roll": motion == "rotation", "transfer": photo.transfer.value, **optics.words}
    case |= {"gain": gain, "samples": samples, "seed": seed}
    _write(files, kinds, photo, rendering, staged, case, bits)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Optics:
    """The camera that options and profile describe together."""

    focal: float | None  # px; this or a lens
    lens: "Intrinsics | None"  # in the profile's own pixels
    noise: "Noise"
    readout: float | None  # s; this or row_time
    row_time: float | None  # s
    direction: "Direction"
    words: dict[str, object]  # for case.json, beyond the stage


def _optics(
    camera: str | None, focal_px: float | None, readout: str | None, row_time: str | None, direction: str | None, noise: float | None
) -> _Optics:
    """What the options say, and the profile where they do not."""
    from rsvideo.config.quantity import hand_held, seconds
    from rsvideo.physics.noise import Noise
    from rsvideo.physics.shutter import Direction
    from rsvideo.physics.simulate import USUAL_NOISE
    from rsvideo.shooting import profiles

    profile = profiles.find(camera) if camera is not None else None
    facts = profiles.for_clip(profile, profile.mode.rows, profile.mode.cols, None)[0] if profile else None
    lens = facts.intrinsics if facts and focal_px is None else None
    if focal_px is None and lens is None:
        raise ValueError(f"the lens needs --focal-px, {f'{facts.profile} has no intrinsics' if facts else 'or a profile, by --camera'}")
    read = facts.readout.value if facts and facts.readout and readout is None and row_time is None else None
    if read is None and (readout is None) == (row_time is None):
        raise ValueError(f"the shutter needs either --readout or --row-time, got {'neither' if readout is None else 'both'}")
    if readout is not None:
        read = hand_held("readout", seconds("readout", readout), zero=True)
    given = facts.noise if facts and noise is None else None
    sigma = USUAL_NOISE if noise is None else noise
    level = given or Noise.at_half(sigma)
    words: dict[str, object] = {"noise_sigma_linear": sigma}
    if given:
        words = {"noise": {"read": given.read, "shot": given.shot}}
    stated = facts.direction.value if facts and facts.direction else Direction.TOP_TO_BOTTOM
    return _Optics(
        focal=focal_px,
        lens=lens,
        noise=level,
        readout=read,
        row_time=seconds("row-time", row_time) if row_time is not None else None,
        direction=Direction(direction) if direction else stated,
        words=words | ({"camera": camera} if camera else {}),
    )


def _staged(
    photo: "Still", motion: "Motion", optics: _Optics, exposure: str, size: str | None, *, roll: bool, blur: float | None
) -> "Stage":
    from rsvideo.config import quantity
    from rsvideo.config.quantity import hand_held, seconds
    from rsvideo.physics.staging import stage

    cols, rows = quantity.size(size, like="640x400") if size else (0, 0)
    return stage(
        *photo.pixels.shape[:2],
        motion=motion,
        focal=optics.focal,
        lens=optics.lens,
        exposure=hand_held("exposure", seconds("exposure", exposure), zero=False),
        readout=optics.readout,
        row_time=optics.row_time,
        direction=optics.direction,
        frame=(rows, cols) if size else None,
        roll=roll,
        blur=blur,
    )


def _rendered(photo: "Still", staged: "Stage", noise: "Noise", *, gain: float, samples: int, seed: int) -> "Rendering":
    import numpy as np

    from rsvideo.cli.progress import progress_bar
    from rsvideo.physics.simulate import render

    with progress_bar() as observe:
        return render(
            photo.pixels,
            camera=staged.camera,
            timing=staged.timing,
            trajectory=staged.trajectory,
            noise=noise,
            rng=np.random.default_rng([seed, 1]),  # not the hand's numbers
            samples=samples,
            gain=gain,
            observe=observe,
        )


def _write(
    files: list[Path], kinds: tuple, photo: "Still", rendering: "Rendering", staged: "Stage", case: dict[str, object], bits: str | None
) -> None:
    from importlib.metadata import version

    from rsvideo.config.files import write_whole
    from rsvideo.physics.simulate import extent
    from rsvideo.pipeline import simulated_case
    from rsvideo.stills import still

    codes = replace(photo.codes, samples=_blank(photo.codes.samples.dtype, bits), alpha=None, exif=None)  # EXIF is of the sharp one
    photo = replace(photo, codes=codes)
    pictures = [still.encode(photo, light, kind)[0] for light, kind in zip((rendering.blurred, rendering.truth), kinds, strict=True)]
    beside = [simulated_case.motion_csv(staged), simulated_case.case_json(staged, {**case, "rsvideo": version("rsvideo")})]
    write_whole(dict(zip(files, [*pictures, *beside], strict=True)))
    camera = staged.camera
    reach = extent(camera=camera, timing=staged.timing, trajectory=staged.trajectory)
    say(f"rendered {camera.cols} x {camera.rows}, {reach:.1f} px of blur: {files[0]}")


def _files(output: Path, truth: Path | None, read: "list[Path | str | None]", *, overwrite: bool) -> tuple[list[Path], tuple]:
    """What is written, and the formats of the two pictures; ValueError where it may not be."""
    from rsvideo.config.placing import check
    from rsvideo.stills import still

    truth = truth or output.with_name("truth" + output.suffix)
    kinds = still.Format.of_output(output), still.Format.of_output(truth)
    files = [output, truth, output.with_name("motion.csv"), output.with_name("case.json")]
    if len({file.absolute() for file in files}) < len(files):
        raise ValueError(f"OUT, the truth, motion.csv and case.json need four names, got {', '.join(map(str, files))}")
    for file in files:
        if not file.parent.is_dir():
            raise ValueError(f"the folder {file.parent} must exist; make it first, or is its name mistyped?")
        if file.is_dir():
            raise ValueError(f"{file} must be the name of a file, it is a folder")
    check(files, [Path(each) for each in read if each is not None and Path(each).is_file()], overwrite=overwrite)
    return files, kinds


def _check_gain(gain: float) -> None:
    from rsvideo.physics.simulate import MOST_GAIN

    if not 0 < gain <= MOST_GAIN:
        raise ValueError(f"gain must lie in (0, {MOST_GAIN:g}], got {gain:g}")


def _motion(
    gyro: Path | None, start: float, axes: str, polynomial: str | None, shake: bool, seed: int
) -> tuple["Motion", dict[str, object]]:
    """The motion that the options choose, and its words in case.json."""
    from rsvideo.config.files import UnreadableError, lines
    from rsvideo.physics import staging
    from rsvideo.physics.gyro import check_axes, parse

    given = {"--gyro": gyro is not None, "--polynomial": polynomial is not None, "--shake": shake}
    chosen = [name for name, present in given.items() if present]
    if len(chosen) != 1:
        raise ValueError(f"the motion must come from one of {', '.join(given)}, got {' and '.join(chosen) or 'none'}")
    if gyro is not None:
        check_axes(axes)
        try:
            log = parse(lines(gyro, most=MOST_LOG_BYTES), axes=axes)
        except ValueError as error:
            raise error if isinstance(error, UnreadableError) else UnreadableError(f"{gyro}: {error}") from error
        return staging.of_log(log, start=start), {"gyro": gyro.name, "start_s": start, "axes": axes}
    if polynomial is not None:
        terms = _terms(polynomial)
        return staging.polynomial(terms), {"polynomial": terms}
    return staging.hand(seed), {"shake": seed}


def _terms(text: str) -> dict[str, list[float]]:
    """`x:0,12;roll:0,0.1`, or the mapping of that in a YAML file."""
    if text.lower().endswith((".yaml", ".yml")):
        return _yaml_terms(Path(text))
    terms: dict[str, list[float]] = {}
    for part in filter(None, (piece.strip() for piece in text.split(";"))):
        axis, colon, numbers = part.partition(":")
        try:
            terms[axis.strip()] = [float(number) for number in numbers.split(",")]
        except ValueError:
            colon = ""
        if not colon:
            raise ValueError(f"a polynomial must read like x:0,12,-4;y:0,5, got {part[:60]!r}")
    if not terms:
        raise ValueError("a polynomial must read like x:0,12,-4;y:0,5, got nothing")
    return terms


def _yaml_terms(path: Path) -> dict[str, list[float]]:
    from rsvideo.config import yaml
    from rsvideo.config.files import UnreadableError

    form = f"{path} must map x, y and roll to lists of numbers, such as `x: [0, 12, -4]`"
    try:
        found, _ = yaml.load(path)
        if not isinstance(found, dict) or not found:
            raise UnreadableError(f"{form}; it holds {type(found).__name__}")
        return {str(axis): [float(number) for number in numbers] for axis, numbers in found.items()}
    except (TypeError, ValueError) as error:
        if isinstance(error, UnreadableError):
            raise
        raise UnreadableError(form) from error


def _blank(depth: "np.dtype", bits: str | None) -> "np.ndarray":
    """One sample of the depth to write."""
    import numpy as np

    return np.zeros((1, 1, 1), depth if bits is None else f"uint{bits}")
