"""How noisy a picture is, measured where it is quiet."""

import math

import cv2
import numpy as np
from jaxtyping import Float
from numpy.lib.stride_tricks import sliding_window_view
from scipy import fft

BLOCK = 32  # px, the side of a block; origin: by trial
MOST = 1500  # blocks, about as many as are looked at
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
    size = np.abs(high)
    blocks = _blocks(size, BLOCK) if min(size.shape) >= BLOCK else size.reshape(1, -1)
    return float(np.percentile(_medians(blocks.reshape(len(blocks), -1)), QUIET)) / MEDIAN_DEVIATION


def _medians(values: Float[np.ndarray, "blocks n"]) -> Float[np.ndarray, " blocks"]:
    """Of each block: sorted in a sixth of the time that NumPy takes to find medians."""
    count = values.shape[1]
    return np.sort(values, axis=1)[:, [(count - 1) // 2, count // 2]].mean(axis=1)


def _blocks(image: Float[np.ndarray, "rows cols"], step: int) -> Float[np.ndarray, "blocks n n"]:
    """Blocks of BLOCK px a side, one every `step` px; of a large picture about MOST, which lie as far apart."""
    step *= max(1, math.isqrt(image.size // (MOST * step**2)))
    return sliding_window_view(image, (BLOCK, BLOCK))[::step, ::step].reshape(-1, BLOCK, BLOCK)


def _coarse_noise(image: Float[np.ndarray, "rows cols"]) -> float:
    """From wavelengths of 3 to 6 px, which a camera's own denoising and JPEG leave grainy and deblurring amplifies most.

    Texture is there too, but blurred texture has a direction: what counts is the least of eight, less where they differ.
    """
    if min(image.shape) < BLOCK:
        return 0.0
    blocks = _blocks(image, BLOCK // 2)
    window = np.outer(np.hanning(BLOCK), np.hanning(BLOCK)).astype(np.float32)
    spectra = np.abs(np.asarray(fft.rfft2((blocks - blocks.mean(axis=(1, 2), keepdims=True)) * window))) ** 2 / (window**2).sum()
    y, x = fft.fftfreq(BLOCK)[:, None], fft.rfftfreq(BLOCK)
    ring = (np.hypot(x, y) > 1 / LONGEST_WAVE) & (np.hypot(x, y) < 1 / SHORTEST_WAVE)
    sector = np.round(np.arctan2(y, x) * SECTORS / np.pi).astype(int) % SECTORS
    power = [np.percentile(spectra[:, ring & (sector == s)].mean(axis=1), QUIET_COARSE) for s in range(SECTORS)]
    return float(np.sqrt(min(power)) * min(power) / max(*power, _LEAST_POWER))
