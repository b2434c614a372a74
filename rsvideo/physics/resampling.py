"""A picture between its pixels, inside compiled loops: Catmull-Rom's cubic, which gives every pixel itself at its own place."""

from typing import no_type_check

import numpy as np
from numba import njit


@no_type_check
@njit(cache=True, inline="always")
def add_sample(total, scene, x, y, weight):
    """Adds `weight` times the picture at (x, y) to the channels of `total`, which is the loop's own; edges hold beyond the picture."""
    rows, cols, channels = scene.shape
    x0, y0 = int(np.floor(x)), int(np.floor(y))
    a, b = x - x0, y - y0
    for m in range(4):
        wy = weight * _catmull_rom(b, m)
        r = min(max(y0 + m - 1, 0), rows - 1)
        for n in range(4):
            w = wy * _catmull_rom(a, n)
            c = min(max(x0 + n - 1, 0), cols - 1)
            for q in range(channels):
                total[q] += w * scene[r, c, q]


@no_type_check
@njit(cache=True, inline="always")
def _catmull_rom(f, tap):
    """The weight of tap 0..3 at a fraction f between taps 1 and 2."""
    if tap == 0:
        return ((2.0 - f) * f - 1.0) * f / 2.0
    if tap == 1:
        return ((3.0 * f - 5.0) * f * f + 2.0) / 2.0
    if tap == 2:
        return ((4.0 - 3.0 * f) * f + 1.0) * f / 2.0
    return (f - 1.0) * f * f / 2.0
