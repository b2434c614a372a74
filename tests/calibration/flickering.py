"""A wall under a light that flickers, as a camera with a rolling shutter sees it."""

from fractions import Fraction

import numpy as np

from calibration import flicker
from rsvideo.physics.shutter import Direction, ShutterTiming

ROWS, COLS, FPS = 240, 320, Fraction(30000, 1001)


def lit(direction: Direction = Direction.TOP_TO_BOTTOM, frames: int = 12) -> list[np.ndarray]:
    """A wall under a light of 500 Hz, read in 18 ms."""
    timing = ShutterTiming.from_readout(
        exposure=0.0005, readout=0.018, rows=ROWS if direction.value.endswith(("top", "bottom")) else COLS, direction=direction
    )
    wall = np.broadcast_to(0.3 + 0.1 * np.sin(np.arange(COLS) / 30), (ROWS, COLS))[..., None]
    gains = [flicker.gains(timing, float(k / FPS), flicker.sine(0.3), hertz=500) for k in range(frames)]
    noise = np.random.default_rng(0)
    return [flicker.lit(wall, timing, gain)[..., 0] + 0.003 * noise.standard_normal((ROWS, COLS)) for gain in gains]
