"""Blind deconvolution of an image by one kernel: coarse to fine, with hard-thresholded gradients.

The latent image follows Xu, Zheng & Jia (CVPR 2013): half-quadratic splitting of an L0 penalty on gradients. The
kernel is a non-negative quadratic program on the latent gradients' autocorrelation. The ridge on the kernel is
relative to that autocorrelation at zero, and the L0 weight to the image's own gradients; both stay constant over the
scales, or the kernel collapses towards a point.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
import scipy.fft
from jaxtyping import Complex, Float, Inexact

SIZES = (31, 47, 69)  # tried in turn while the blur fills the smaller one
FULL = 0.02  # a kernel with more than this share of its mass at its border needs a larger one; origin: by trial
RIM = 10  # its border is the outermost 1 / RIM of its width
SMALLEST = 5  # px, the kernel at the pyramid's top
BORDER_IMAGES = 8  # kernels that fit along an image whose sides can be left out
PROGRAM_STEPS = 150  # of projected gradients; origin: by trial
EIGENVALUE_STEPS = 12  # of the power method, and SAFE times what it finds, as it comes from below
SAFE = 1.05
_LEAST_POWER = 1e-12  # of gradients; a picture without any divides by this
_SMALLEST_SIDE = 8  # px of a picture in the pyramid


@dataclass(frozen=True, kw_only=True)
class KernelSettings:
    """How a uniform kernel is estimated."""

    ridge: float = 0.2  # of the kernel, relative to the gradients' autocorrelation at zero; with 0.005 kernels collapse towards a point
    sparsity: float = 2.0  # weight of the L0 penalty, in mean squares of the image's gradients; falling weights collapse kernels too
    last_sparsity: float = 2.0  # where it ends, falling evenly over the finest scale's alternations
    steps: int = 5  # alternations a scale
    finest_steps: int = 5  # at the finest
    finest_beta: float = 1e4  # where half-quadratic splitting ends
    beta_factor: float = 2.0
    floor: float = 0.05  # kernel values below this share of its largest are noise
    border: bool = False  # leave out, at the finest scale and of images 8 times as large, half a kernel along the sides
    piece: float = 1.0  # pieces apart from the main one are noise below this share of the whole


def l0_latent(
    image: Float[np.ndarray, "rows cols"], kernel: Float[np.ndarray, "k k"], weight: float, settings: KernelSettings
) -> Float[np.ndarray, "rows cols"]:
    """argmin_l |k * l - b|^2 + weight |grad l|_0 by half-quadratic splitting; the image is periodic."""
    shape = image.shape
    data, power = _normal_equations(image, kernel)
    laplacian = _laplacian(shape)
    latent, beta = image, np.float32(2 * weight)
    while beta < settings.finest_beta:
        gx, gy = np.roll(latent, -1, 1) - latent, np.roll(latent, -1, 0) - latent
        keep = gx * gx + gy * gy >= weight / beta
        gx *= keep
        gy *= keep
        divergence = np.roll(gx, 1, 1) - gx + np.roll(gy, 1, 0) - gy
        latent = _image((data + beta * _spectrum(divergence)) / (power + beta * laplacian), shape)
        beta = np.float32(beta * settings.beta_factor)
    return latent


def ridge_latent(image: Float[np.ndarray, "rows cols"], kernel: Float[np.ndarray, "k k"], ridge: float) -> Float[np.ndarray, "rows cols"]:
    """argmin_l |k * l - b|^2 + ridge |grad l|^2 of an image that is made periodic beyond its sides."""
    joined = wrapped(image, 2 * len(kernel))
    data, power = _normal_equations(joined, kernel)
    latent = _image(data / (power + np.float32(ridge) * _laplacian(joined.shape)), joined.shape)
    return latent[: image.shape[0], : image.shape[1]]


@dataclass(frozen=True, kw_only=True, eq=False)
class Observation:
    """What a kernel is estimated from: an image joined to its own other side, and its gradients where it is itself."""

    image: Float[np.ndarray, "rows cols"]
    inside: Float[np.ndarray, "rows cols"]  # 1 on the image, 0 on what joins it
    trusted: Float[np.ndarray, "rows cols"]  # 1 where the latent image determines the kernel
    gradients: list[Float[np.ndarray, "rows cols"]]  # of the image; 0 elsewhere

    @property
    def mean_square(self) -> float:
        """Of the gradients."""
        return float(sum((d * d).sum() for d in self.gradients) / self.inside.sum())


def observation(image: Float[np.ndarray, "rows cols"], margin: int, *, border: int = 0) -> Observation:
    """The image with room for a blur of `margin` px, trusted from `border` px inside its sides."""
    padded = wrapped(image, margin)
    inside = np.zeros(padded.shape, np.float32)
    inside[: image.shape[0], : image.shape[1]] = 1
    inside = cv2.erode(inside, np.ones((3, 3)), borderValue=0)
    trusted = cv2.erode(inside, np.ones((2 * border + 1, 2 * border + 1)), borderValue=0)
    return Observation(image=padded, inside=inside, trusted=trusted, gradients=[d * inside for d in _gradients(padded)])


def strong_gradients(
    observed: Observation, kernel: Float[np.ndarray, "k k"], weight: float, settings: KernelSettings
) -> list[Float[np.ndarray, "rows cols"]]:
    """The latent image's gradients where they are worth their L0 penalty; all of them where none is."""
    latent = _gradients(l0_latent(observed.image, kernel, weight, settings))
    keep = observed.trusted * (latent[0] ** 2 + latent[1] ** 2 > weight)
    if not keep.any():
        keep = observed.inside
    return [g * keep for g in latent]


