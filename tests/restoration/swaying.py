"""A hand-held camera's path over eight frames: `from tests.restoration.swaying import sway`."""

import numpy as np

from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Spline, fit

CAMERA = Intrinsics.centred(focal=300.0, rows=120, cols=160)
TIMING = ShutterTiming.from_readout(exposure=0.01, readout=0.03, rows=120)
BEGINS = np.arange(8) / 24
END = float(BEGINS[-1]) + TIMING.interval[1]


def spline(t: np.ndarray, poses: np.ndarray, terms: int = 40) -> Spline:
    found = fit(Spline(t0=0.0, t1=END, coefficients=np.zeros((terms, poses.shape[1]))), t, poses)
    assert isinstance(found, Spline)
    return found


def sway(axes: int) -> Spline:
    """Some 4 Hz, as a hand does, on top of a pan to the right."""
    t = np.linspace(0, END, 400)
    x = 60 * t + 6 * np.sin(2 * np.pi * 4 * t)
    y = 8 * np.cos(2 * np.pi * 3 * t)
    roll = 0.02 * np.sin(2 * np.pi * 2.5 * t)
    return spline(t, np.stack([x, y, roll], axis=1)[:, :axes])
