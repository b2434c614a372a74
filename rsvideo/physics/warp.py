"""Sampling an image between its pixels."""

import numpy as np
from jaxtyping import Float, Int

TAPS = 2


def taps(offset: Float[np.ndarray, "*n"]) -> tuple[Int[np.ndarray, "*n"], Float[np.ndarray, "*n taps"]]:
    """The first of the neighbours that a sample at `offset` reads and their weights (linear interpolation)."""
    first = np.floor(offset)
    fraction = offset - first
    return first.astype(np.int64), np.stack([1 - fraction, fraction], axis=-1)
