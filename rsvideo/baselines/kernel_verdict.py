"""Whether a frame bears out the kernel that was found for it, by the evidence that paths are judged by (restoration.evidence).

Gradients of the latent image are sparser under the true kernel than under its mirror image, and than under the same kernel smaller and
larger. A wrong kernel leaves ringing, mirrored or not, larger or smaller.
"""

import cv2
import numpy as np
from jaxtyping import Float

from rsvideo.restoration.blind_kernel import ridge_latent
from rsvideo.restoration.evidence import FOCUS_RIDGE, MIRROR_RIDGES, POWER, STRETCH, certainty
from rsvideo.restoration.scene import Scene, windowed
from rsvideo.restoration.sparsity import relative_gradients
from rsvideo.restoration.verdict import FOCUS

MIRROR = 2.0  # standard errors, which a kernel must exceed: its mirror image is not led as closely as a path's is
FAINT = 0.05  # of a kernel's largest value: what is fainter does not count for its length
PARTS = 4  # of a pixel, across and down, when a kernel is stretched
BORDER = 16  # px along a frame's sides, a quarter at most, where latent images ring, that are not measured


def believed(scene: Scene, kernel: Float[np.ndarray, "k k"]) -> bool:
    """Whether gradients speak for the kernel."""
    mirror, focus = compared(scene, kernel)
    return mirror > MIRROR and focus > FOCUS


def compared(scene: Scene, kernel: Float[np.ndarray, "k k"]) -> tuple[float, float]:
    """The standard errors by which gradients are sparser than under the mirrored kernel, and than under the kernel smaller and larger."""
    frame = windowed(scene).frame
    inner = tuple(slice(border, side - border) for side in frame.shape for border in (min(BORDER, side // 4),))

    def sparse(kernel: Float[np.ndarray, "k k"], ridge: float) -> tuple[np.ndarray, np.ndarray]:
        latent = ridge_latent(frame, kernel, ridge * scene.ridge)
        return relative_gradients(latent[inner], frame[inner], scene.gradient_power, POWER)

    mirrored = np.ascontiguousarray(kernel[::-1, ::-1])
    mirror = []
    for ridge in MIRROR_RIDGES:
        (own, weight), (other, _) = sparse(kernel, ridge), sparse(mirrored, ridge)
        mirror.append(certainty(other - own, weight))
    factor = 1 + STRETCH / length(kernel)
    (own, weight), (larger, _), (smaller, _) = (sparse(stretched(kernel, times), FOCUS_RIDGE) for times in (1.0, factor, 1 / factor))
    return float(np.mean(mirror)), certainty((larger + smaller) / 2 - own, weight)


def length(kernel: Float[np.ndarray, "k k"]) -> int:
    """How many px a kernel reaches over, across or down."""
    return 1 + max(int(np.ptp(along)) for along in np.nonzero(kernel > FAINT * kernel.max()))


def stretched(kernel: Float[np.ndarray, "k k"], times: float) -> Float[np.ndarray, "n n"]:
    """The kernel `times` as large about its middle, of sum 1; what a part of a pixel holds is shared by the next two, across and down."""
    half = len(kernel) // 2
    wide = int(np.ceil(half * max(times, 1))) + 1
    parts = cv2.resize(kernel, None, fx=PARTS, fy=PARTS, interpolation=cv2.INTER_LINEAR)
    places = times * ((np.arange(len(parts)) + 0.5) / PARTS - 0.5 - half)
    shares = np.maximum(1 - np.abs(np.arange(-wide, wide + 1)[:, None] - places), 0).astype(np.float32)
    scaled = shares @ parts @ shares.T
    return scaled / scaled.sum()
