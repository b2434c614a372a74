"""A case from a photograph: a sharp one taken anew by a moving rolling-shutter camera, with its truth and its motion."""

from dataclasses import dataclass, replace
from importlib.metadata import version
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from rsvideo.config import placing, request, yaml
from rsvideo.config.files import UnreadableError, lines, write_whole
from rsvideo.config.simulation import Frame, Motion, Simulation
from rsvideo.physics import staging
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.gyro import check_axes, parse
from rsvideo.physics.noise import USUAL_NOISE, Noise
from rsvideo.physics.shutter import Direction
from rsvideo.physics.simulate import MOST_GAIN, Rendering, render
from rsvideo.physics.staging import Stage
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline import simulated_case
from rsvideo.progress import Observer, ignore
from rsvideo.shooting import profiles
from rsvideo.stills import still
from rsvideo.stills.still import Format, Still

_MOST_LOG_BYTES = 500_000_000


@dataclass(frozen=True, kw_only=True, eq=False)
class Optics:
    """The shutter and the lens that a request and its profile describe together."""

    exposure: float  # s
    readout: float | None  # s; this or row_time
    row_time: float | None  # s
    direction: Direction
    focal: float | None  # px; this or lens
    lens: Intrinsics | None  # in the profile's own pixels
    noise: Noise
    sigma: float | None  # its standard deviation at half of white, of which it was made; None where it is the profile's

    def stage(
        self, scene: tuple[int, int], motion: staging.Motion, *, frame: tuple[int, int] | None, roll: bool = True, blur: float | None
    ) -> Stage:
        """The frame in the middle of a scene of so many rows and columns; see `staging.stage`."""
        return staging.stage(
            *scene,
            motion=motion,
            focal=self.focal,
            lens=self.lens,
            exposure=self.exposure,
            readout=self.readout,
            row_time=self.row_time,
            direction=self.direction,
            frame=frame,
            roll=roll,
            blur=blur,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class Plan:
    """A rendering with all questions answered."""

    files: tuple[Path, Path, Path, Path]  # the frame, its truth, its motion, its case
    kinds: tuple[Format, Format]  # of the two pictures
    photo: Still
    optics: Optics
    stage: Stage
    simulation: Simulation
    words: dict[str, object]  # for case.json, beyond the stage


@dataclass(frozen=True, kw_only=True)
class Simulated:
    """What was made."""

    rows: int
    cols: int
    blur: float  # px from end to end of the longest streak of any row


def prepare(source: Path, simulation: Simulation, output: Path, *, overwrite: bool = False) -> Plan:
    """Answer every question before the work.

    Raises UnreadableError for a file that is not what it should be, ValueError for a simulation that cannot be meant or that the photograph
    is too small for, FileExistsError where files stand under the names that are written.
    """
    frame, motion = simulation.frame, simulation.motion
    files, kinds = _files(source, simulation, output, overwrite=overwrite)
    chosen = optics(simulation.camera, simulation.grain.noise)
    moved, motion_words = _moved(motion, simulation.grain.seed)
    photo = still.read(source, Transfer(frame.transfer) if frame.transfer else None)
    check_gain(frame.gain)
    roll = motion.model == "rotation"
    size = frame.size and (frame.size[1], frame.size[0])
    stage = chosen.stage(photo.pixels.shape[:2], moved, frame=size, roll=roll, blur=motion.blur_px)
    words = {"source": source.name, "motion": motion_words, "roll": roll, "transfer": photo.transfer.value}
    noise = chosen.noise
    words |= {"noise": {"read": noise.read, "shot": noise.shot}} if chosen.sigma is None else {"noise_sigma_linear": chosen.sigma}
    words |= {"camera": simulation.camera.profile} if simulation.camera.profile else {}
    return Plan(files=files, kinds=kinds, photo=photo, optics=chosen, stage=stage, simulation=simulation, words=words)


def carry_out(plan: Plan, observe: Observer = ignore) -> Simulated:
    """Render, and write the four files; they appear whole or not at all."""
    simulation, stage = plan.simulation, plan.stage
    frame, seed = simulation.frame, simulation.grain.seed
    rendering = rendered(plan.photo.pixels, stage, plan.optics.noise, seed=seed, samples=frame.samples, gain=frame.gain, observe=observe)
    words = {**plan.words, "gain": frame.gain, "samples": frame.samples, "seed": seed, "rsvideo": version("rsvideo")}
    beside = [simulated_case.motion_csv(stage), simulated_case.case_json(stage, words)]
    write_whole(dict(zip(plan.files, [*_pictures(plan, rendering), *beside], strict=True)))
    return Simulated(rows=stage.camera.intrinsics.rows, cols=stage.camera.intrinsics.cols, blur=stage.blur)


def rendered(
    light: Float32[np.ndarray, "rows cols channels"],
    stage: Stage,
    noise: Noise,
    *,
    seed: int,
    samples: int,
    gain: float,
    observe: Observer = ignore,
) -> Rendering:
    """What the camera records of a scene, and its truth; see `simulate.render`."""
    return render(
        light,
        camera=stage.camera,
        trajectory=stage.trajectory,
        noise=noise,
        rng=np.random.default_rng([seed, 1]),  # not the hand's numbers
        samples=samples,
        gain=gain,
        observe=observe,
    )


def optics(camera: request.Camera, noise: float | None) -> Optics:
    """What a request states, and its profile where it does not; `noise` is the standard deviation at half of white. ValueError where
    something is missing."""
    facts = None
    if camera.profile is not None:
        profile = profiles.find(camera.profile)
        facts = profiles.for_clip(profile, profile.mode.rows, profile.mode.cols, None)[0]
    if camera.exposure is None:
        raise ValueError("exposure must be given to simulate, such as 1/50")
    readout, row_time = camera.readout, camera.row_time
    if readout is None and row_time is None:
        if not (facts and facts.readout):
            raise ValueError("readout must be given to simulate, such as 20ms; 0 is a global shutter")
        readout = facts.readout.value
    elif readout is not None and row_time is not None:
        raise ValueError("the shutter needs either --readout or --row-time, got both")
    lens = facts.intrinsics if facts and camera.focal_px is None else None
    if camera.focal_px is None and lens is None:
        lacking = f"{facts.profile} has no intrinsics" if facts else "or a profile that holds the lens"
        raise ValueError(f"focal-px must be given to simulate, {lacking}")
    by_profile = facts.noise if facts and noise is None else None
    sigma = USUAL_NOISE if noise is None else noise
    stated = facts.direction.value if facts and facts.direction else Direction.TOP_TO_BOTTOM
    return Optics(
        exposure=camera.exposure,
        readout=readout,
        row_time=row_time,
        direction=camera.direction or stated,
        focal=camera.focal_px,
        lens=lens,
        noise=by_profile or Noise.at_half(sigma),
        sigma=None if by_profile else sigma,
    )


def check_gain(gain: float) -> None:
    """Refuse one that makes nothing or everything white."""
    if not 0 < gain <= MOST_GAIN:
        raise ValueError(f"gain must lie in (0, {MOST_GAIN:g}], got {gain:g}")


def _files(
    source: Path, simulation: Simulation, output: Path, *, overwrite: bool
) -> tuple[tuple[Path, Path, Path, Path], tuple[Format, Format]]:
    """What is written, and the formats of the two pictures; ValueError where it may not be."""
    truth = simulation.frame.truth or output.with_name("truth" + output.suffix)
    kinds = Format.of_output(output), Format.of_output(truth)
    files = (output, truth, output.with_name("motion.csv"), output.with_name("case.json"))
    if len({file.absolute() for file in files}) < len(files):
        raise ValueError(f"OUT, the truth, motion.csv and case.json need four names, got {', '.join(map(str, files))}")
    for file in files:
        if not file.parent.is_dir():
            raise ValueError(f"the folder {file.parent} must exist; make it first, or is its name mistyped?")
        if file.is_dir():
            raise ValueError(f"{file} must be the name of a file, it is a folder")
    named = (simulation.motion.gyro, simulation.motion.polynomial, simulation.camera.profile)
    read = [source, *(Path(each) for each in named if each is not None)]
    placing.check(files, [each for each in read if each.is_file()], overwrite=overwrite)
    return files, kinds


def _moved(motion: Motion, seed: int) -> tuple[staging.Motion, dict[str, object]]:
    """The motion that is chosen, and its words in case.json."""
    given = {"--gyro": motion.gyro is not None, "--polynomial": motion.polynomial is not None, "--shake": motion.shake}
    chosen = [name for name, present in given.items() if present]
    if len(chosen) != 1:
        raise ValueError(f"the motion must come from one of {', '.join(given)}, got {' and '.join(chosen) or 'none'}")
    if motion.gyro is not None:
        check_axes(motion.gyro_axes)
        try:
            log = parse(lines(motion.gyro, most=_MOST_LOG_BYTES), axes=motion.gyro_axes)
        except ValueError as error:
            raise error if isinstance(error, UnreadableError) else UnreadableError(f"{motion.gyro}: {error}") from error
        return staging.of_log(log, start=motion.start), {"gyro": motion.gyro.name, "start_s": motion.start, "axes": motion.gyro_axes}
    if motion.polynomial is not None:
        terms = _terms(motion.polynomial)
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


def _pictures(plan: Plan, rendering: Rendering) -> list[bytes]:
    """The frame and its truth as files."""
    codes = plan.photo.codes
    codes = replace(codes, samples=_blank(codes.samples.dtype, plan.simulation.frame), alpha=None, exif=None)  # EXIF is of the sharp one
    photo = replace(plan.photo, codes=codes)
    lights = (rendering.blurred, rendering.truth)
    return [still.encode(photo, light, kind)[0] for light, kind in zip(lights, plan.kinds, strict=True)]


def _blank(depth: np.dtype, frame: Frame) -> np.ndarray:
    """One sample of the depth to write."""
    return np.zeros((1, 1, 1), depth if frame.bits is None else f"uint{frame.bits}")
