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


def evidence(scene: Scene, path: Trajectory, rest: float) -> Evidence:
    """What speaks for a path that was found; `rest` is what the spectra say of it."""
    middles = scene.camera.timing.sample_times(MIDDLES).mean(axis=1)
    mirror, focus = compared(scene, path)
    return Evidence(
        rest=rest,
        mirror=mirror,
        wobble=float(np.linalg.norm(path.at(middles)[:, :2].std(axis=0))),
        focus=focus,
    )


def compared(scene: Scene, path: Trajectory) -> tuple[float, float]:
    """The standard errors by which gradients are sparser than along the mirror image, and than along the path shorter and longer."""
    scene, path = sampled(scene, path), centred(path, scene.camera.timing.middle)
    factor = 1 + STRETCH / max(longest(scene.camera, scene.scaled(path)), SHORTEST)

    def sparse(measured: tuple[float, float]) -> tuple[np.ndarray, np.ndarray]:
        times, ridge = measured
        return density(scene, path.with_coefficients(times * path.coefficients), ridge * scene.ridge, POWER)

    wanted = [(times, ridge) for ridge in MIRROR_RIDGES for times in (1.0, -1.0)] + [
        (times, FOCUS_RIDGE) for times in (1.0, factor, 1 / factor)
    ]
    densities = dict(zip(wanted, threads.each(sparse, wanted), strict=True))
    mirror = [certainty(densities[-1.0, ridge][0] - densities[1.0, ridge][0], densities[1.0, ridge][1]) for ridge in MIRROR_RIDGES]
    own, weight = densities[1.0, FOCUS_RIDGE]
    beside = (densities[factor, FOCUS_RIDGE][0] + densities[1 / factor, FOCUS_RIDGE][0]) / 2
    return float(np.mean(mirror)), certainty(beside - own, weight)


def certainty(difference: Float[np.ndarray, "rows cols"], weight: Float[np.ndarray, "rows cols"]) -> float:
    """The weighted mean of a difference over blocks of a frame, over the standard error of that mean; 0 where there are no two blocks."""
    rows, cols = (max(1, n // BLOCK) for n in weight.shape)
    total, counted = (cv2.resize(image, (cols, rows), interpolation=cv2.INTER_AREA).astype(float) for image in (difference, weight))
    used = counted > LEAST_WEIGHT * counted.max()
    each, share = total[used] / counted[used], counted[used] / counted[used].sum()
    mean = share @ each
    spread = float(np.sqrt(share**2 @ (each - mean) ** 2))
    return float(mean) / spread if spread > 0 else 0.0
