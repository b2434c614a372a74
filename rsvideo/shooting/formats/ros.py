"""ROS's camera_info (YAML), as camera_calibration writes it: the lens alone."""

import json
from typing import Annotated, Any, Literal

from pydantic import Field

from rsvideo.config.yaml import ConfigError, Positions, validated
from rsvideo.shooting.camera_profile import CameraProfile, Pixels
from rsvideo.shooting.formats.plain import Finite, Foreign, Text, coefficients_of, left_out, lens_of, made, matrix_of

FORM = "ROS's camera_info"
_MODELS = {"plumb_bob": "brown-conrady", "rational_polynomial": "brown-conrady", "equidistant": "fisheye", "fisheye": "fisheye"}
_PLUMB_BOB, _RATIONAL = 5, 8  # coefficients


class _Data(Foreign):
    data: Annotated[list[Finite], Field(max_length=14)]


class _CameraInfo(Foreign):
    image_width: Pixels
    image_height: Pixels
    camera_name: Text = ""
    camera_matrix: _Data
    distortion_model: Literal["plumb_bob", "rational_polynomial", "equidistant", "fisheye"]
    distortion_coefficients: _Data


def holds(data: object) -> bool:
    """Whether a YAML document is one."""
    return isinstance(data, dict) and "camera_matrix" in data


def parsed(data: Any, positions: Positions) -> CameraProfile:
    """The profile in a document."""
    info = validated(_CameraInfo, data, positions)
    if len(matrix := info.camera_matrix.data) != 9:
        raise ConfigError(f"{positions.where(('camera_matrix',))}: camera_matrix: must hold 9 numbers, got {len(matrix)}")
    return made(
        positions,
        rows=info.image_height,
        cols=info.image_width,
        matrix=[matrix[:3], matrix[3:6], matrix[6:]],
        model=_MODELS[info.distortion_model],
        coefficients=info.distortion_coefficients.data,
        how=FORM,
        name=info.camera_name,
    )


def encode(profile: CameraProfile) -> tuple[bytes, tuple[str, ...]]:
    """The file, and what it could not hold."""
    lens, mode = lens_of(profile, FORM), profile.mode
    coefficients = coefficients_of(lens)
    if lens.distortion and lens.distortion.model == "fisheye":
        model = "equidistant"
    elif len(coefficients) <= _PLUMB_BOB:
        model, coefficients = "plumb_bob", [*coefficients, *[0.0] * (_PLUMB_BOB - len(coefficients))]
    elif not any(coefficients[_RATIONAL:]):
        model, coefficients = "rational_polynomial", coefficients[:_RATIONAL]
    else:
        raise ConfigError(f"{FORM} holds {_RATIONAL} coefficients of distortion, the profile has {len(coefficients)}; calibrate with fewer")
    matrix = matrix_of(lens)
    unturned = [1.0, 0, 0, 0, 1.0, 0, 0, 0, 1.0]
    lines = [
        f"image_width: {mode.cols}",
        f"image_height: {mode.rows}",
        f"camera_name: {json.dumps(profile.camera)}",
        *_array("camera_matrix", 3, [number for row in matrix for number in row]),
        f"distortion_model: {model}",
        *_array("distortion_coefficients", 1, coefficients),
        *_array("rectification_matrix", 3, unturned),
        *_array("projection_matrix", 3, [number for row in matrix for number in (*row, 0.0)]),
    ]
    return ("\n".join(lines) + "\n").encode(), left_out(profile, FORM, "intrinsics")


def _array(name: str, rows: int, data: list[float]) -> list[str]:
    return [f"{name}:", f"  rows: {rows}", f"  cols: {len(data) // rows}", f"  data: {data}"]
