"""What stands beside rendered frames: how they were rendered, and the motion they were rendered with."""

import json
from collections.abc import Mapping

import numpy as np

from rsvideo.physics.gyro import angles_from_poses
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.staging import Stage
from rsvideo.shooting.given_motion import COLUMNS

_STEP = 0.5e-3  # seconds from one sample of the motion to the next
_FEWEST = 81  # samples


def motion_csv(staged: Stage) -> bytes:
    """Angles in rad over the frame's whole interval; time 0 opens the scanline that is read first."""
    start, end = staged.camera.timing.interval
    times = np.linspace(start, end, max(_FEWEST, round((end - start) / _STEP) + 1))
    angles = angles_from_poses(staged.trajectory.at(times), camera=staged.camera.intrinsics)
    rows = np.concatenate([times[:, None], angles], axis=1)
    return "".join([",".join(COLUMNS) + "\n", *(",".join(f"{value:.9g}" for value in row) + "\n" for row in rows)]).encode()


def shutter_facts(timing: ShutterTiming) -> dict[str, object]:
    """When each scanline collected light, under the names of a case."""
    return {
        "exposure_s": timing.exposure,
        "row_time_s": timing.row_time,
        "readout_s": timing.readout,
        "direction": timing.direction.value,
    }


def case_json(staged: Stage, more: Mapping[str, object]) -> bytes:
    """The stage in numbers, and what more the caller states of the rendering."""
    lens = staged.camera.intrinsics
    case = {
        "kind": "still",
        **shutter_facts(staged.camera.timing),
        "rows": lens.rows,
        "cols": lens.cols,
        "focal_px": lens.fx,
        "blur_px": round(staged.blur, 3),
        **({"distortion": {"model": lens.distortion.model, "coefficients": lens.distortion.coefficients}} if lens.distortion else {}),
        **more,
    }
    return (json.dumps(case, indent=1) + "\n").encode()
