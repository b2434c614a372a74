"""How well a path explains the power spectra of a frame's patches: the Whittle likelihood of a Gaussian scene.

A latent image's power falls with frequency and may prefer some directions; blur along a path multiplies it by |k(w)|^2, the power of
the PSF, which is dark where the blur leaves nothing. So a patch about scanline r has the expected periodogram

    M_r(w) = exp(beta_r . phi(w)) |k_r(w)|^2 + n,    phi = (1, log |w|, cos 2a, sin 2a, cos 4a),  a the direction of w,

with the noise's power n, and the misfit of a path is the mean over frequencies of log M + S / M, S being what is observed (Whittle
1953). The beta_r are fitted for every path by Fisher scoring. To integrate the latent image out, rather than to choose the best one,
is what keeps short paths from being preferred (Levin et al., CVPR 2009, "Understanding and evaluating blind deconvolution
algorithms"); that spectra alone show motion blur is due to Goldstein & Fattal (ECCV 2012). Power has no phase: a path and its
mirror image, which is the same line run backwards, are alike here, and the sparsity f has to tell them apart.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Complex, Float

from rsvideo.physics.camera import lever
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.scene import Scene

SIDE = 64  # px of a patch
STRIPS = 9  # rows of patches over the frame's scanlines
STEP = 32  # px between patches of a strip, and a quarter of it, up and down, between the rows that a strip joins
SHARPEST = 0.4  # of a strip's patches, those with most power between MIDDLE's bounds: out of focus, a patch shows a blur of its own
MIDDLE = 0.5, 1.6  # rad a px
LOWEST, HIGHEST = 2.0, 2.1  # frequencies that count: in periods a patch, whose window blurs lower ones; in rad a px, JPEG thins higher ones
FEWEST = 3  # patches of a strip
VALID = 0.98  # of a patch's pixels are not clipped
CONTRAST = 4.0  # times the noise's variance, which a patch must exceed
LEAK = 2e-3  # of |k|^2, that the patches' window lets through where the blur is dark
SAMPLES = 20  # path samples an exposure
LINES = -14.0, 0.0, 14.0  # scanlines about a strip's middle that stand for it
SIDES = 0.2, 0.8  # of the frame's width: columns that stand for a strip under roll
FALL, FALL_SPREAD = -1.1, 0.25  # of log |w|^2, and its standard deviation; photographs' power falls with about |w|^-2.2
DIRECTED = 0.3  # standard deviation of how much the power prefers directions
BELIEF = 5e-3  # weight of what is believed of the beta, beside a frequency's likelihood
SCORINGS, LONGEST_STEP = 7, 1.5  # steps of Fisher scoring, and how far a step may lead


_ALL_DOWN, _ALL_ACROSS = 2 * np.pi * np.fft.fftfreq(SIDE), 2 * np.pi * np.fft.rfftfreq(SIDE)
_KEPT = np.ix_(np.abs(_ALL_DOWN) < HIGHEST, _ALL_ACROSS < HIGHEST)
_DOWN, _ACROSS = _ALL_DOWN[_KEPT[0].ravel()], _ALL_ACROSS[_KEPT[1].ravel()]  # rad a px
_MAGNITUDE = np.hypot(_DOWN[:, None], _ACROSS[None])


@dataclass(frozen=True, kw_only=True, eq=False)
class Patches:
    """Mean periodograms of a frame's patches, strip by strip, each patch's variance being 1."""

    power: Float[np.ndarray, "strips n half"]
    noise: Float[np.ndarray, " strips"]  # the noise's power
    rows: Float[np.ndarray, " strips"]  # the scanline in the strip's middle
    weight: Float[np.ndarray, " strips"]  # of sum 1


def patches(scene: Scene) -> Patches | None:
    """The spectra of a scene; None where it has no strip of FEWEST textured patches, or is smaller than a patch."""
    rows, cols = scene.frame.shape
    if min(rows, cols) < SIDE:
        return None
    window = np.outer(np.hanning(SIDE + 2)[1:-1], np.hanning(SIDE + 2)[1:-1])
    window /= np.sqrt((window**2).sum())
    middle = np.abs(_MAGNITUDE - np.mean(MIDDLE)) < np.ptp(MIDDLE) / 2
    power, noise, at, count = [], [], [], []
    for centre in np.linspace(SIDE / 2, rows - SIDE / 2, STRIPS):
        found = []
        for top in sorted({int(np.clip(centre - SIDE / 2 + d, 0, rows - SIDE)) for d in (-STEP // 2, 0, STEP // 2)}):
            for left in range(0, cols - SIDE + 1, STEP):
                part = np.s_[top : top + SIDE, left : left + SIDE]
                patch = scene.frame[part].astype(float)
                variance = float(patch.var())
                if scene.valid[part].mean() < VALID or variance < CONTRAST * scene.noise**2 + scene.least_texture:
                    continue
                periodogram = np.abs(np.fft.rfft2((patch - (patch * window).sum() / window.sum()) * window)[_KEPT]) ** 2
                found.append((float(periodogram[middle].mean()), periodogram / variance, scene.noise**2 / variance))
        if len(found) < FEWEST:
            continue
        found.sort(key=lambda each: -each[0])
        found = found[: max(FEWEST, int(SHARPEST * len(found)))]
        power.append(np.mean([each[1] for each in found], axis=0))
        noise.append(np.mean([each[2] for each in found]))
        at.append(centre)
        count.append(len(found))
    if not power:
        return None
    return Patches(power=np.array(power), noise=np.array(noise), rows=np.array(at), weight=np.array(count) / sum(count))


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """The misfit of paths of one kind to the spectra of a scene."""

    scene: Scene
    patches: Patches
    curve: Trajectory  # of the kind, whatever its coefficients
    basis: Float[np.ndarray, "lines samples terms"] = field(init=False)  # about each scanline's mean, without the constant
    levers: Float[np.ndarray, "lines sides 2 axes"] = field(init=False)

    def __post_init__(self) -> None:
        timing, lens = self.scene.camera.timing, self.scene.camera.intrinsics
        axes = self.curve.coefficients.shape[1]
        lines = (self.patches.rows[:, None] + np.array(LINES)).ravel()
        times = lines[:, None] * timing.row_time + (np.arange(SAMPLES) + 0.5) * (timing.exposure / SAMPLES)
        basis = self.curve.basis(times)[..., 1:]
        columns = np.array(SIDES if axes == 3 else (0.5,)) * lens.cols
        x, y = np.broadcast_arrays(columns[None], lines[:, None])
        object.__setattr__(self, "basis", basis - basis.mean(axis=1, keepdims=True))
        object.__setattr__(self, "levers", lever(lens, x, y, axes) * self.scene.unit(axes))

    def value(self, path: Trajectory) -> float:
        """The misfit of a path."""
        return self.misfit(path.coefficients[1:], slope=False)[0]

    def misfit(self, coefficients: Float[np.ndarray, "unknowns axes"], *, slope: bool = True) -> tuple[float, np.ndarray]:
        """The mean over frequencies of log M + S / M, and its derivative in the coefficients but the constant ones."""
        q = np.einsum("lsp,pa,lcja->lcsj", self.basis, coefficients, self.levers, optimize=True)
        ey = np.exp(1j * q[..., 1, None] * _DOWN).astype(np.complex64)  # (lines, sides, samples, n)
        ex = np.exp(1j * q[..., 0, None] * _ACROSS).astype(np.complex64)
        k = np.matmul(ey.swapaxes(-1, -2), ex) / SAMPLES
        strips, each = len(self.patches.rows), len(LINES) * k.shape[1]
        dark = (np.abs(k) ** 2).reshape(strips, each, *k.shape[2:]).mean(axis=1) + LEAK
        value, by_power = _whittle(self.patches, dark.astype(float))
        if not slope:
            return value, np.zeros_like(coefficients)
        shared = np.repeat(by_power, len(LINES), axis=0)[:, None] * k.conj() * (2 / SAMPLES / each)
        by_path = np.stack([_along(shared.swapaxes(-1, -2), ey, ex, _ACROSS), _along(shared, ex, ey, _DOWN)], axis=-1)
        return value, np.einsum("lsp,lcsj,lcja->pa", self.basis, by_path, self.levers, optimize=True)


def _along(
    shared: Complex[np.ndarray, "lines sides m n"],
    other: Complex[np.ndarray, "lines sides samples n"],
    own: Complex[np.ndarray, "lines sides samples m"],
    frequencies: Float[np.ndarray, " m"],
) -> Float[np.ndarray, "lines sides samples"]:
    """The derivative in each path sample's place along the axis of `own`, given that in conj(k)."""
    inner = np.matmul(shared, other.swapaxes(-1, -2))
    return np.real((1j * frequencies[:, None] * own.swapaxes(-1, -2) * inner).sum(axis=-2))


