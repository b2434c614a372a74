"""Gyroflow's lens profiles (JSON): camera matrix, distortion, readout time in milliseconds and its direction."""

import enum
import json
from pathlib import Path

from rsvideo.config.files import UnreadableError, read_whole
from rsvideo.config.yaml import ConfigError, Positions, validated
from rsvideo.physics.shutter import Direction
from rsvideo.shooting.camera_profile import CameraProfile, Pixels
from rsvideo.shooting.formats.plain import (
    Coefficients,
    Finite,
    Foreign,
    Matrix,
    Text,
    coefficients_of,
    left_out,
    lens_of,
    made,
    matrix_of,
    shortened,
)

FORM = "a lens profile of Gyroflow"
MOST_BYTES = 2_000_000
_MODELS = {"opencv_fisheye": "fisheye", "opencv_standard": "brown-conrady"}
_MOST_COEFFICIENTS = 12
_SHORTEST_MS = 1.0  # a time below is a slip of the unit, as in the public table


class ReadoutName(enum.StrEnum):
    """The directions of a readout, as lens profiles spell them; older ones have only a negative time, for bottom to top."""

    TOP_TO_BOTTOM = "TopToBottom"
    BOTTOM_TO_TOP = "BottomToTop"
    LEFT_TO_RIGHT = "LeftToRight"
    RIGHT_TO_LEFT = "RightToLeft"

    @classmethod
    def of(cls, direction: Direction) -> "ReadoutName":
        """The name of a direction."""
        return cls[direction.name]

    @property
    def direction(self) -> Direction:
        """The direction of a name."""
        return Direction[self.name]


class _Size(Foreign):
    w: Pixels
    h: Pixels


class _Camera(Foreign):
    RMS_error: Finite | None = None  # px
    camera_matrix: Matrix
    distortion_coeffs: Coefficients = ()


class _LensProfile(Foreign):
    name: Text | None = None
    camera_brand: Text | None = None
    camera_model: Text | None = None
    calibrated_by: Text | None = None
    date: Text | None = None
    calib_dimension: _Size
    fps: Finite | None = None
    frame_readout_time: Finite | None = None  # ms
    frame_readout_direction: ReadoutName | None = None
    global_shutter: bool | None = None
    input_horizontal_stretch: Finite | None = None
    input_vertical_stretch: Finite | None = None
    distortion_model: Text | None = None
    fisheye_params: _Camera | None = None  # of any model


def read(path: Path) -> CameraProfile:
    """The profile in a file; a distortion model that OpenCV does not have is left out, with a note."""
    positions = Positions(path=path, lines={})
    try:
        data = json.loads(read_whole(path, most=MOST_BYTES))
    except (ValueError, RecursionError) as error:
        if isinstance(error, UnreadableError):
            raise
        raise ConfigError(f"{path} must be JSON, {' '.join(str(error).split())[:200]}; is it cut short?") from error
    try:
        return _parsed(validated(_LensProfile, data, positions), positions)
    except ConfigError as error:  # JSON is read without lines
        raise ConfigError(*(fault.replace(f"{path}:1: ", f"{path}: ", 1) for fault in error.faults)) from error


def _parsed(profile: _LensProfile, positions: Positions) -> CameraProfile:
    for key in ("input_horizontal_stretch", "input_vertical_stretch"):
        if (stretch := getattr(profile, key)) not in (None, 1.0, 0.0):
            raise ConfigError(f"{positions.path}: {key}: must be 1, got {stretch:g}; anamorphic lenses are not read")
    camera, spelt = profile.fisheye_params, profile.distortion_model or "opencv_fisheye"
    model = _MODELS.get(spelt)
    lens = "" if model or camera is None else f"; its distortion, {spelt[:60]}, is left out: what remains holds near the middle"
    readout, direction = _timing(profile, positions)
    return made(
        positions,
        rows=profile.calib_dimension.h,
        cols=profile.calib_dimension.w,
        matrix=camera.camera_matrix if camera else None,
        model=model,
        coefficients=camera.distortion_coeffs if camera and model else (),
        readout=readout,
        direction=direction,
        rms_px=camera.RMS_error or None if camera else None,
        how=f"{FORM} by {(profile.calibrated_by or 'somebody')[:200]}{lens}",
        when=profile.date,
        name=profile.camera_model or profile.name or "",
        maker=profile.camera_brand,
        fps=profile.fps,
    )


def _timing(profile: _LensProfile, positions: Positions) -> tuple[float | None, Direction]:
    ms, name = profile.frame_readout_time, profile.frame_readout_direction
    if not ms:
        return (0.0 if profile.global_shutter else None), Direction.TOP_TO_BOTTOM
    if abs(ms) < _SHORTEST_MS:
        raise ConfigError(f"{positions.path}: frame_readout_time: must be at least 1 ms, got {ms:g}; is it in seconds?")
    by_sign = Direction.BOTTOM_TO_TOP if ms < 0 else Direction.TOP_TO_BOTTOM
    return abs(ms) * 1e-3, name.direction if name else by_sign


def encode(profile: CameraProfile) -> tuple[bytes, tuple[str, ...]]:
    """The file, and what it could not hold."""
    lens, clock, mode = lens_of(profile, FORM), profile.timing, profile.mode
    size = {"w": mode.cols, "h": mode.rows}
    model = lens.distortion.model if lens.distortion else "brown-conrady"
    coefficients = shortened(coefficients_of(lens), _MOST_COEFFICIENTS, FORM)
    data = {
        "name": profile.camera,
        "note": "",
        "calibrated_by": "rsvideo",
        "camera_brand": profile.maker or "",
        "camera_model": profile.name,
        "lens_model": "",
        "camera_setting": mode.crop or "",
        "calibrator_version": "1.6.0",
        "date": (lens.found.when if lens.found else None) or "",
        "calib_dimension": size,
        "orig_dimension": size,
        "output_dimension": size,
        "frame_readout_time": clock.readout_s.value * 1e3 if clock else None,
        "frame_readout_direction": ReadoutName.of(clock.direction) if clock else None,
        "global_shutter": bool(clock and clock.readout_s.value == 0),
        "input_horizontal_stretch": 1.0,
        "input_vertical_stretch": 1.0,
        "num_images": len(lens.found.files) if lens.found else 0,
        "fps": mode.fps or 0.0,
        "distortion_model": next(spelt for spelt, ours in _MODELS.items() if ours == model),
        "fisheye_params": {
            "RMS_error": lens.rms_px.value if lens.rms_px else 0.0,
            "camera_matrix": matrix_of(lens),
            "distortion_coeffs": coefficients or [0.0] * 4,
        },
        "official": False,
        "asymmetrical": True,  # the principal point is where it was measured
    }
    return (json.dumps(data, indent=2, allow_nan=False) + "\n").encode(), left_out(profile, FORM, "intrinsics", "timing")
