"""How noisy a picture is, measured where it is quiet."""

import cv2
import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view

BLOCK = 32  # px, the side of a block; origin: by trial
QUIET = 25  # percentile of the blocks' fine noise that is taken: texture lifts the others; origin: by trial
QUIET_COARSE = 10  # percentile of the blocks' power at coarse wavelengths, where texture is stronger; origin: by trial
SHORTEST_WAVE, LONGEST_WAVE = 3, 6  # px, what deblurring amplifies most, and a camera's own denoising and JPEG leave
SECTORS = 8  # directions that are distinguished: blurred texture lacks some of them, grain has all alike; origin: by trial
MEDIAN_DEVIATION = 0.6745  # the median of |x| of a normal variable with standard deviation 1
_LEAST_POWER = 1e-12  # white being 1: a picture of one colour has no noise, and divides by this


def noise_level(image: Float[np.ndarray, "rows cols"]) -> float:
    """Standard deviation of the noise in the quieter blocks: the larger of its fine part and of its coarse, isotropic part."""
    return max(_fine_noise(image), _coarse_noise(image))


def _fine_noise(image: Float[np.ndarray, "rows cols"]) -> float:
    """From second differences (Immerkaer, Fast noise variance estimation, CVIU 1996), by blocks."""
    mask = np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32) / 6  # whose squares sum to 1
    high = cv2.filter2D(image, -1, mask)[2:-2, 2:-2]
    blocks = [high[i : i + BLOCK, j : j + BLOCK] for i in range(0, high.shape[0], BLOCK) for j in range(0, high.shape[1], BLOCK)]
    return float(np.percentile([np.median(np.abs(b)) / MEDIAN_DEVIATION for b in blocks], QUIET))


def _coarse_noise(image: Float[np.ndarray, "rows cols"]) -> float:
    """From wavelengths of 3 to 6 px, which a camera's own denoising and JPEG leave grainy and deblurring amplifies most.

    Texture is there too, but blurred texture has a direction: what counts is the least of eight, less where they differ.
    """
    blocks = sliding_window_view(image, (BLOCK, BLOCK))[:: BLOCK // 2, :: BLOCK // 2].reshape(-1, BLOCK, BLOCK)
    if not len(blocks):
        return 0.0
    window = np.outer(np.hanning(BLOCK), np.hanning(BLOCK))
    spectra = np.abs(np.fft.rfft2((blocks - blocks.mean(axis=(1, 2), keepdims=True)) * window)) ** 2 / (window**2).sum()
    y, x = np.fft.fftfreq(BLOCK)[:, None], np.fft.rfftfreq(BLOCK)
    ring = (np.hypot(x, y) > 1 / LONGEST_WAVE) & (np.hypot(x, y) < 1 / SHORTEST_WAVE)
    sector = np.round(np.arctan2(y, x) * SECTORS / np.pi).astype(int) % SECTORS
    power = [np.percentile(spectra[:, ring & (sector == s)].mean(axis=1), QUIET_COARSE) for s in range(SECTORS)]
    return float(np.sqrt(min(power)) * min(power) / max(*power, _LEAST_POWER))