def _features() -> tuple[Float[np.ndarray, "features n half"], Float[np.ndarray, "n half"]]:
    """phi(w), and how often each frequency counts: twice, for the half that is not held, but once on its edge; 0 beyond the bounds."""
    angle = np.arctan2(_DOWN[:, None], _ACROSS[None])
    fall = 2 * np.log(np.maximum(_MAGNITUDE, _ACROSS[1] / 2))
    periods = _MAGNITUDE / _ACROSS[1]
    counted = (periods > LOWEST) & (periods < HIGHEST / _ACROSS[1])
    twice = np.where(_ACROSS == 0, 1.0, 2.0)
    features = [np.ones_like(fall), fall, np.cos(2 * angle), np.sin(2 * angle), np.cos(4 * angle)]
    return np.array(features), counted * twice[None]


_PHI, _COUNT = _features()
_MEAN = np.array([0.0, FALL, 0.0, 0.0, 0.0])
_STIFFNESS = np.array([0.0, FALL_SPREAD**-2, DIRECTED**-2, DIRECTED**-2, DIRECTED**-2])


def _whittle(observed: Patches, dark: Float[np.ndarray, "strips n half"]) -> tuple[float, Float[np.ndarray, "strips n half"]]:
    """The misfit for |k|^2 = `dark`, the betas at their best, and its derivative in `dark`."""
    total, power, noise = _COUNT.sum(), observed.power, observed.noise[:, None, None]
    beta = np.tile(_MEAN, (len(power), 1))
    flat = np.exp(np.tensordot(beta, _PHI, 1)) * dark
    beta[:, 0] = np.log(np.maximum((_COUNT * np.maximum(power - noise, 0) / flat).sum(axis=(1, 2)) / total, 1e-12))
    belief = 2 * BELIEF * total * _STIFFNESS
    for _ in range(SCORINGS):
        signal = np.exp(np.tensordot(beta, _PHI, 1)) * dark
        model = signal + noise
        ratio = signal / model
        slope = np.einsum("sij,pij->sp", _COUNT * (power - model) / model * ratio, _PHI) - belief * (beta - _MEAN)
        curvature = np.einsum("sij,pij,qij->spq", _COUNT * ratio**2, _PHI, _PHI, optimize=True) + np.diag(belief)
        beta += np.clip(np.linalg.solve(curvature, slope[..., None])[..., 0], -LONGEST_STEP, LONGEST_STEP)
    signal = np.exp(np.tensordot(beta, _PHI, 1)) * dark
    model = signal + noise
    misfit = (_COUNT * (np.log(model) + power / model)).sum(axis=(1, 2)) / total + BELIEF * (_STIFFNESS * (beta - _MEAN) ** 2).sum(axis=1)
    by_dark = _COUNT * (1 / model - power / model**2) * (signal / dark) / total * observed.weight[:, None, None]
    return float(observed.weight @ misfit), by_dark
