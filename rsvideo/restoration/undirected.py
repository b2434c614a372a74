"""A frame whose blur does not tell the direction of the camera: deblurred, its scanlines left where the shutter read them.

A path and its mirror image, the same lines run backwards, blur a frame nearly alike, and displace its scanlines to opposite sides. What
both agree on is the sharp picture as a rolling shutter reads it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from rsvideo.physics.tone import Transfer, encode
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.rectification import read_out, scanline_poses
from rsvideo.restoration.scanlines import View

WORTH = 2.0  # dB of `gain`; along the true paths of 37 stills, 1.5 and 3 choose nearly the same ones, of which none loses
SIDE = 16  # px along a frame's sides, a quarter at most, that do not count


@dataclass(frozen=True, kw_only=True, eq=False)
class Read:
    """The sharp picture as the rolling shutter reads it."""

    latent: Float[np.ndarray, "rows cols channels"]
    gain: float  # dB by which it is nearer than the blurred frame to the latent image that it was made of

    @property
    def worth(self) -> bool:
        """Whether it will be nearer to the truth, whichever direction is right."""
        return self.gain >= WORTH


def read(view: View, path: Trajectory, latent: Float[np.ndarray, "rows cols channels"]) -> Read:
    """The latent image of `path`, which is along the scanlines, with these where the shutter read them.

    To be sharp and displaced may be worse than to be blurred and displaced: the sharper an edge that lies beside its place, the more it
    differs. Which it is hardly depends on the path's direction.
    """
    camera = view.camera
    poses = scanline_poses(path, camera)
    displaced, placed = (read_out(latent, each, camera) for each in (poses, np.broadcast_to(poses.mean(axis=0), poses.shape)))
    ratio = _distance(view.pixels, placed) / max(_distance(displaced, placed), float(np.finfo(np.float32).tiny))
    return Read(latent=displaced, gain=float(10 * np.log10(max(ratio, float(np.finfo(np.float32).tiny)))))


def _distance(one: Float[np.ndarray, "rows cols channels"], other: Float[np.ndarray, "rows cols channels"]) -> float:
    """The mean square of their difference, in codes of sRGB, as eyes weigh light."""
    rows, cols = (slice(side, n - side) for n in one.shape[:2] for side in (min(SIDE, n // 4),))
    codes = [encode(Transfer.SRGB, np.clip(np.ascontiguousarray(image[rows, cols]), 0, 1).astype(np.float32)) for image in (one, other)]
    return float(((codes[0] - codes[1]) ** 2).mean())
