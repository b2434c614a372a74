"""Profiles of cameras: what is known of one mode of one camera, who measured it, and how surely."""

from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from rsvideo.config import yaml
from rsvideo.config.said import Said
from rsvideo.config.yaml import ConfigError
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import Direction
from rsvideo.physics.tone import Transfer

_SAME_RATE = 0.002  # 30 and 29.97 are one mode
_SAME_SHAPE = 0.005  # of the ratio of columns to rows, which scaling to whole pixels may change
_COEFFICIENTS = {"brown-conrady": (4, 5, 8, 12, 14), "fisheye": (4,)}  # as OpenCV counts them

Words = Annotated[str, Field(max_length=500)]
Pixels = Annotated[int, Field(ge=1, le=100_000)]
Rate = Annotated[float, Field(gt=0, le=100_000, allow_inf_nan=False)]
Deviation = Annotated[float, Field(ge=0, allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Measured(_Part):
    """A number, and what is known of how it came to be. In YAML the number alone will do."""

    value: Annotated[float, Field(allow_inf_nan=False)]
    std: Deviation | None = None  # standard deviation, in the number's unit
    how: Words | None = None  # the method
    when: Words | None = None  # the day
    source: Words | None = None  # the file, the person or the address

    def said(self, by: str) -> Said[float]:
        """The number as said by a profile, with its source if it has one."""
        within = (self.value - 2 * self.std, self.value + 2 * self.std) if self.std is not None else None
        return Said(value=self.value, source=f"{by} ({self.source})" if self.source else by, within=within)


def _alone(value: object) -> object:
    return {"value": value} if isinstance(value, int | float | str) else value


def _focal(number: Measured) -> Measured:
    if not 1 <= number.value < 1e7:
        raise ValueError(f"must lie in [1, 1e7) px, got {number.value:g}; is it in millimetres?")
    return number


def _part(number: Measured) -> Measured:
    if not 0 < number.value <= 1:
        raise ValueError(f"must lie in (0, 1], got {number.value:g}; is it a code? divide it by the highest one")
    return number


def _not_negative(number: Measured) -> Measured:
    if number.value < 0:
        raise ValueError(f"must not be negative, got {number.value:g}")
    return number


def _time(number: Measured) -> Measured:
    if not 0 <= number.value <= 1:
        slip = "is it in milliseconds?" if number.value > 1 else "a readout upwards is `direction: bottom-to-top`"
        raise ValueError(f"must lie in [0, 1] s, got {number.value:g}; {slip}")
    return number


Number = Annotated[Measured, BeforeValidator(_alone)]
Focal = Annotated[Measured, BeforeValidator(_alone), AfterValidator(_focal)]
Part = Annotated[Measured, BeforeValidator(_alone), AfterValidator(_part)]
NotNegative = Annotated[Measured, BeforeValidator(_alone), AfterValidator(_not_negative)]
Time = Annotated[Measured, BeforeValidator(_alone), AfterValidator(_time)]


class Mode(_Part):
    """The mode that everything else holds for; another size, rate or crop is another mode."""

    rows: Pixels  # as stored
    cols: Pixels
    fps: Rate | None = None  # None: photographs, or what does not depend on the rate
    crop: Words | None = None  # the part of the sensor that is read, in words


class Distortion(_Part):
    """How the lens bends rays, in OpenCV's models and order of coefficients."""

    model: Literal["brown-conrady", "fisheye"]
    coefficients: list[Number]

    @model_validator(mode="after")
    def _check(self) -> "Distortion":
        counts = _COEFFICIENTS[self.model]
        if len(self.coefficients) not in counts:
            raise ValueError(f"{self.model} has {' or '.join(map(str, counts))} coefficients, got {len(self.coefficients)}")
        return self


class Lens(_Part):
    """The pinhole camera in pixels of the mode; the centre of the top-left pixel is (0, 0)."""

    fx: Focal
    fy: Focal
    cx: Number
    cy: Number
    distortion: Distortion | None = None


class Clock(_Part):
    """When rows are read."""

    readout_s: Time  # seconds from the opening of the first row to that of the one that would follow the last; 0 is a global shutter
    direction: Direction = Direction.TOP_TO_BOTTOM  # over the picture as stored


class Tone(_Part):
    """How codes stand for light."""

    transfer: Transfer | None = None
    clip: Part | None = None  # the code, as part of the full scale, from which on highlights are lost


class Noise(_Part):
    """The variance of a pixel at light L in [0, 1]: read^2 + shot * L."""

    read: NotNegative
    shot: NotNegative


class CameraProfile(_Part):
    """The whole file."""

    version: Literal[1] = 1
    name: Annotated[str, Field(min_length=1, max_length=100)]  # of the camera's model
    maker: Words | None = None
    source: Words | None = None  # of all that says nothing else
    licence: Words | None = None
    mode: Mode
    intrinsics: Lens | None = None
    timing: Clock | None = None
    tone: Tone | None = None
    noise: Noise | None = None

    @property
    def camera(self) -> str:
        """Maker and model."""
        return f"{self.maker} {self.name}" if self.maker else self.name


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What a profile says of a clip, in the clip's own pixels."""

    profile: str  # which one, as a source
    intrinsics: Intrinsics | None
    distortion: Distortion | None
    readout: Said[float] | None  # seconds
    direction: Said[Direction] | None
    transfer: Transfer | None
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
    """Whether a profile is asked for by its file, not by its name."""
    path = Path(name_or_file)
    return path.suffix.lower() in (".yaml", ".yml") or len(path.parts) > 1


def find(name_or_file: str) -> CameraProfile:
    """A profile that comes with the project, by name, or the one in a file."""
    if is_file(name_or_file):
        return yaml.read(Path(name_or_file), CameraProfile)
    if name_or_file in names():
        return yaml.read(shipped() / f"{name_or_file}.yaml", CameraProfile)
    raise ConfigError(f"there is no camera profile named {yaml.shown(name_or_file)}{yaml.meant(name_or_file, names())}")


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
    if profile.timing and mode.fps and fps and abs(fps / mode.fps - 1) > _SAME_RATE:
        raise ConfigError(f"{slip}; a readout time belongs to one rate, so this mode needs its own profile, or --readout")
    notes = () if scale == 1 else (f"{slip}: taken to show the same part of the sensor, scaled by {scale:.4g}",)
    lens, clock = profile.intrinsics, profile.timing
    return Facts(
        profile=name,
        intrinsics=_scaled(lens, rows, cols, rows / mode.rows, scale) if lens else None,
        distortion=lens.distortion if lens else None,
        readout=clock.readout_s.said(name) if clock else None,
        direction=Said(value=clock.direction, source=name) if clock else None,
        transfer=profile.tone.transfer if profile.tone else None,
        noise=profile.noise,
    ), notes


def _words(rows: int, cols: int, fps: float | None) -> str:
    return f"{cols} x {rows}" + (f" at {fps:.5g} fps" if fps else "")


def _scaled(lens: Lens, rows: int, cols: int, down: float, across: float) -> Intrinsics:
    try:
        return Intrinsics(
            fx=lens.fx.value * across,
            fy=lens.fy.value * down,
            cx=(lens.cx.value + 0.5) * across - 0.5,  # the picture's edge stays where it is
            cy=(lens.cy.value + 0.5) * down - 0.5,
            rows=rows,
            cols=cols,
        )
    except ValueError as error:  # a focal length that scaling made too short
        raise ConfigError(f"the profile's lens cannot be scaled to {cols} x {rows}: {error}") from error
