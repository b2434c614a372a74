"""One kernel for the whole frame, blind, after Cho & Lee (SIGGRAPH Asia 2009): strong edges, Fourier transforms, coarse to fine.

The estimator is the one that finds the kernels of strips (restoration.blind_kernel), and the latent image is solved for as
along a trajectory, with the same denoiser, unknown borders and clipped pixels left out.
"""

import time

import numpy as np
from jaxtyping import Bool, Float

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics import tiles
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.tiles import Tile
from rsvideo.physics.trajectory import still
from rsvideo.restoration import nonblind, psf_fit, single_frame
from rsvideo.restoration.blind_kernel import FULL, SIZES, KernelSettings, border_share, fitted
from rsvideo.restoration.single_frame import Settings, View
from rsvideo.restoration.sparsity import Scene

KERNELS = KernelSettings(  # one kernel explains all of the frame, so it can be told more sharply than a strip's
    ridge=0.002, sparsity=1.0, last_sparsity=0.3, finest_steps=10, floor=0.02, piece=0.1, border=True
)


def restored(frame: Frame, timing: ShutterTiming, settings: Settings, *, timing_source: str = "explicit") -> FrameResult:
    """The latent image of `frame` under one kernel; where that is no blur, or nothing tells it, the frame as it was."""
    started = time.monotonic()
    view, scene = seen(frame, timing, settings)
    latent = psfs = None
    verdict, kernel = _looked_at(scene)
    if verdict is Verdict.RESTORED:
        if border_share(kernel) >= FULL and SIZES[1:]:
            kernel = fitted(single_frame.windowed(scene, single_frame.WINDOW_COLS).frame, SIZES[1:], KERNELS)
        psfs = kernel[None, None]
        latent = deconvolved(view.frame.pixels, view.frame.clipped, psfs[0, 0], settings, view.noise)
    return finished(frame, timing, timing_source, latent, psfs, verdict, started)


def seen(frame: Frame, timing: ShutterTiming, settings: Settings) -> tuple[View, Scene]:
    """The frame along its scanlines, and its luminance as kernels are estimated from it."""
    rows, cols = frame.pixels.shape[:2]
    view = single_frame.along_scanlines(
        frame, timing, Intrinsics.centred(focal=float(max(rows, cols)), rows=rows, cols=cols)
    )  # shifts know no lens
    return view, single_frame.observed(view.frame, view.timing, view.intrinsics, settings)


def verdict_before(scene: Scene) -> Verdict:
    """Whether there is texture to measure blur by, and blur."""
    return _looked_at(scene)[0]


def _looked_at(scene: Scene) -> tuple[Verdict, Float[np.ndarray, "k k"]]:
    """The same, and the frame's kernel at the smallest size.

    Sharp frames are seen as such by strips' settings or by those of a whole frame, seldom by both.
    """
    if scene.gradient_power < max(1e-7, 8 * scene.noise**2):
        return Verdict.NO_TEXTURE, np.ones((1, 1), np.float32)
    part = single_frame.windowed(scene, single_frame.WINDOW_COLS).frame
    strips_own, kernel = (fitted(part, SIZES[:1], settings) for settings in (KernelSettings(), KERNELS))
    sharp = min(psf_fit.length(strips_own), psf_fit.length(kernel)) < single_frame.SHARP_KERNEL
    return Verdict.SHARP if sharp else Verdict.RESTORED, kernel


def deconvolved(
    pixels: Float[np.ndarray, "rows cols channels"],
    clipped: Bool[np.ndarray, "rows cols channels"],
    kernel: Float[np.ndarray, "k k"],
    settings: Settings,
    noise: float,
) -> Float[np.ndarray, "rows cols channels"]:
    """The latent image under one known kernel."""
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
    """The latent image as `blind.restore` solves for it."""
    *_, latent = nonblind.deblur(blurred, prior=settings.prior, mu=settings.mu_final if settings.prior == "tv" else 5e-4, noise=noise)
    return latent


def finished(
    frame: Frame,
    timing: ShutterTiming,
    timing_source: str,
    latent: Float[np.ndarray, "scanlines along channels"] | None,
    psfs: Float[np.ndarray, "down across k k"] | None,
    verdict: Verdict,
    started: float,
) -> FrameResult:
    """The result in the image's own axes; without a latent image, the frame as it was."""
    way = timing.direction
    if psfs is not None:
        psfs = np.array([[way.image(kernel) for kernel in row] for row in way.image(psfs)])
    return FrameResult(
        frame=frame,
        timing=timing,
        timing_source=timing_source,
        trajectory=still(timing.interval, degree=1, axes=2),
        latent=frame.pixels if latent is None else np.ascontiguousarray(way.image(latent)),
        verdict=verdict,
        seconds=time.monotonic() - started,
        psfs=psfs,
    )
