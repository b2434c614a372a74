"""What the tests of several baselines look at: `from tests.baselines.scenes import cards, frame, path`."""

import numpy as np

from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial as Way
from rsvideo.physics.trajectory import Trajectory, centred
from rsvideo.restoration.scanlines import View, to_scanlines


def cards(rows: int, cols: int, *, channels: int = 1, count: int = 150, seed: int = 3) -> np.ndarray:
    """Cards of all sizes upon each other: sharp edges every few pixels."""
    rng = np.random.default_rng(seed)
    image = np.full((rows, cols, channels), 0.4)
    for _ in range(count):
        y, x, h, w = rng.integers(-20, rows), rng.integers(-20, cols), rng.integers(6, 50), rng.integers(6, 50)
        image[max(y, 0) : y + h, max(x, 0) : x + w] = 0.1 + 0.8 * rng.random(channels)
    return image


def path(coefficients: np.ndarray) -> Trajectory:
    """A polynomial over 40 ms whose middle is the origin."""
    return centred(Way(t0=0.0, t1=0.04, coefficients=coefficients), 0.02)


def frame(pixels: np.ndarray) -> Frame:
    """A frame that is clipped where it is full."""
    return Frame(pixels=pixels, clipped=pixels >= 1)


def view(given: Frame, timing: ShutterTiming) -> View:
    """The frame along its scanlines, by a camera whose focal length does not matter."""
    rows, cols = given.pixels.shape[:2]
    lens = Intrinsics.centred(focal=float(max(rows, cols)), rows=rows, cols=cols)
    return to_scanlines(given, Camera(timing=timing, intrinsics=lens))
