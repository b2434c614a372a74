"""Measures a camera on files: its lens, its readout time, how its codes stand for light.

    import calibration

    calibration.board("board.pdf", "chessboard:9x6:25mm")  # print it, photograph it
    lens = calibration.lens("photographs/", "chessboard:9x6:25mm")
    readout = calibration.readout("clip.mp4", flicker=1000.0)  # filmed under a light that flickers at 1 kHz
    calibration.profile.write(lens, "mine.yaml")
    if not isinstance(readout, calibration.CannotTell):
        calibration.profile.write(readout, "mine.yaml", add=True)

Lengths are in metres and pixels, times in seconds, light and codes from 0 to 1. What is named here is loaded when it is first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from calibration import flicker as flicker
    from calibration import profile as profile
    from calibration.boards.sheet import board
    from calibration.boards.target import Board
    from calibration.intrinsics.lens_fit import TooFewViewsError
    from calibration.intrinsics.lensfun_database import LensPrior, look_up_lens
    from calibration.intrinsics.measure import LensMeasurement, lens
    from calibration.radiometry.measure import ResponseMeasurement, response
    from calibration.timing.cannot_tell import CannotTell
    from calibration.timing.measure import readout
    from calibration.timing.readout_measurement import ReadoutMeasurement
    from rsvideo.shooting.camera_profile import CameraProfile

__all__ = [
    "Board",
    "CameraProfile",
    "CannotTell",
    "LensMeasurement",
    "LensPrior",
    "ReadoutMeasurement",
    "ResponseMeasurement",
    "TooFewViewsError",
    "board",
    "flicker",
    "lens",
    "look_up_lens",
    "profile",
    "readout",
    "response",
]

_HOMES = {
    "Board": "calibration.boards.target",
    "CameraProfile": "rsvideo.shooting.camera_profile",
    "CannotTell": "calibration.timing.cannot_tell",
    "LensMeasurement": "calibration.intrinsics.measure",
    "LensPrior": "calibration.intrinsics.lensfun_database",
    "ReadoutMeasurement": "calibration.timing.readout_measurement",
    "ResponseMeasurement": "calibration.radiometry.measure",
    "TooFewViewsError": "calibration.intrinsics.lens_fit",
    "board": "calibration.boards.sheet",
    "lens": "calibration.intrinsics.measure",
    "look_up_lens": "calibration.intrinsics.lensfun_database",
    "readout": "calibration.timing.measure",
    "response": "calibration.radiometry.measure",
}
_MODULES = ("flicker", "profile")


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return importlib.import_module(f"calibration.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'calibration' has no attribute {name!r}")
    value = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
