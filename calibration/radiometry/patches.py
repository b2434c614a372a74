"""Small square patches of a picture, on which codes are averaged."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Bool, Float, Float32

SIDE_PX = 8  # of a patch
EDGE = 0.02  # of the codes: so near to black and to clipping, codes say little of light
_MOST = 1600  # patches
_GROUPS = 40  # of brightness, from each of which as many patches are taken
_CALM = 0.1  # how much a patch may vary, as part of its mean


def calmest(
    codes: Sequence[Float32[np.ndarray, "rows cols"]], black: float, high: float
) -> tuple[Float[np.ndarray, "patches n"], Bool[np.ndarray, "patches n"]]:
    """Mean codes of the calmest patches of all brightnesses in every picture, and where they can be trusted: no pixel of the patch is
    clipped at either end, and they vary so little that the light of their mean is the mean of their light."""
    by_picture = [blocks(plane) for plane in codes]
    means = np.stack([of.mean(axis=1) for of in by_picture], axis=1).astype(float)
    spread = np.stack([of.std(axis=1) for of in by_picture], axis=1)
    inside = np.stack([(of.min(axis=1) > black) & (of.max(axis=1) < high) for of in by_picture], axis=1)
    level = np.argsort(np.argsort(means.mean(axis=1))) * _GROUPS // len(means)
    kept = [np.flatnonzero(level == k)[np.argsort(spread[level == k].max(axis=1))[: _MOST // _GROUPS]] for k in range(_GROUPS)]
    chosen = np.concatenate(kept)
    usable = inside & (spread < _CALM * (means - black)) & (means > black + EDGE)
    return means[chosen], usable[chosen]


def blocks(plane: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "patches pixels"]:
    """A picture cut into patches, without what is left at its edges."""
    rows, cols = (side // SIDE_PX for side in plane.shape)
    cut = plane[: rows * SIDE_PX, : cols * SIDE_PX].reshape(rows, SIDE_PX, cols, SIDE_PX)
    return cut.swapaxes(1, 2).reshape(rows * cols, SIDE_PX * SIDE_PX)
