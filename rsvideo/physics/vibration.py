"""How an engine shakes a camera: by tones, whose frequencies and strength are looked for in how points move between frames."""

import numpy as np
from jaxtyping import Float

LOWEST, HIGHEST = 12.0, 110.0  # Hz; slower is a hand's
SPREAD = 2.0  # px, of a tone's coefficients
EVIDENCE = 14.0  # logarithm of how much likelier points are with a tone than without, from which on it is believed
HIDDEN = 0.3  # |sin(pi f T)|, T from frame to frame: below, a tone shakes all frames alike, as the scene's depth seems to


def telling(of: Float[np.ndarray, " tones"], period: float) -> Float[np.ndarray, " telling"]:
    """Those of some frequencies, Hz, that do not shake all frames alike, which are `period` seconds apart."""
    return of[np.abs(np.sin(np.pi * of * period)) > HIDDEN]


def frequencies(step: float, period: float) -> Float[np.ndarray, " telling"]:
    """The frequencies that are tried, in equal steps, Hz."""
    return telling(np.arange(LOWEST, HIGHEST, step), period)
