"""Profiles of cameras: found by name or file, and made to fit a clip."""

from dataclasses import dataclass, replace
from importlib import resources
from pathlib import Path

from rsvideo.config import yaml
from rsvideo.config.files import read_whole
from rsvideo.config.quantity import same_rate
from rsvideo.config.yaml import ConfigError
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import Direction
from rsvideo.physics.tone import Curve, Tone
from rsvideo.shooting.camera_profile import CameraProfile, Clock, Lens, Measured, Mode
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.formats import gyroflow, kalibr, opencv, ours, ros

FORMS = {"rsvideo": ours, "gyroflow": gyroflow, "kalibr": kalibr, "opencv": opencv, "ros": ros}
_UNTILTED = 12  # coefficients, before the two of a tilted sensor
_SAME_SHAPE = 0.005  # of the ratio of columns to rows, which scaling to whole pixels may change


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What a profile says of a clip, in the clip's own pixels."""

    profile: str  # which one, as a source
    intrinsics: Intrinsics | None  # with the lens's distortion
    readout: Fact[float] | None  # seconds
    direction: Fact[Direction] | None
    tone: Tone | None  # a standard's curve, or the one that was measured
    saturation: float | None  # the code in [0, 1] from which on highlights are lost
    noise: Noise | None


def shipped() -> Path:
    """The folder of the profiles that come with the project, in a wheel and in a checkout."""
    package = Path(str(resources.files("rsvideo")))
    installed = package / "configs" / "cameras"
    return installed if installed.is_dir() else package.parent / "configs" / "cameras"


def names() -> tuple[str, ...]:
    """The profiles that come with the project."""
    return tuple(sorted(path.stem for path in shipped().glob("*.yaml")))


def is_file(name_or_file: str) -> bool:
    """Whether a profile is named by its file, not by its name."""
    path = Path(name_or_file)
    return path.suffix.lower() in (".yaml", ".yml", ".json") or len(path.parts) > 1


def find(name_or_file: str) -> CameraProfile:
    """A profile that comes with the project, by name, or the one in a file, which may be in another program's format."""
    if is_file(name_or_file):
        return read(Path(name_or_file))
    if name_or_file in names():
        return yaml.read(shipped() / f"{name_or_file}.yaml", CameraProfile)
    raise ConfigError(f"there is no camera profile named {yaml.shown(name_or_file)}{yaml.meant(name_or_file, names())}")


def read(path: Path) -> CameraProfile:
    """The profile in a file of ours, of Gyroflow (.json), of OpenCV, of kalibr or of ROS, recognised by its content."""
    if path.suffix.lower() == ".json":
        return gyroflow.read(path)
    text = read_whole(path, most=yaml.MOST_BYTES)
    if opencv.is_storage(text):
        return opencv.read(path)
    data, positions = yaml.load(path)
    for foreign in (kalibr, ros):
        if foreign.holds(data):
            return foreign.parsed(data, positions)
    return yaml.validated(CameraProfile, data, positions)


def encode(profile: CameraProfile, form: str = "rsvideo") -> tuple[bytes, tuple[str, ...]]:
    """The file of a profile in one of FORMS, and what that form could not hold."""
    return FORMS[form].encode(profile)


def for_clip(profile: CameraProfile, rows: int, cols: int, fps: float | None) -> tuple[Facts, tuple[str, ...]]:
    """What a profile says of a clip of this size and rate, and what was assumed; refused where it cannot be meant for it."""
    mode, name = profile.mode, f"the profile of {profile.camera}"
    slip = f"{name} is of {_words(mode.rows, mode.cols, mode.fps)}, the clip is of {_words(rows, cols, fps)}"
    scale = cols / mode.cols
    if abs(rows / mode.rows / scale - 1) > _SAME_SHAPE:
        turned = abs(rows * mode.rows / (cols * mode.cols) - 1) <= _SAME_SHAPE
        raise ConfigError(
            f"{slip}; {'is it stored turned?' if turned else 'another part of the sensor is another mode, with its own profile'}"
        )
    if profile.timing and mode.fps and fps and not same_rate(fps, mode.fps):
        raise ConfigError(f"{slip}; a readout time belongs to one rate, so this mode needs its own profile, or --readout")
    notes = () if scale == 1 else (f"{slip}: taken to show the same part of the sensor, scaled by {scale:.4g}",)
    clock = profile.timing
    return Facts(
        profile=name,
        intrinsics=_scaled(profile.intrinsics, mode, rows, cols) if profile.intrinsics else None,
        readout=_sourced(clock).fact(name) if clock else None,
        direction=Fact(value=clock.direction, source=name) if clock else None,
        tone=response(profile)[0],
        saturation=response(profile)[1],
        noise=Noise(read=profile.noise.read.value, shot=profile.noise.shot.value) if profile.noise else None,
    ), notes


def _sourced(clock: Clock) -> Measured:
    """The readout with the source that it shares with its part."""
    whence = clock.readout_s.source or (clock.found.source if clock.found else None)
    return clock.readout_s.model_copy(update={"source": whence})


def response(profile: CameraProfile) -> tuple[Tone | None, float | None]:
    """How codes stand for light, by a standard's curve or the one that was measured; and the code from which on highlights are lost."""
    if profile.tone is None:
        return None, None
    measured = Curve(light=tuple(profile.tone.curve)) if profile.tone.curve else None
    return profile.tone.transfer or measured, profile.tone.clip.value if profile.tone.clip else None


def _words(rows: int, cols: int, fps: float | None) -> str:
    return f"{cols} x {rows}" + (f" at {fps:.5g} fps" if fps else "")


def _scaled(lens: Lens, mode: Mode, rows: int, cols: int) -> Intrinsics:
    try:
        camera = Intrinsics(fx=lens.fx.value, fy=lens.fy.value, cx=lens.cx.value, cy=lens.cy.value, rows=mode.rows, cols=mode.cols)
        return replace(camera.scaled(rows, cols), distortion=_distortion(lens))
    except ValueError as error:  # a focal length that scaling made too short, a distortion that folds over
        raise ConfigError(f"the profile's lens cannot be scaled to {cols} x {rows}: {error}") from error


def _distortion(lens: Lens) -> Distortion | None:
    """The lens's distortion, in the model's own terms; None where it has none."""
    if lens.distortion is None:
        return None
    model, coefficients = lens.distortion.model, tuple(number.value for number in lens.distortion.coefficients)
    if len(coefficients) > _UNTILTED:
        if any(coefficients[_UNTILTED:]):
            raise ValueError(f"a sensor that is tilted against its lens is not modelled; calibrate with {_UNTILTED} coefficients or fewer")
        coefficients = coefficients[:_UNTILTED]
    straight = model == "brown-conrady" and not any(coefficients)
    return None if straight else Distortion(model=model, coefficients=coefficients)
