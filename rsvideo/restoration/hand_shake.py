"""What is believed of a hand's motion before its picture is used: how fast its path's coefficients fall with their degree."""

import numpy as np
from jaxtyping import Float

from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import ShutterTiming

SPREAD = 0.35  # of the linear coefficient, in lengths of one exposure's path: 1 / sqrt(12) for even motion, and room for more
FALL = 0.4  # of the coefficients from degree to degree over FALL_TIME; measured hand shake falls by 4 to 5, this is wider by 2
FALL_TIME = 0.04  # s
MOST_FALL_TIMES = 2.0  # intervals longer than this many FALL_TIMEs are believed to be no rougher than that


def shake_spread(degree: int, timing: ShutterTiming) -> Float[np.ndarray, " degree"]:
    """Plausible size of Legendre coefficients 1..degree of a hand's motion, relative to the length of one exposure's path."""
    interval = timing.interval[1]
    return SPREAD * interval / timing.exposure * (FALL * np.minimum(interval / FALL_TIME, MOST_FALL_TIMES)) ** np.arange(degree)


def pose_unit(intrinsics: Intrinsics, axes: int) -> Float[np.ndarray, " axes"]:
    """What moves a pixel by about 1 px, of each axis: 1 px, 1 px, and a roll of one focal length's inverse."""
    return np.array([1, 1, 1 / intrinsics.fx])[:axes]
