"""kalibr's camera chains (YAML) of one camera: intrinsics, distortion, and line_delay, the seconds from one row to the next."""

from typing import Annotated, Any, Literal

from pydantic import Field

from rsvideo.config.yaml import ConfigError, Positions, validated
from rsvideo.physics.shutter import Direction
from rsvideo.shooting.camera_profile import CameraProfile, Pixels
from rsvideo.shooting.formats.plain import Finite, Foreign, coefficients_of, left_out, lens_of, made, shortened

FORM = "a camera chain of kalibr"
_MODELS = {"radtan": "brown-conrady", "equidistant": "fisheye", "none": None}
_COEFFICIENTS = 4


class _Camera(Foreign):
    camera_model: Literal["pinhole"]
    intrinsics: Annotated[list[Finite], Field(min_length=4, max_length=4)]  # fu, fv, pu, pv
    distortion_model: Literal["radtan", "equidistant", "none"]
    distortion_coeffs: Annotated[tuple[Finite, ...], Field(max_length=_COEFFICIENTS)] = ()
    resolution: Annotated[list[Pixels], Field(min_length=2, max_length=2)]  # columns, rows
    line_delay: Finite | None = None  # seconds; negative where rows are read from the bottom up


class _Chain(Foreign):
    cam0: _Camera


def holds(data: object) -> bool:
    """Whether a YAML document is one."""
    return isinstance(data, dict) and "cam0" in data


def parsed(data: Any, positions: Positions) -> CameraProfile:
    """The profile in a document."""
    if "cam1" in data:
        raise ConfigError(f"{positions.where(('cam1',))}: cam1: must be the chain of one camera; take out all but the one that filmed")
    camera = validated(_Chain, data, positions).cam0
    fx, fy, cx, cy = camera.intrinsics
    cols, rows = camera.resolution
    delay = camera.line_delay
    return made(
        positions,
        rows=rows,
        cols=cols,
        matrix=[[fx, 0, cx], [0, fy, cy], [0, 0, 1]],
        model=_MODELS[camera.distortion_model],
        coefficients=camera.distortion_coeffs,
        readout=None if delay is None else abs(delay) * rows,
        direction=Direction.BOTTOM_TO_TOP if delay is not None and delay < 0 else Direction.TOP_TO_BOTTOM,
        how=FORM,
    )


def encode(profile: CameraProfile) -> tuple[bytes, tuple[str, ...]]:
    """The file, and what it could not hold."""
    lens, clock, mode = lens_of(profile, FORM), profile.timing, profile.mode
    model = next(spelt for spelt, ours in _MODELS.items() if ours == (lens.distortion.model if lens.distortion else None))
    lines = [
        "cam0:",
        "  camera_model: pinhole",
        f"  intrinsics: [{lens.fx.value!r}, {lens.fy.value!r}, {lens.cx.value!r}, {lens.cy.value!r}]",
        f"  distortion_model: {model}",
        f"  distortion_coeffs: {shortened(coefficients_of(lens), _COEFFICIENTS, FORM)}",
        f"  resolution: [{mode.cols}, {mode.rows}]",
    ]
    by_row = clock is not None and clock.direction.by_row
    if clock and by_row:
        sign = -1 if clock.direction is Direction.BOTTOM_TO_TOP else 1
        lines.append(f"  line_delay: {sign * clock.readout_s.value / mode.rows!r}")
    return ("\n".join(lines) + "\n").encode(), left_out(profile, FORM, "intrinsics", *["timing"] * by_row)
