"""The door to the GPU: frames and scenes whose latent images are computed there. What is imported within functions needs the extra gpu."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32

from rsvideo.physics.camera import Camera
from rsvideo.physics.tiles import NARROWEST, Tile
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.blurred_frame import BlurredFrame, Eliminated
from rsvideo.restoration.nonblind import OVERLAP, RIM, TV_AHEAD, TV_FLOOR, TV_RHO, cut_for
from rsvideo.restoration.parallax import Flow, displacements


def tiled(
    pixels: Float[np.ndarray, "rows cols channels"],
    clipped: Bool[np.ndarray, "rows cols channels"],
    trajectory: Trajectory,
    camera: Camera,
    *,
    samples: int,
    tolerance: float,
    flow: Flow | None = None,
) -> BlurredFrame:
    """The twin of `rsvideo.restoration.nonblind.tiled`, in narrower tiles where the GPU's memory does not hold one of the same width."""
    from rsvideo.gpu import frame

    def offsets(cut: list[Tile]) -> Float32[np.ndarray, "tiles rows samples 2"]:
        return displacements(cut, trajectory, flow, camera, samples).astype(np.float32)

    cut = cut_for(trajectory, camera, tolerance, flow)
    found, cols = offsets(cut), camera.intrinsics.cols
    while not frame.fits(found, widest(cut), pixels.shape[2]) and 2 * len(cut) * NARROWEST <= cols:
        cut = cut_for(trajectory, camera, tolerance, flow, least=2 * len(cut))
        found = offsets(cut)
    weights = frame.Weights(rho=TV_RHO, floor=TV_FLOOR, ahead=TV_AHEAD, overlap=OVERLAP, rim=RIM)
    return frame.DeviceFrame(cut, found, pixels, clipped, weights)


def widest(cut: list[Tile]) -> int:
    """Columns that a tile reads at most."""
    return max(tile.last - tile.first for tile in cut)


def eliminated(
    offsets: Float[np.ndarray, "tiles rows samples 2"],
    frames: list[Float[np.ndarray, "rows cols"]],
    valid: list[Float[np.ndarray, "rows cols"]],
    *,
    ridge: float,
    floor: float,
    completions: int,
) -> Eliminated:
    """The latent images of a scene's tiles, for measures of them and their derivatives."""
    from rsvideo.gpu import sparsity

    return sparsity.Eliminated(offsets.astype(np.float32), frames, valid, ridge=ridge, floor=floor, completions=completions)


def box(images: Any, window: int) -> Any:
    """The mean over a window about each pixel of images that lie on the GPU, 0 beyond them."""
    from rsvideo.gpu import sparsity

    return sparsity.box(images, window)


def inside(widths: Sequence[int], rows: int, cols: int) -> Any:
    """1 within so many columns of each image on the GPU, (images, rows, cols), 0 beyond."""
    from rsvideo.gpu import sparsity

    return sparsity.inside(widths, rows, cols)


def gaussian(image: Float[np.ndarray, "rows cols"], sigma: float) -> Float[np.ndarray, "rows cols"]:
    """An image of the host's under a Gaussian, which the GPU computes."""
    from rsvideo.gpu import arrays, resampling

    return arrays.to_host(resampling.blurred(arrays.xp.asarray(image), sigma))


def picture(latent: Float[np.ndarray, "rows cols channels"], lift: float, sigma: float) -> Any:
    """A latent image on the GPU, and as it is compared with others: the root of its lifted grey under a Gaussian of `sigma` px."""
    from rsvideo.gpu import fusion

    return fusion.picture(latent, lift, sigma)


def neighbour(first: Any, other: Any, drift: Float[np.ndarray, "high wide 2"], spacing: int, **how: Any) -> Any:
    """A picture beside that of a frame, `drift` px from it at nodes `spacing` px apart; `how` both are compared, see `alignment`."""
    from rsvideo.gpu import fusion

    return fusion.Neighbour(first, other, drift, spacing, fusion.Comparison(**how))


def fusion(frame: Any, first: Any, weights: Float[np.ndarray, "rows cols"], noise: float, error: float, **how: Any) -> Any:
    """The weighted mean of a frame's picture and of others; `how` they count, see `fusion`."""
    from rsvideo.gpu import fusion

    return fusion.Fusion(frame, first, weights, noise, error, **how)


def straightened(
    pixels: Float[np.ndarray, "rows cols channels"],
    drift: Float[np.ndarray, "high wide 2"] | None,
    spacing: tuple[int, int],
    moved: float,
    latent: tuple[Float[np.ndarray, "rows cols channels"], Any, int, float] | None,
) -> Float[np.ndarray, "rows cols channels"]:
    """`moved` of a frame sampled `drift` px away, at nodes `spacing` px apart, if it drifts; mixed with a latent image by its share.

    The latent image is held so many px from the borders, beside what is as bright as a lamp.
    """
    from rsvideo.gpu import resampling

    return resampling.straightened(pixels, drift, spacing, moved, latent)


def to_host(image: Any) -> np.ndarray:
    """A copy of such an array in the host's memory."""
    from rsvideo.gpu import arrays

    return arrays.to_host(image)
