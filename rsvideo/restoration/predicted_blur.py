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
_Sums = np.ndarray | np.float64  # about each pixel, or over the frame
_NO_BLUR = 1e-12  # of |K t - D t|^2, up to which a path predicts no blur


@dataclass(frozen=True, kw_only=True, eq=False)
class Predicted:
    """A frame beside what its path and its neighbours predict of it; grey, along the scanlines."""

    observed: Float[np.ndarray, "rows cols"]  # b
    target: Float[np.ndarray, "rows cols"]  # t
    blurred: Float[np.ndarray, "rows cols"]  # K t
    displaced: Float[np.ndarray, "rows cols"]  # D t
    shown: Bool[np.ndarray, "rows cols"]  # where neighbours show the place, and b is not clipped


@dataclass(frozen=True, kw_only=True, eq=False)
class Confirmed:
    """beta over a frame, and a standard error more: what noise hides does not speak against the path."""

    about: Float[np.ndarray, "rows cols"]  # each pixel; 1 where no neighbour shows the place
    whole: float  # 1 where neighbours show nothing, or the path predicts no blur


def confirmed(predicted: Predicted) -> Confirmed:
    """beta of a frame."""
    weight = predicted.shown.astype(np.float32)
    apart, blur = weight * (predicted.observed - predicted.displaced), weight * (predicted.blurred - predicted.displaced)
    products = apart * blur, blur**2, apart**2, weight
    about = _beta(*(cv2.boxFilter(each, -1, (REGION, REGION), normalize=False, borderType=cv2.BORDER_CONSTANT) for each in products))
    whole = _beta(*(each.sum(dtype=np.float64) for each in products))
    return Confirmed(about=np.where(predicted.shown, about, 1).astype(np.float32), whole=float(whole))


def _beta(together: _Sums, power: _Sums, apart: _Sums, count: _Sums) -> np.ndarray:
    """beta and its standard error together, from <b - D t, K t - D t>, |K t - D t|^2, |b - D t|^2 and how many pixels they hold."""
    blur = np.maximum(power, _NO_BLUR)
    left = np.maximum(apart - together**2 / blur, 0)
    return np.where(power > _NO_BLUR, together / blur + np.sqrt(left / (blur * INDEPENDENT * np.maximum(count, 1))), 1)
