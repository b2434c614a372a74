"""A frame in whose path, or in its length, little confidence is due: restored in part.

Along a path that is wrong, a restoration doubles edges and rings, but a part of it may still bring the frame nearer to the truth, and does
where the path is nearly right. The other part is the frame straightened along the same path, so that edges stay single.

A short path is often longer than the true one, since what a lens has softened counts as motion. Along it, fine detail comes out too strong.
"""

import numpy as np
from jaxtyping import Float

from rsvideo.frame import Verdict
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.rectification import mixed, rectified
from rsvideo.restoration.scanlines import View

PART = 0.6  # of the restoration; 14 stills in doubt gain 2.3 dB with 0.35 in the mean, 3.0 with 0.6, 2.7 with all of it
SHORT = 5.0  # px of the longest blur, below which the part falls with it
LEAST = 0.5  # of the restoration, however short the blur


def share(verdict: Verdict, blur: float) -> float:
    """The part of the restoration along a path that was found, whose longest blur is `blur` px, that is shown."""
    return (PART if verdict is Verdict.DOUBTFUL else 1.0) * float(np.clip(blur / SHORT, LEAST, 1.0))


def restored(
    view: View, path: Trajectory, latent: Float[np.ndarray, "rows cols channels"], part: float
) -> Float[np.ndarray, "rows cols channels"]:
    """So much of the latent image of `path`, which is along the scanlines; the rest is the frame straightened only."""
    return mixed(rectified(view, path).pixels, latent, np.float32(part))
