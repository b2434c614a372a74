"""A few columns, or rows, that stand for those between them, where what is wanted of all of them is smooth."""

from typing import no_type_check

import numpy as np
from jaxtyping import Float32, Int

from rsvideo.threads import loop, spread

NODES = 16  # px from one to the next; pixels that are followed so at 20 px of motion are off by 0.001 px


def nodes(count: int, step: int = NODES) -> Int[np.ndarray, " nodes"]:
    """The columns, or rows, whose pixels are followed exactly: every `step` px, and the last."""
    return np.unique(np.r_[np.arange(0, count, step), count - 1])


def between(at: Float32[np.ndarray, "rows nodes 2"], columns: Int[np.ndarray, " nodes"]) -> Float32[np.ndarray, "2 rows cols"]:
    """Places of every column, x and y apart, from those of the nodes by linear interpolation."""
    every = np.arange(columns[-1] + 1)
    low = np.clip(np.searchsorted(columns, every, side="right") - 1, 0, max(len(columns) - 2, 0))
    high = np.minimum(low + 1, len(columns) - 1)
    share = ((every - columns[low]) / np.maximum(columns[high] - columns[low], 1)).astype(np.float32)
    out = np.empty((2, len(at), len(every)), np.float32)
    spread(_between, len(at), np.ascontiguousarray(at), low, high, share, out, size=out.nbytes)
    return out


@no_type_check
@loop(fastmath=False)
def _between(first, last, at, low, high, share, out):
    """`between`, of each row."""
    for r in range(first, last):
        for c in range(len(low)):
            for a in range(2):
                left = at[r, low[c], a]
                out[a, r, c] = left + share[c] * (at[r, high[c], a] - left)
