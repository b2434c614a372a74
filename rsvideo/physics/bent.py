"""Distortion inside compiled loops: from where a pinhole camera would show a ray to where the lens shows it, pixel by pixel."""

from typing import no_type_check

import numpy as np
from jaxtyping import Float
from numba import njit

from rsvideo.physics import distortion
from rsvideo.physics.camera import Intrinsics

_brown_conrady = njit(cache=True)(distortion.brown_conrady)
_fisheye = njit(cache=True)(distortion.fisheye)


def packed(intrinsics: Intrinsics) -> Float[np.ndarray, " numbers"]:
    """The lens as `bent` takes it; empty for a pinhole camera."""
    c, lens = intrinsics, intrinsics.distortion
    return np.array([c.fx, c.fy, c.cx, c.cy, lens.model == "fisheye", lens.limit, *lens.terms]) if lens else np.zeros(0)


@no_type_check
@njit(cache=True)
def bent(x, y, lens):
    """(x_d, y_d, dx_d/dx, dx_d/dy, dy_d/dx, dy_d/dy) of the pixel (x, y) of a pinhole camera."""
    if not lens.size:
        return x, y, 1.0, 0.0, 0.0, 1.0
    fx, fy, cx, cy, limit = lens[0], lens[1], lens[2], lens[3], lens[5]
    u, v = (x - cx) / fx, (y - cy) / fy
    if lens[4]:
        u, v, xx, xy, yx, yy = _fisheye(u, v, lens[6:], limit)
    else:
        u, v, xx, xy, yx, yy = _brown_conrady(u, v, lens[6:], limit)
    return fx * u + cx, fy * v + cy, xx, xy * fx / fy, yx * fy / fx, yy
