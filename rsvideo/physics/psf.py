"""The PSF of a pixel, from the trace that its light draws."""

import numpy as np
from jaxtyping import Float

INSTANTS = 400  # of one exposure, that a PSF is drawn from


def psf_from_trace(trace: Float[np.ndarray, "instants 2"], half: int) -> Float[np.ndarray, "side side"]:
    """The trace as light on pixels, each instant shared among the four nearest."""
    side = 2 * half + 1
    kernel = np.zeros((side, side))
    whole = np.floor(trace).astype(int)
    part = trace - whole
    for dx in (0, 1):
        for dy in (0, 1):
            weight = np.abs(1 - dx - part[:, 0]) * np.abs(1 - dy - part[:, 1])
            np.add.at(kernel, (whole[:, 1] + dy + half, whole[:, 0] + dx + half), weight)
    return kernel / len(trace)
