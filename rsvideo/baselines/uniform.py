"""One kernel for the whole frame, blind, after Cho & Lee (SIGGRAPH Asia 2009): strong edges, Fourier transforms, coarse to fine.

The estimator is the one that finds the kernels of strips (restoration.blind_kernel), and the latent image is solved for as
along a trajectory, with the same denoiser, unknown borders and clipped pixels left out.
"""

import time

import numpy as np
from jaxtyping import Bool, Float

from rsvideo.baselines.kernel_verdict import believed
from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics import tiles
from rsvideo.physics.tiles import Tile
from rsvideo.physics.trajectory import still
from rsvideo.restoration import nonblind, psf_fit, scanlines
from rsvideo.restoration.blind_kernel import FULL, SIZES, KernelSettings, border_share, fitted
from rsvideo.restoration.kernel_search import SHARP_KERNEL
from rsvideo.restoration.scanlines import View
from rsvideo.restoration.scene import Scene, scene_of, windowed
from rsvideo.restoration.settings import Settings

KERNELS = KernelSettings(  # one kernel explains all of the frame, so it can be found more sharply than a strip's; by trial on 16 of Levin's
    ridge=0.002, sparsity=1.0, last_sparsity=0.3, finest_steps=10, floor=0.02, piece=0.1, border=True
)


def restored(view: View, settings: Settings) -> FrameResult:
    """The latent image of a frame under one kernel; where that is no blur, or the frame does not bear it out, the frame as it was."""
    started = time.monotonic()
    scene = scene_of(view, settings)
    latent = psfs = None
    verdict, kernel = _first_kernel(scene)
    if verdict is Verdict.RESTORED:
        if border_share(kernel) >= FULL and SIZES[1:]:
            kernel = fitted(windowed(scene).frame, SIZES[1:], KERNELS)
        if not believed(scene, kernel):
            verdict = Verdict.UNEXPLAINED
    if verdict is Verdict.RESTORED:
        psfs = kernel[None, None]
        latent = deconvolved(view.pixels, view.clipped, kernel, settings, view.noise)
    return finished(view, latent, psfs, verdict, started)


def verdict_before(scene: Scene) -> Verdict:
    """Whether there is texture to measure blur by, and blur."""
    return _first_kernel(scene)[0]


def _first_kernel(scene: Scene) -> tuple[Verdict, Float[np.ndarray, "k k"]]:
    """The same, and the frame's kernel at the smallest size.

    A sharp frame has a short kernel by the settings of strips or by those of a whole frame, seldom by both.
    """
    if not scene.textured:
        return Verdict.NO_TEXTURE, np.ones((1, 1), np.float32)
    part = windowed(scene).frame
    as_strip, kernel = (fitted(part, SIZES[:1], settings) for settings in (KernelSettings(), KERNELS))
    sharp = min(psf_fit.length(as_strip), psf_fit.length(kernel)) < SHARP_KERNEL
    return Verdict.SHARP if sharp else Verdict.RESTORED, kernel


def deconvolved(
    pixels: Float[np.ndarray, "rows cols channels"],
    clipped: Bool[np.ndarray, "rows cols channels"],
    kernel: Float[np.ndarray, "k k"],
    settings: Settings,
    noise: float,
) -> Float[np.ndarray, "rows cols channels"]:
    """The latent image under one given kernel."""
    rows, cols = pixels.shape[:2]
    offsets, weights = samples(kernel)
    shape = (rows, len(weights))

    def everywhere(_: Tile) -> tuple[np.ndarray, np.ndarray]:
        return np.broadcast_to(offsets, (*shape, 2)), np.broadcast_to(weights, shape)

    return solved(nonblind.tiled_from(tiles.split(cols, 1, 0), everywhere, pixels, clipped), settings, noise)


def samples(kernel: Float[np.ndarray, "k k"]) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """Where a pixel blurred with `kernel` samples the latent image, and how much of each sample it holds."""
    half = len(kernel) // 2
    y, x = np.nonzero(kernel)
    return np.stack([half - x, half - y], axis=-1).astype(float), kernel[y, x].astype(float)


def solved(blurred: nonblind.TiledFrame, settings: Settings, noise: float) -> Float[np.ndarray, "rows cols channels"]:
    """The latent image as `restoration.single_frame` solves for it."""
    *_, latent = nonblind.deblur(blurred, settings, noise)
    return latent


def finished(
    view: View,
    latent: Float[np.ndarray, "rows cols channels"] | None,
    psfs: Float[np.ndarray, "down across k k"] | None,
    verdict: Verdict,
    started: float,
) -> FrameResult:
    """The result of a method that knows kernels and no path; without a latent image, the frame as it was."""
    rest = still(view.source_camera.timing.interval, degree=1, axes=2)
    return scanlines.result(view, trajectory=rest, verdict=verdict, latent=latent, psfs=psfs, seconds=time.monotonic() - started)
