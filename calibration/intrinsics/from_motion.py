"""The focal length of ordinary hand-held footage: as a camera turns, the sides of its picture move faster than the middle.

A turn moves a point at x px from the middle by 1 + (x / f)^2 times as much as the middle, so that how the sides' motion goes with the
middle's shows b = (rows / 2 f)^2 (calibration.timing.pair_motion). b has Gaussian errors; the prior is of log f. A camera that moves
sideways instead bends nothing and pretends a longer lens.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calibration.timing.pair_motion import Pair, perspective
from rsvideo.shooting import usual

VAGUE = 0.1  # deviation of the focal length's logarithm, from which on it is no answer
_REACH, _TRIED = 5.0, 501  # deviations from the usual to either side, and focal lengths that are tried within


@dataclass(frozen=True, kw_only=True)
class Focal:
    """The focal length that footage, and what is usual of cameras, make likeliest."""

    pixels: float
    deviation: float  # of its logarithm


def focal_length(pairs: Sequence[Pair], rows: int, cols: int) -> Focal:
    """Of footage whose points were followed, from the posterior mean of log f."""
    shown = perspective(pairs, rows, cols)
    apart = np.linspace(-_REACH, _REACH, _TRIED)  # in deviations of the prior
    log = np.log(usual.FOCAL * max(rows, cols)) + usual.FOCAL_SPREAD * apart
    bend = (rows / 2 / np.exp(log)) ** 2
    likely = -0.5 * (apart**2 + shown.precision * (bend - shown.bend) ** 2)
    density = np.exp(likely - likely.max())
    mean = float(np.average(log, weights=density))
    return Focal(pixels=float(np.exp(mean)), deviation=float(np.sqrt(np.average((log - mean) ** 2, weights=density))))
