"""The luminance of linear light, and the lift under which its square root weighs shadows as eyes do."""

import numpy as np
from jaxtyping import Float

BT709_WEIGHTS = np.array([0.2126, 0.7152, 0.0722], np.float32)  # of red, green and blue; ITU-R BT.709-6, table 4, item 3.2
LIFT = 0.01  # white being 1: sqrt(l + LIFT) weighs shadows as codes and eyes do, and evens out shot noise; origin: by trial


def luminance(pixels: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "rows cols"]:
    """The luminance of three channels by BT.709's weights; the mean of any other number of channels, so a grey picture's own."""
    return pixels @ BT709_WEIGHTS if pixels.shape[2] == 3 else pixels.mean(axis=2)
