"""Proximal maps, argmin_x f(x) + |x - v|^2 / 2, of the priors."""

import numpy as np
from jaxtyping import Float


def soft_threshold(v: Float[np.ndarray, "*n"], threshold: float | Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """f = threshold |x|_1: on gradients, that of anisotropic total variation."""
    return v - np.clip(v, -threshold, threshold)


def hard_threshold(v: Float[np.ndarray, "*n"], weight: float) -> Float[np.ndarray, "*n"]:
    """f = weight |x|_0, the number of entries that are not zero."""
    return np.where(v * v > 2 * weight, v, 0).astype(v.dtype)


def box(v: Float[np.ndarray, "*n"], low: float, high: float) -> Float[np.ndarray, "*n"]:
    """f = 0 where low <= x <= high, infinite elsewhere."""
    return np.clip(v, low, high)
