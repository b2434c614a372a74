"""D of Eq. (16): differences between neighbouring pixels, and their transpose."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, kw_only=True)
class Differences:
    """Forward differences along columns and rows, stacked in this order; none reaches over the last row."""

    periodic_cols: bool = False  # whether the last column's neighbour is the first

    def forward(self, image: Float[np.ndarray, "*images rows cols"]) -> Float[np.ndarray, "2 *images rows cols"]:
        """D l, of any number of images."""
        out = np.zeros((2, *image.shape), image.dtype)
        np.subtract(image[..., 1:], image[..., :-1], out=out[0, ..., :-1])
        if self.periodic_cols:
            np.subtract(image[..., 0], image[..., -1], out=out[0, ..., -1])
        np.subtract(image[..., 1:, :], image[..., :-1, :], out=out[1, ..., :-1, :])
        return out

    def adjoint(self, gradient: Float[np.ndarray, "2 *images rows cols"]) -> Float[np.ndarray, "*images rows cols"]:
        """D^T j."""
        x, y = gradient
        out = np.zeros(x.shape, x.dtype)
        out[..., :-1] -= x[..., :-1]
        out[..., 1:] += x[..., :-1]
        if self.periodic_cols:
            out[..., -1] -= x[..., -1]
            out[..., 0] += x[..., -1]
        out[..., :-1, :] -= y[..., :-1, :]
        out[..., 1:, :] += y[..., :-1, :]
        return out
