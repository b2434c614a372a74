"""Rotation vectors: their cross products, and how a rotation changes with its vector."""

import numpy as np
from jaxtyping import Float

_SMALL = 0.05  # rad; below, the series is exact to 1e-13 and the closed form loses digits


def cross(v: Float[np.ndarray, "*n 3"]) -> Float[np.ndarray, "*n 3 3"]:
    """[v]_x, footnote 1 of the paper."""
    out = np.zeros((*v.shape, 3))
    out[..., 0, 1], out[..., 0, 2], out[..., 1, 2] = -v[..., 2], v[..., 1], -v[..., 0]
    return out - out.swapaxes(-1, -2)


def left_jacobian(omega: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 3 3"]:
    """J with d exp([w]_x) = [J dw]_x exp([w]_x)."""
    angle = np.linalg.norm(omega, axis=1)[:, None, None]
    W = cross(omega)
    first = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos a) / a^2
    series = 1 / 6 - angle**2 / 120 + angle**4 / 5040
    second = np.where(angle < _SMALL, series, (angle - np.sin(angle)) / np.maximum(angle, _SMALL) ** 3)
    return np.eye(3) + first * W + second * W @ W