def kernel_from_gradients(
    blurred: list[Float[np.ndarray, "rows cols"]], latent: list[Float[np.ndarray, "rows cols"]], size: int, settings: KernelSettings
) -> Float[np.ndarray, "size size"]:
    """argmin_k sum |k * g - h|^2 + ridge |k|^2 over k >= 0, sum k = 1, for pairs of gradient images (h, g)."""
    matrix, linear, zero = correlations(blurred, latent, size)
    matrix, linear = matrix / zero, linear / zero
    matrix[np.diag_indices(size * size)] += settings.ridge
    return simplex_program(matrix, linear).reshape(size, size)


def correlations(
    blurred: list[Float[np.ndarray, "rows cols"]], latent: list[Float[np.ndarray, "rows cols"]], size: int
) -> tuple[Float[np.ndarray, "n n"], Float[np.ndarray, " n"], float]:
    """A and c of sum |k * g - h|^2 = k^T A k - 2 c^T k + const over the n = size^2 values of k, and A's diagonal."""
    shape = latent[0].shape
    power = np.zeros((shape[0], shape[1] // 2 + 1), np.float32)
    cross = np.zeros(power.shape, np.complex64)
    for h, g in zip(blurred, latent, strict=True):
        spectrum = _spectrum(g)
        power += np.abs(spectrum) ** 2
        cross += spectrum.conj() * _spectrum(h)
    half = size // 2
    auto = np.roll(_image(power, shape), (size - 1, size - 1), (0, 1))[: 2 * size - 1, : 2 * size - 1]
    linear = np.roll(_image(cross, shape), (half, half), (0, 1))[:size, :size]
    index = np.arange(size)
    offset = index[:, None] - index[None] + size - 1
    matrix = auto[offset[:, None, :, None], offset[None, :, None, :]].reshape(size * size, size * size)
    return matrix.astype(np.float32), linear.ravel().astype(np.float32), max(float(auto[size - 1, size - 1]), _LEAST_POWER)


def simplex_program(matrix: Float[np.ndarray, "n n"], linear: Float[np.ndarray, " n"]) -> Float[np.ndarray, " n"]:
    """argmin x^T A x / 2 - c^T x over x >= 0 by accelerated projected gradients, then scaled to sum 1."""
    v, largest = np.ones(len(linear), np.float32), 0.0
    for _ in range(EIGENVALUE_STEPS):  # largest eigenvalue by the power method
        v = matrix @ v
        largest = float(np.linalg.norm(v))
        v /= largest
    x = y = np.full(len(linear), 1 / len(linear), np.float32)
    t = 1.0
    for _ in range(PROGRAM_STEPS):
        new = np.maximum(y - (matrix @ y - linear) / (SAFE * largest), 0)
        if float((y - new) @ (new - x)) > 0:
            t = 1.0  # restart, O'Donoghue & Candes 2015
        after = 0.5 * (1 + np.sqrt(1 + 4 * t * t))
        y = new + np.float32((t - 1) / after) * (new - x)
        x, t = new, after
    total = float(x.sum())
    return x / total if total > 0 else np.full(len(linear), 1 / len(linear), np.float32)


def clean(kernel: Float[np.ndarray, "k k"], floor: float, piece: float = 1.0) -> Float[np.ndarray, "k k"]:
    """The kernel without its noise floor and without small pieces apart from the main one, centred, of sum 1."""
    kept = np.where(kernel >= floor * kernel.max(), kernel, 0).astype(np.float32)
    count, labels = cv2.connectedComponents((kept > 0).astype(np.uint8), connectivity=8)
    if count > 2:
        mass = np.bincount(labels.ravel(), kept.ravel(), count) / kept.sum()
        mass[0] = 0
        kept *= np.isin(labels, np.flatnonzero(mass >= piece).tolist() or [np.argmax(mass)])
    return centre(kept / kept.sum())


def centre(kernel: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "k k"]:
    """The kernel moved by whole pixels so that its centroid lies in the middle."""
    half = (np.array(kernel.shape) - 1) / 2
    y, x = np.indices(kernel.shape)
    shift = np.round(half - np.array([(kernel * y).sum(), (kernel * x).sum()]) / kernel.sum()).astype(int)
    moved = np.zeros_like(kernel)
    source = [slice(max(0, -s), n - max(0, s)) for s, n in zip(shift, kernel.shape, strict=True)]
    target = [slice(max(0, s), n - max(0, -s)) for s, n in zip(shift, kernel.shape, strict=True)]
    moved[tuple(target)] = kernel[tuple(source)]
    return moved / moved.sum()


def estimate(image: Float[np.ndarray, "rows cols"], size: int, settings: KernelSettings) -> Iterator[Float[np.ndarray, "k k"]]:
    """The kernel after each scale of a pyramid of sqrt(2), coarse to fine; the last is `size` x `size` (odd)."""
    sizes = [size]
    while sizes[-1] > SMALLEST:
        sizes.append(2 * round(sizes[-1] / np.sqrt(2) / 2 - 0.25) + 1 if sizes[-1] > SMALLEST + 2 else sizes[-1] - 2)
    kernel = None
    for k in reversed(sizes):
        scale = k / size
        scaled = _resized(image, scale)
        if kernel is None:
            kernel = np.zeros((k, k), np.float32)
            kernel[k // 2, k // 2 - 1 : k // 2 + 2] = 1 / 3
        else:
            kernel = np.maximum(cv2.resize(kernel, (k, k), interpolation=cv2.INTER_LINEAR), 0)
            kernel = centre(kernel / kernel.sum())
        away = settings.border and k == size and BORDER_IMAGES * k <= min(image.shape)  # there the image holds but a part of the blur
        observed = observation(scaled, k, border=k // 2 if away else 0)
        steps = settings.finest_steps if k == size else settings.steps
        fall = settings.last_sparsity / settings.sparsity if k == size else 1.0
        for step in range(steps):
            weight = settings.sparsity * fall ** ((step + 1) / steps) * observed.mean_square
            edges = strong_gradients(observed, kernel, weight, settings)
            kernel = clean(kernel_from_gradients(observed.gradients, edges, k, settings), settings.floor, settings.piece)
        yield kernel


def fitted(image: Float[np.ndarray, "rows cols"], sizes: Sequence[int], settings: KernelSettings) -> Float[np.ndarray, "k k"]:
    """The kernel at the first of `sizes` whose border it does not touch, or at the last; none is larger than half the image."""
    most = (min(image.shape) // 2 - 1) | 1
    kernel = np.ones((1, 1), np.float32)
    for size in sizes:
        *_, kernel = estimate(image, min(size, most), settings)
        if border_share(kernel) < FULL or size >= most:
            break
    return kernel


def border_share(kernel: Float[np.ndarray, "k k"]) -> float:
    """The share of a kernel's mass at its border."""
    rim = max(1, len(kernel) // RIM)
    return 1 - float(kernel[rim:-rim, rim:-rim].sum())


def wrapped(image: Float[np.ndarray, "rows cols"], margin: int) -> Float[np.ndarray, "r c"]:
    """The image extended below and to the right so that it joins its own other side smoothly."""
    rows, cols = (scipy.fft.next_fast_len(n + 2 * margin, real=True) for n in image.shape)
    ramp = np.linspace(0, 1, rows - image.shape[0] + 2, dtype=np.float32)[1:-1, None]
    tall = np.concatenate([image, image[-1:] * (1 - ramp) + image[:1] * ramp])
    ramp = np.linspace(0, 1, cols - image.shape[1] + 2, dtype=np.float32)[None, 1:-1]
    return np.concatenate([tall, tall[:, -1:] * (1 - ramp) + tall[:, :1] * ramp], axis=1)


def _spectrum(image: Float[np.ndarray, "rows cols"]) -> Complex[np.ndarray, "rows frequencies"]:
    return np.asarray(scipy.fft.rfft2(image))


def _image(spectrum: Inexact[np.ndarray, "rows frequencies"], shape: tuple[int, ...]) -> Float[np.ndarray, "rows cols"]:
    return np.asarray(scipy.fft.irfft2(spectrum, shape))


def _normal_equations(
    image: Float[np.ndarray, "rows cols"], kernel: Float[np.ndarray, "k k"]
) -> tuple[Complex[np.ndarray, "rows frequencies"], Float[np.ndarray, "rows frequencies"]]:
    """conj(k) b and |k|^2, by frequency; the image is periodic."""
    k = _spectrum(_centred_at_origin(kernel, image.shape))
    return k.conj() * _spectrum(image), np.abs(k) ** 2


def _laplacian(shape: tuple[int, ...]) -> Float[np.ndarray, "rows frequencies"]:
    """|grad|^2 by frequency."""
    fx = np.abs(1 - np.exp(-2j * np.pi * np.arange(shape[1] // 2 + 1) / shape[1])) ** 2
    fy = np.abs(1 - np.exp(-2j * np.pi * np.arange(shape[0]) / shape[0])) ** 2
    return (fx[None] + fy[:, None]).astype(np.float32)


def _gradients(image: Float[np.ndarray, "rows cols"]) -> list[Float[np.ndarray, "rows cols"]]:
    return [np.roll(image, -1, 1) - image, np.roll(image, -1, 0) - image]


def _resized(image: Float[np.ndarray, "rows cols"], scale: float) -> Float[np.ndarray, "r c"]:
    if scale == 1:
        return image
    size = (max(_SMALLEST_SIDE, round(image.shape[1] * scale)), max(_SMALLEST_SIDE, round(image.shape[0] * scale)))
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA)


def _centred_at_origin(kernel: Float[np.ndarray, "k k"], shape: tuple[int, ...]) -> Float[np.ndarray, "rows cols"]:
    out = np.zeros(shape, np.float32)
    out[: kernel.shape[0], : kernel.shape[1]] = kernel
    return np.roll(out, (-(kernel.shape[0] // 2), -(kernel.shape[1] // 2)), (0, 1))
