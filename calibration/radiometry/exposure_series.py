"""Photographs of one still scene, exposed for different times."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float32, UInt

MOST_PIXELS = 60_000_000
_EXPOSURE_S = (1e-6, 3600.0)  # beyond, a slip
_SAME_TIME = 2e-3  # relative, by which a time may differ from one that cameras display
_ONE_OVER = (8000, 6400, 5000, 4000, 3200, 2500, 2000, 1600, 1250, 1000, 800, 640, 500, 400, 320, 250, 200, 160, 125, 100, 80, 60, 50)
_ONE_OVER += (40, 30, 25, 20, 15, 13, 10, 8, 6, 5, 4)  # second, that cameras display, in thirds of a stop
_SECONDS = (0.3, 0.4, 0.5, 0.6, 0.8, 1.0)  # that they display as such
DISPLAYED_S = frozenset(round(1 / part, 9) for part in _ONE_OVER) | frozenset(_SECONDS)


@dataclass(frozen=True, kw_only=True, eq=False)
class Photograph:
    """One photograph of the series."""

    name: str
    samples: UInt[np.ndarray, "rows cols channels"]  # codes
    exposure: float  # seconds
    linear: bool = False  # whether its codes are light, as those of raw are


def exact_times(exposures: Sequence[float]) -> tuple[float, ...]:
    """Times as shutters keep them: where all are the rounded ones that cameras display, whole thirds of a stop."""
    if all(any(abs(t / n - 1) < _SAME_TIME for n in DISPLAYED_S) for t in exposures):
        return tuple(2.0 ** (round(3 * math.log2(t)) / 3) for t in exposures)
    return tuple(exposures)


def check(series: Sequence[Photograph]) -> None:
    """Refuse what is no exposure series."""
    if len(series) < 2 or len({one.exposure for one in series}) < 2:
        raise ValueError(
            f"a response needs one scene at two exposures or more, got {len(series)} pictures of {len({s.exposure for s in series})}"
        )
    for one in series:
        if one.samples.shape != series[0].samples.shape or one.samples.dtype != series[0].samples.dtype or one.linear != series[0].linear:
            raise ValueError(f"the pictures must be of one size, depth and kind, {one.name} is not like {series[0].name}")
        if one.samples[..., 0].size > MOST_PIXELS:
            raise ValueError(f"{one.name} must hold at most {MOST_PIXELS / 1e6:g} Mpx")
        if not _EXPOSURE_S[0] <= one.exposure <= _EXPOSURE_S[1]:
            raise ValueError(f"the exposure of {one.name} must lie in 1 us to an hour, got {one.exposure:g} s")


def codes(one: Photograph) -> Float32[np.ndarray, "rows cols"]:
    """The green codes, or the only ones, in [0, 1]."""
    plane = one.samples[..., min(1, one.samples.shape[2] - 1)]
    return plane.astype(np.float32) / np.iinfo(plane.dtype).max
