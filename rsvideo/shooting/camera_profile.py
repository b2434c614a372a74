"""What a camera's profile holds: one mode of one camera, every number with how sure it is and where it is from."""

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from rsvideo.config.quantity import FASTEST_RATE, HAND_HELD_LIMIT
from rsvideo.physics import noise
from rsvideo.physics.camera import MOST_FOCAL_PX
from rsvideo.physics.shutter import Direction
from rsvideo.physics.tone import Transfer
from rsvideo.shooting.fact import Fact

COEFFICIENTS = {"brown-conrady": (4, 5, 8, 12, 14), "fisheye": (4,)}  # as OpenCV counts them

Words = Annotated[str, Field(max_length=500)]
Pixels = Annotated[int, Field(ge=1, le=100_000)]
Rate = Annotated[float, Field(gt=0, le=FASTEST_RATE, allow_inf_nan=False)]
FileName = Annotated[str, Field(min_length=1, max_length=300)]
Sha256 = Annotated[str, Field(pattern="^[0-9a-f]{64}$")]
Deviation = Annotated[float, Field(ge=0, le=1e7, allow_inf_nan=False)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Measured(_Part):
    """A number, how sure it is, and how it came to be. In YAML the number alone will do."""

    value: Annotated[float, Field(allow_inf_nan=False, ge=-1e6, le=1e7)]  # of any unit; no camera has more
    std: Deviation | None = None  # standard deviation, in the number's unit
    how: Words | None = None  # the method
    when: Words | None = None  # the day
    source: Words | None = None  # the file, the person or the address

    def fact(self, by: str) -> Fact[float]:
        """The number as a profile states it, with its source if it has one."""
        within = (self.value - 2 * self.std, self.value + 2 * self.std) if self.std is not None else None
        return Fact(value=self.value, source=f"{by} ({self.source})" if self.source else by, within=within)


def _alone(value: object) -> object:
    return {"value": value} if isinstance(value, int | float | str) else value


def _focal(number: Measured) -> Measured:
    if not 1 <= number.value < MOST_FOCAL_PX:
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
    if not 0 <= number.value <= HAND_HELD_LIMIT:
        slip = "is it in milliseconds?" if number.value > HAND_HELD_LIMIT else "a readout upwards is `direction: bottom-to-top`"
        raise ValueError(f"must lie in [0, {HAND_HELD_LIMIT:g}] s, got {number.value:g}; {slip}")
    return number


Number = Annotated[Measured, BeforeValidator(_alone)]
Focal = Annotated[Measured, BeforeValidator(_alone), AfterValidator(_focal)]
Part = Annotated[Measured, BeforeValidator(_alone), AfterValidator(_part)]
NotNegative = Annotated[Measured, BeforeValidator(_alone), AfterValidator(_not_negative)]
Time = Annotated[Measured, BeforeValidator(_alone), AfterValidator(_time)]


class Found(_Part):
    """How the numbers of a part came to be, where they do not say so themselves."""

    how: Words | None = None  # the method
    when: Words | None = None  # the day
    source: Words | None = None  # the files, the person or the address
    files: dict[FileName, Sha256] = {}  # what was measured on, each with its hash


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
        counts = COEFFICIENTS[self.model]
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
    rms_px: NotNegative | None = None  # of the distances between the corners that were found and those that the lens predicts
    found: Found | None = None


class Clock(_Part):
    """When rows are read."""

    readout_s: Time  # seconds from the opening of the first row to that of the one that would follow the last; 0 is a global shutter
    direction: Direction = Direction.TOP_TO_BOTTOM  # over the picture as stored
    found: Found | None = None


def _rising(curve: list[float]) -> list[float]:
    if any(after < before for before, after in pairwise(curve)) or not 0 <= curve[0] < curve[-1] == 1:
        raise ValueError("must rise from 0 or more to 1, the light of the highest code")
    return curve


Curve = Annotated[list[Annotated[float, Field(allow_inf_nan=False)]], Field(min_length=2, max_length=1025), AfterValidator(_rising)]


class Tone(_Part):
    """How codes stand for light."""

    transfer: Transfer | None = None
    curve: Curve | None = None  # light at codes evenly spaced from 0 to 1, where no standard's curve fits
    curve_std: Deviation | None = None  # of the logarithm of light, by either curve
    black: NotNegative | None = None  # the code, as part of the full scale, of no light
    clip: Part | None = None  # the code, as part of the full scale, from which on highlights are lost
    found: Found | None = None


class Noise(_Part):
    """The variance of a pixel at light L in [0, 1]: read^2 + shot * L."""

    read: NotNegative
    shot: NotNegative
    found: Found | None = None

    @model_validator(mode="after")
    def _check(self) -> "Noise":
        noise.Noise(read=self.read.value, shot=self.shot.value)  # which says what a noise cannot be
        return self


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
