"""The PSFs of pixels, from the traces that their light draws."""

import numpy as np
from jaxtyping import Float

INSTANTS = 400  # of one exposure, that a PSF is drawn from


def psfs_from_traces(traces: Float[np.ndarray, "pixels instants 2"], half: int) -> Float[np.ndarray, "pixels side side"]:
    """Each trace as light on the `half` px to either side of its pixel, each instant shared among the four nearest."""
    pixels, instants, _ = traces.shape
    side = 2 * half + 1
    whole = np.floor(traces).astype(int)
    column, row = np.moveaxis(whole + half, -1, 0)
    right, down = np.moveaxis(traces - whole, -1, 0)
    first = side * (side * np.arange(pixels)[:, None] + row) + column
    places = np.stack([first, first + 1, first + side, first + side + 1])
    light = np.stack([(1 - right) * (1 - down), right * (1 - down), (1 - right) * down, right * down])
    drawn = np.bincount(places.ravel(), light.ravel(), pixels * side**2)
    return drawn.reshape(pixels, side, side) / instants
