"""Profiles made of the plain numbers that other programs keep, and what of a profile their files cannot hold."""

from collections.abc import Sequence
from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from rsvideo.config.yaml import ConfigError, Positions, validated
from rsvideo.physics.shutter import Direction
from rsvideo.shooting.camera_profile import COEFFICIENTS, CameraProfile, Lens

Finite = Annotated[float, Field(allow_inf_nan=False)]
Row3 = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Matrix = Annotated[list[Row3], Field(min_length=3, max_length=3)]
Coefficients = Annotated[tuple[Finite, ...], Field(max_length=14)]
Text = Annotated[str, Field(max_length=500)]


class Foreign(BaseModel):
    """A file of another program, of which only what is understood is read."""

    model_config = ConfigDict(extra="ignore", frozen=True)


def made(
    positions: Positions,
    *,
    rows: int,
    cols: int,
    matrix: Sequence[Sequence[float]] | None,
    model: str | None,
    coefficients: Sequence[float] = (),
    readout: float | None = None,
    direction: Direction = Direction.TOP_TO_BOTTOM,
    rms_px: float | None = None,
    how: str,
    when: str | None = None,
    name: str = "",
    maker: str | None = None,
    fps: float | None = None,
) -> CameraProfile:
    """The profile of these numbers; `model` None is a lens without a stated distortion."""
    found = {"how": how, "when": when, "source": positions.path.name}
    lens = None
    if matrix is not None:
        (fx, skew, cx), (lower, fy, cy), last = matrix
        if (skew, lower, *last) != (0, 0, 0, 0, 1):
            raise ConfigError(f"{positions.path}: the camera matrix must be [fx 0 cx; 0 fy cy; 0 0 1], got {list(map(list, matrix))}")
        lens = {"fx": fx, "fy": fy, "cx": cx, "cy": cy, "rms_px": rms_px, "found": found}
        if model:
            lens["distortion"] = {"model": model, "coefficients": _counted(model, coefficients)}
    data = {
        "name": (name.strip() or positions.path.stem)[:100],
        "maker": maker or None,
        "mode": {"rows": rows, "cols": cols, "fps": fps or None},
        "intrinsics": lens,
        "timing": None if readout is None else {"readout_s": readout, "direction": direction, "found": found},
    }
    return validated(CameraProfile, data, positions)


def _counted(model: str, coefficients: Sequence[float]) -> list[float]:
    """The coefficients, with zeros up to the next number that the model can have."""
    room = next((count for count in COEFFICIENTS.get(model, ()) if count >= len(coefficients)), len(coefficients))
    return [*coefficients, *[0.0] * (room - len(coefficients))]


def lens_of(profile: CameraProfile, form: str) -> Lens:
    """The lens, without which no such file can be."""
    if profile.intrinsics is None:
        raise ConfigError(f"{form} holds a lens, the profile of {profile.camera} has none; rsvideo calibrate lens measures it")
    return profile.intrinsics


def matrix_of(lens: Lens) -> list[list[float]]:
    """The camera matrix."""
    return [[lens.fx.value, 0.0, lens.cx.value], [0.0, lens.fy.value, lens.cy.value], [0.0, 0.0, 1.0]]


def coefficients_of(lens: Lens) -> list[float]:
    """The distortion's coefficients alone."""
    return [number.value for number in lens.distortion.coefficients] if lens.distortion else []


def shortened(coefficients: list[float], most: int, form: str) -> list[float]:
    """The first `most` coefficients, if all others are 0."""
    if any(coefficients[most:]):
        raise ConfigError(f"{form} holds {most} coefficients of distortion, the profile has {len(coefficients)}; calibrate with fewer")
    return coefficients[:most]


def left_out(profile: CameraProfile, form: str, *held: str) -> tuple[str, ...]:
    """The parts of a profile that are not `held` by a file of this form, as notes."""
    parts = [part for part in ("intrinsics", "timing", "tone", "noise") if getattr(profile, part) is not None and part not in held]
    return (f"{form} holds no {', '.join([*parts, 'standard deviations'])}; only our own profile does",)
