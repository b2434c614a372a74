"""How sharply a path is in focus: what f gains at the path itself, against the same path shorter and longer.

f, the sparsity of the latent image (restoration.sparsity), falls with any path that leads less far, whatever the truth is, since
latent images lose edges to any blur. So a search for the least f shortens paths, and pushes their motion to the ends of the exposure.
About the true path, and only there, f has a dip besides. Its depth,

    s(theta) = (f(theta / a) + f(a theta)) / 2 - f(theta),

does not feel the slope beside it, as a lens is focused by the sharpest of a series of pictures and not by their brightness.
"""

from dataclasses import dataclass
from functools import lru_cache

import cv2
import numpy as np
from jaxtyping import Float

from rsvideo import threads
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration import device_frame, sparsity
from rsvideo.restoration.evidence import certainty
from rsvideo.restoration.scene import Scene
from rsvideo.restoration.settings import Device

SCALE = 1.25  # a: the dip is about as wide as this ratio
_TERMS = ((1.0, -1.0), (1 / SCALE, 0.5), (SCALE, 0.5))  # factors of the path, and weights of f along it


@dataclass(frozen=True, kw_only=True, eq=False)
class Focus:
    """s over a frame."""

    about: Float[np.ndarray, "rows cols"]  # each pixel, 0 where there is no texture to tell by
    whole: float
    surely: float  # standard errors by which that is above 0, by how far blocks of the frame agree


def focus(scene: Scene, path: Trajectory, sparse: float = 0.0) -> tuple[float, Float[np.ndarray, "terms axes"]]:
    """s(theta) - `sparse` f(theta) and its derivative in the path's coefficients. The path is 0 at rest: `path` has no constant part."""

    def term(factor: float) -> tuple[float, Float[np.ndarray, "terms axes"]]:
        return sparsity.objective(scene, path.with_coefficients(factor * path.coefficients), scene.search_ridge)

    value, gradient = 0.0, np.zeros_like(path.coefficients)
    terms = ((1.0, -1.0 - sparse), *_TERMS[1:])
    for (factor, weight), (f, slope) in zip(terms, threads.each(term, [factor for factor, _ in _TERMS]), strict=True):
        value += weight * f
        gradient += weight * factor * slope
    return value, gradient


def focus_value(scene: Scene, path: Trajectory) -> float:
    """s(theta) alone."""
    return sum(
        weight * sparsity.value(scene, path.with_coefficients(factor * path.coefficients), scene.search_ridge) for factor, weight in _TERMS
    )


def focus_map(scene: Scene, path: Trajectory, size: float) -> Focus:
    """s(theta) of the `size` px about each pixel, and of the whole frame."""
    total = counted = np.zeros(scene.frame.shape, np.float32)
    for factor, weight in _TERMS:
        value, counted = sparsity.density(scene, path.with_coefficients(factor * path.coefficients), scene.search_ridge)
        total = total + np.float32(weight) * value
    local = [_smooth(image, size / 2, scene.device) for image in (total, counted)]
    return Focus(
        about=local[0] / np.maximum(local[1], 1e-6),
        whole=float(total.sum() / max(counted.sum(), 1e-6)),
        surely=certainty(total, counted),
    )


def _smooth(image: Float[np.ndarray, "rows cols"], sigma: float, device: Device) -> Float[np.ndarray, "rows cols"]:
    """Under a Gaussian of many px."""
    if device == "cuda":
        return device_frame.gaussian(image, sigma)
    rows, cols = image.shape
    return _gaussian(rows, sigma) @ image @ _gaussian(cols, sigma).T


@lru_cache(maxsize=8)
def _gaussian(count: int, sigma: float) -> Float[np.ndarray, "count count"]:
    """As a matrix: over so many px, two products with it take a fifth of the time of the filter that it is made by."""
    return cv2.GaussianBlur(np.eye(count, dtype=np.float32), (1, round(8 * sigma + 1) | 1), sigmaX=1.0, sigmaY=sigma)
