"""Curves from codes to light: those of standards, and the one that photographs themselves show."""

import math

import numpy as np
from jaxtyping import Bool, Float

from rsvideo.physics import tone
from rsvideo.physics.tone import Transfer

ENTRIES = 65  # of a curve that is written down
_FEWEST_CODES = 20  # of patches at two exposures or more, for a curve to be judged
_MOST_PATCHES = 300  # that the free curve is found from; more add time and little else
_SMOOTHNESS = 3.0  # weight of the free curve's second differences, beside a weight of up to 1 of each code
_LOG_LIGHT = (-50, 50)  # keeps the free curve finite where no code tells it


def decoded(transfer: Transfer, codes: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """The light of codes from 0 to 1, by a standard."""
    return tone.decode(transfer, codes.astype(np.float32)).astype(float)


def standard_curve(transfer: Transfer) -> Float[np.ndarray, " entries"]:
    """Light at codes evenly spaced from 0 to 1, rising to 1."""
    curve = np.maximum.accumulate(np.maximum(decoded(transfer, np.linspace(0, 1, ENTRIES)), 0))
    return curve / curve[-1]


def misfit(light: Float[np.ndarray, "patches n"], times: Float[np.ndarray, " n"], usable: Bool[np.ndarray, "patches n"]) -> float:
    """What a curve leaves: the root mean square of log radiance about each patch's own mean; infinite where nothing can be compared."""
    usable = usable & (light > 0)
    usable = usable & (usable.sum(axis=1, keepdims=True) >= 2)
    if usable.sum() < _FEWEST_CODES:
        return math.inf
    radiance = np.where(usable, np.log(np.where(usable, light, 1.0)) - np.log(times), 0.0)
    count = usable.sum(axis=1, keepdims=True)
    about = np.where(usable, radiance - radiance.sum(axis=1, keepdims=True) / np.maximum(count, 1), 0.0)
    return float(np.sqrt((about**2).sum() / (usable.sum() - (count > 0).sum())))


def free_curve(
    patches: Float[np.ndarray, "patches n"], times: Float[np.ndarray, " n"], usable: Bool[np.ndarray, "patches n"]
) -> Float[np.ndarray, "256"]:
    """Light by code, rising, and 1 at the highest code: Eq. (3) of Debevec and Malik (1997), g(Z_ij) - log E_i = log t_j with g'' small.

    OpenCV's solver cannot leave out clipped patches, which bend its curve near white; so the equations are written out here, and codes
    between two entries of g count for both.
    """
    chosen = np.flatnonzero(usable.sum(axis=1) >= 2)
    chosen = chosen[np.linspace(0, len(chosen) - 1, min(_MOST_PATCHES, len(chosen))).astype(int)]
    i, j = np.nonzero(usable[chosen])
    z = 255 * patches[chosen][i, j]
    k = np.minimum(z.astype(int), 254)
    w = np.minimum(z, 255 - z) / 127.5
    A, lines = np.zeros((len(i) + 255, 256 + len(chosen))), np.arange(len(i))
    A[lines, k], A[lines, k + 1], A[lines, 256 + i] = w * (1 - z + k), w * (z - k), -w
    for entry in range(254):
        A[len(i) + entry, entry : entry + 3] = _SMOOTHNESS * np.array([1.0, -2.0, 1.0])
    A[-1, 128] = 1.0  # the scale is free
    g = np.linalg.lstsq(A, np.concatenate([w * np.log(times)[j], np.zeros(255)]), rcond=None)[0][:256]
    light = np.maximum.accumulate(np.exp(np.clip(g, *_LOG_LIGHT)))
    return light / light[-1]
