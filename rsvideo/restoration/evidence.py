"""What speaks for a path: the spectra of the frame, and what its latent image loses along other paths.

A latent image's gradients are sparser along the true path than along its mirror image, and than along the same path shorter and longer
(restoration.focus). How much sparser depends on the picture; whether it is so does not: the difference is measured in blocks of the
frame, and counts by how far the blocks agree, in standard errors of their mean.

Gradients are measured by a power of |grad l| / rms_local(grad l), which hardly feels how strong an edge is and mostly shows more than f
itself does. To which side kernels lean shows best in latent images of a weak ridge, whose noise differs: two of them serve.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from rsvideo import threads
from rsvideo.physics.trajectory import Trajectory, centred
from rsvideo.restoration.extent import longest, sampled
from rsvideo.restoration.scene import Scene
from rsvideo.restoration.sparsity import density
from rsvideo.restoration.spectral_paths import mirrored

POWER = 0.3  # of a gradient, relative to those about it
MIRROR_RIDGES, FOCUS_RIDGE = (0.3, 1.0), 3.0  # times the scene's own; of 0.3, 1 and 3, those that speak most for true paths
BLOCK = 48  # px: about the window in which gradients are compared, so that blocks are nearly independent
LEAST_WEIGHT = 0.05  # of the best block's, which a block must have to count
STRETCH = 3.0  # px by which the longest of a path's blurs is shorter and longer beside it
SHORTEST = 0.5  # px; shorter blurs are stretched as this one is
MIDDLES = 8  # samples of an exposure, whose mean is a scanline's place


@dataclass(frozen=True, kw_only=True)
class Evidence:
    """What speaks for a path, and would be about 0 for one that has nothing to do with the blur."""

    rest: float  # by how much the spectra's misfit is lower than at rest
    mirror: float  # standard errors by which gradients are sparser than along the mirror image
    wobble: float  # px, RMS over the scanlines: where the two differ little, neither restores the frame wrongly
    focus: float  # standard errors by which they are sparser than along the same path shorter and longer


def evidence(part: Scene, whole: Scene, path: Trajectory, rest: float) -> Evidence:
    """What speaks for a path that was found; `rest` is what the spectra say of it.

    The direction shows least, so it is looked for in the whole scene, at the full resolution where that is at hand.
    """
    middles = part.camera.timing.sample_times(MIDDLES).mean(axis=1)
    return Evidence(
        rest=rest,
        mirror=sparser(whole, path, mirrored(path)),
        wobble=float(np.linalg.norm(path.at(middles)[:, :2].std(axis=0))),
        focus=sharper(part, path),
    )


def spoken(scene: Scene, path: Trajectory) -> float:
    """Standard errors by which gradients are sparser along a path than along its mirror image, and than along it shorter and longer."""
    return sparser(scene, path, mirrored(path)) + sharper(scene, path)


def sharper(scene: Scene, path: Trajectory) -> float:
    """The standard errors by which gradients are sparser along a path than along the same path shorter and longer."""
    path = centred(path, scene.camera.timing.middle)
    factor = 1 + STRETCH / max(longest(scene.camera, scene.scaled(path)), SHORTEST)
    longer, shorter = (path.with_coefficients(times * path.coefficients) for times in (factor, 1 / factor))
    wanted = [(each, FOCUS_RIDGE) for each in (path, longer, shorter)]
    (own, weight), (beyond, _), (below, _) = _densities(sampled(scene, path), wanted)
    return certainty((beyond + below) / 2 - own, weight)


def sparser(scene: Scene, path: Trajectory, other: Trajectory) -> float:
    """The standard errors by which gradients are sparser along a path than along another: its mirror image, or one near to that."""
    wanted = [(centred(each, scene.camera.timing.middle), ridge) for ridge in MIRROR_RIDGES for each in (path, other)]
    measured = _densities(sampled(scene, path), wanted)
    pairs = zip(measured[::2], measured[1::2], strict=True)
    return float(np.mean([certainty(across - along, weight) for (along, weight), (across, _) in pairs]))


def _densities(scene: Scene, wanted: list[tuple[Trajectory, float]]) -> list[tuple[np.ndarray, np.ndarray]]:
    """What each pixel adds to the sparsity along each path, with a ridge of so many times the scene's own, and its weight."""
    return threads.each(lambda each: density(scene, each[0], each[1] * scene.ridge, POWER), wanted)


def certainty(difference: Float[np.ndarray, "rows cols"], weight: Float[np.ndarray, "rows cols"]) -> float:
    """The weighted mean of a difference over blocks of a frame, over the standard error of that mean; 0 where there are no two blocks."""
    rows, cols = (max(1, n // BLOCK) for n in weight.shape)
    total, counted = (cv2.resize(image, (cols, rows), interpolation=cv2.INTER_AREA).astype(float) for image in (difference, weight))
    used = counted > LEAST_WEIGHT * counted.max()
    each, share = total[used] / counted[used], counted[used] / counted[used].sum()
    mean = share @ each
    spread = float(np.sqrt(share**2 @ (each - mean) ** 2))
    return float(mean) / spread if spread > 0 else 0.0
