"""OpenCV's calibration files (FileStorage YAML, as its own programs write them): the lens alone.

Its dialect (a first line `%YAML:1.0`, tags for matrices) is no YAML to other parsers, and its own parser is not made for strangers'
files; what a calibration needs of it is read here.
"""

import math
import re
from pathlib import Path

from rsvideo.config.files import read_whole
from rsvideo.config.yaml import MOST_BYTES, ConfigError, Positions, shown
from rsvideo.shooting.camera_profile import CameraProfile
from rsvideo.shooting.formats.plain import coefficients_of, left_out, lens_of, made, matrix_of

FORM = "a calibration file of OpenCV"
_MATRIX = re.compile(r"!!opencv-matrix\s+rows: *(\d{1,4})\s+cols: *(\d{1,4})\s+dt: *\"?[df]\"?\s+data: *\[([^\]]*)\]")
_KEY = re.compile(r"^(\w{1,60}): *", re.MULTILINE)
_NAMES = {  # by any of the names in use; case does not count
    "camera_matrix": ("camera_matrix", "cameramatrix"),
    "distortion_coefficients": ("distortion_coefficients", "dist_coeffs", "distcoeffs"),
    "image_width": ("image_width",),
    "image_height": ("image_height",),
}


def is_storage(data: bytes) -> bool:
    """Whether a file is in OpenCV's dialect."""
    return data.removeprefix(b"\xef\xbb\xbf").startswith((b"%YAML:1.0", b"%YAML 1.0")) or b"!!opencv-matrix" in data


def read(path: Path) -> CameraProfile:
    """The profile in a file."""
    text = read_whole(path, most=MOST_BYTES).decode("utf-8", "replace")
    starts = {match[1].lower(): match for match in reversed(list(_KEY.finditer(text)))}
    lines = {(key,): text.count("\n", 0, match.start()) + 1 for key, match in starts.items()}
    positions = Positions(path=path, lines=lines)

    def value(name: str) -> tuple[tuple[str], str]:
        for spelt in _NAMES.get(name, (name,)):
            if spelt in starts:
                return (spelt,), text[starts[spelt].end() :]
        raise ConfigError(f"{path}: {name}: must be given; is it a calibration file?")

    def whole(name: str) -> int:
        key, rest = value(name)
        word = rest.partition("\n")[0].strip()
        if not re.fullmatch(r"\d{1,9}", word):
            raise ConfigError(positions.fault(key, f"must be a whole number, got {shown(word)}"))
        return int(word)

    def matrix(name: str) -> list[float]:
        key, rest = value(name)
        if not (found := _MATRIX.match(rest)):
            raise ConfigError(positions.fault(key, "must be a matrix (!!opencv-matrix with rows, cols, dt d or f, data)"))
        try:
            numbers = [float(word) for word in found[3].split(",")]
        except ValueError as error:
            raise ConfigError(positions.fault(key, "must hold numbers")) from error
        if len(numbers) != int(found[1]) * int(found[2]) or not all(map(math.isfinite, numbers)):
            raise ConfigError(positions.fault(key, f"must hold {found[1]} x {found[2]} finite numbers, got {len(numbers)}"))
        return numbers

    camera, coefficients = matrix("camera_matrix"), matrix("distortion_coefficients")
    if len(camera) != 9:
        raise ConfigError(f"{path}: camera_matrix: must be 3 x 3, got {len(camera)} numbers")
    fisheye = "fisheye_model" in starts and whole("fisheye_model") != 0
    return made(
        positions,
        rows=whole("image_height"),
        cols=whole("image_width"),
        matrix=[camera[:3], camera[3:6], camera[6:]],
        model="fisheye" if fisheye else "brown-conrady",
        coefficients=coefficients,
        how=FORM,
    )


def encode(profile: CameraProfile) -> tuple[bytes, tuple[str, ...]]:
    """The file, and what it could not hold."""
    lens, mode = lens_of(profile, FORM), profile.mode
    coefficients = coefficients_of(lens) or [0.0] * 4
    lines = [
        "%YAML:1.0",
        "---",
        f"image_width: {mode.cols}",
        f"image_height: {mode.rows}",
        *_matrix("camera_matrix", 3, [number for row in matrix_of(lens) for number in row]),
        *_matrix("distortion_coefficients", len(coefficients), coefficients),
        f"fisheye_model: {int(bool(lens.distortion and lens.distortion.model == 'fisheye'))}",
        *([f"avg_reprojection_error: {lens.rms_px.value!r}"] if lens.rms_px else []),
    ]
    return ("\n".join(lines) + "\n").encode(), left_out(profile, FORM, "intrinsics")


def _matrix(name: str, rows: int, data: list[float]) -> list[str]:
    return [f"{name}: !!opencv-matrix", f"   rows: {rows}", f"   cols: {len(data) // rows}", "   dt: d", f"   data: {data}"]
