"""How much of the blur that a path predicts a frame shows, by what its neighbours show of the scene.

The mean t of the neighbours' latent images, at the frame's pose, is near to the truth where these are sharper than the frame. K t is the
frame as the path predicts it, and D t the same where each scanline is displaced by the mean of its pose, and not blurred. So

    b - D t = beta (K t - D t) + noise,    beta = <b - D t, K t - D t> / |K t - D t|^2

by least squares: 1 along a right path, and 0 where the frame is as sharp as its neighbours. A path of a wrong exposure, or one that turns
back elsewhere, shows in beta though the latent image along it leaves a small residual: that image takes up the error, and t does not.
"""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float

REGION = 25  # px over which beta is measured about a pixel
INDEPENDENT = 1 / 9  # of these pixels, as noise and errors of neighbours go together over some px
_NO_BLUR = 1e-12  # of |K t - D t|^2, by which what predicts no blur is divided


@dataclass(frozen=True, kw_only=True, eq=False)
class Confirmed:
    """beta over a frame."""

    about: Float[np.ndarray, "rows cols"]  # each pixel, and a standard error more; 1 where no neighbour shows the place
    whole: float


def confirmed(
    observed: Float[np.ndarray, "rows cols"],
    blurred: Float[np.ndarray, "rows cols"],
    displaced: Float[np.ndarray, "rows cols"],
    shown: Bool[np.ndarray, "rows cols"],
) -> Confirmed:
    """beta of a frame b that is `observed`, K t and D t; `shown` is where neighbours show the place, and b is not clipped."""
    weight = shown.astype(np.float32)
    apart, predicted = weight * (observed - displaced), weight * (blurred - displaced)

    def summed(image: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
        return cv2.boxFilter(image, -1, (REGION, REGION), normalize=False, borderType=cv2.BORDER_CONSTANT)

    together, power, all_of_it = (summed(image) for image in (apart * predicted, predicted**2, apart**2))
    power = np.maximum(power, _NO_BLUR)
    beta = together / power
    left = np.maximum(all_of_it - beta * together, 0)
    error = np.sqrt(left / (power * INDEPENDENT * np.maximum(summed(weight), 1)))
    whole = float((apart * predicted).sum() / max(float((predicted**2).sum()), _NO_BLUR))
    return Confirmed(about=np.where(shown, beta + error, np.float32(1)), whole=whole)
