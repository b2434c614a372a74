"""How well a path explains the power spectra of a frame's patches: the Whittle likelihood of a Gaussian scene.

A latent image's power falls with frequency and may prefer some directions; blur along a path multiplies it by |k(w)|^2, the power of
the PSF, which is dark where the blur leaves nothing. So a patch about scanline r has the expected periodogram

    M_r(w) = exp(beta_r . phi(w)) |k_r(w)|^2 + n,    phi = (1, log |w|, cos 2a, sin 2a, cos 4a),  a the direction of w,

with the noise's power n, and the misfit of a path is the mean over frequencies of log M + S / M, S being what is observed (Whittle
1953). The beta_r are fitted for every path by Newton's method. To integrate the latent image out, rather than to choose the best one,
is what keeps short paths from being preferred (Levin et al., CVPR 2009, "Understanding and evaluating blind deconvolution
algorithms"). Where `soft` is set, phi has -|w|^2 besides: softness, as focus, lenses and enlarging leave it, is alike in all
directions, and motion blur is not; what a path explains beyond it is motion. That spectra alone show motion blur is due to
Goldstein & Fattal (ECCV 2012). Power has no phase: a path and its mirror image, which is the same line run backwards, are alike
here, and the sparsity f has to tell them apart.
"""

from dataclasses import dataclass, field
from typing import no_type_check

import numpy as np
from jaxtyping import Complex, Float, Int
from numba import njit
from numpy.lib.stride_tricks import sliding_window_view
from scipy import fft

from rsvideo.lanes import LANES, alike, exponential, larger, load, store, total
from rsvideo.physics.camera import lever
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.scene import Scene
from rsvideo.threads import loop, spread

SIDE = 64  # px of a patch
STRIPS, SIDES = 9, 2  # parts of the frame, over its scanlines and across them, for roll blurs the sides along different paths
STEP = 32  # px between patches of a part, and half of it, up and down, between the rows that a part joins
SHARPEST = 0.4  # of a part's patches, those with most power between MIDDLE's bounds: out of focus, a patch shows a blur of its own
MIDDLE = 0.5, 1.6  # rad a px
LOWEST, HIGHEST = 2.0, 2.1  # frequencies that count: in periods a patch, whose window blurs lower ones; in rad a px, JPEG thins higher ones
FINE, FINE_NOISE = 1.7, 0.7  # rad a px, from which on so much of a part's power is noise at least: what compression adds and hides
FEWEST = 3  # patches of a part
VALID = 0.98  # of a patch's pixels are not clipped
CONTRAST = 4.0  # times the noise's variance, which a patch must exceed
LEAK = 2e-3  # of |k|^2, that the patches' window lets through where the blur is dark
SAMPLES = 20  # path samples an exposure
LINES = -14.0, 0.0, 14.0  # scanlines about a part's middle that stand for it
FALL, FALL_SPREAD = -1.1, 0.25  # of log |w|^2, and its standard deviation; photographs' falls with -1.7 +- 0.35 in patches that count,
# which leads to better first paths, and to no more right ones after the race
DIRECTED = 0.3  # standard deviation of how much the power prefers directions
SOFT = 1.0  # px^2, the same of softness; from 0.4 to 2.5 little differs
BELIEF = 5e-3  # weight of what is believed of the beta, beside a frequency's likelihood
STEPS = 9  # of Newton's method for the beta, at most
LEAST_CURVATURE = 0.1  # of its expectation, which a frequency's curvature in beta . phi counts for at least
LONGEST_STEP, SHORTEST_STEP = 1.5, 1e-3  # how far a step may lead, and how short a step ends them: the misfit is flat there


_ALL_DOWN, _ALL_ACROSS = 2 * np.pi * np.fft.fftfreq(SIDE), 2 * np.pi * np.fft.rfftfreq(SIDE)
_KEPT = np.ix_(np.abs(_ALL_DOWN) < HIGHEST, _ALL_ACROSS < HIGHEST)
_DOWN, _ACROSS = _ALL_DOWN[_KEPT[0].ravel()], _ALL_ACROSS[_KEPT[1].ravel()]  # rad a px
_MAGNITUDE = np.hypot(_DOWN[:, None], _ACROSS[None])
_WINDOW = np.outer(np.hanning(SIDE + 2)[1:-1], np.hanning(SIDE + 2)[1:-1])
_WINDOW /= np.sqrt((_WINDOW**2).sum())


@dataclass(frozen=True, kw_only=True, eq=False)
class Patches:
    """Mean periodograms of a frame's patches, part by part, each patch's variance being 1."""

    power: Float[np.ndarray, "parts n half"]
    noise: Float[np.ndarray, " parts"]  # the noise's power
    rows: Float[np.ndarray, " parts"]  # the scanline in the part's middle
    columns: Float[np.ndarray, " parts"]  # the patches' mean
    weight: Float[np.ndarray, " parts"]  # of sum 1


def patches(scene: Scene) -> Patches | None:
    """The spectra of a scene; None where it has no part of FEWEST textured patches, or is smaller than a patch."""
    rows, cols = scene.frame.shape
    if min(rows, cols) < SIDE:
        return None
    fine, middle = (_MAGNITUDE > FINE) & (_MAGNITUDE < HIGHEST), np.abs(_MAGNITUDE - np.mean(MIDDLE)) < np.ptp(MIDDLE) / 2
    power, noise, at, count = [], [], [], []
    for centre in np.linspace(SIDE / 2, rows - SIDE / 2, STRIPS):
        tops = np.unique(np.clip(centre - SIDE / 2 + np.array([-STEP // 2, 0, STEP // 2]), 0, rows - SIDE).astype(int))
        for lefts in np.array_split(np.arange(0, cols - SIDE + 1, STEP), SIDES):
            columns, variance, periodograms = _textured(scene, tops, lefts)
            if len(columns) < FEWEST:
                continue
            order = np.argsort(-periodograms[:, middle].mean(axis=1), kind="stable")
            best = order[: max(FEWEST, int(SHARPEST * len(order)))]
            power.append((periodograms[best] / variance[best, None, None]).mean(axis=0))
            noise.append(max((scene.noise**2 / variance[best]).mean(), float(FINE_NOISE * np.median(power[-1][fine]))))
            at.append((columns[best].mean(), centre))
            count.append(len(best))
    if not power:
        return None
    columns, middles = np.array(at).T
    return Patches(power=np.array(power), noise=np.array(noise), rows=middles, columns=columns, weight=np.array(count) / sum(count))


def _textured(
    scene: Scene, tops: Int[np.ndarray, " t"], lefts: Int[np.ndarray, " l"]
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, " n"], Float[np.ndarray, "n rows half"]]:
    """Of the patches at these places that have texture and are not clipped: the column of the middle, the variance, the periodogram."""
    patches, valid = (
        sliding_window_view(each, (SIDE, SIDE))[np.ix_(tops, lefts)].reshape(-1, SIDE, SIDE) for each in (scene.frame, scene.valid)
    )
    variance = patches.var(axis=(1, 2), dtype=float)
    held = (valid.mean(axis=(1, 2)) >= VALID) & (variance >= CONTRAST * scene.noise**2 + scene.least_texture)
    patches = patches[held].astype(float)
    return np.tile(lefts + (SIDE - 1) / 2, len(tops))[held], variance[held], np.abs(windowed(patches)[:, *_KEPT]) ** 2


def windowed(patches: Float[np.ndarray, "n side side"]) -> Complex[np.ndarray, "n side half"]:
    """The Fourier transform of patches of SIDE px under a window, less their mean under it; of noise its mean square is the variance."""
    window = _WINDOW.astype(patches.dtype)
    level = np.tensordot(patches, window) / window.sum()
    return np.asarray(fft.rfft2((patches - level[:, None, None]) * window))


@dataclass(frozen=True, kw_only=True, eq=False)
class Spectrum:
    """The misfit of paths of one kind to the spectra of a scene."""

    scene: Scene
    patches: Patches
    curve: Trajectory  # of the kind, whatever its coefficients
    soft: bool = False  # whether the scene may be soft beside the path
    basis: Float[np.ndarray, "lines samples terms"] = field(init=False)  # about each scanline's mean, without the constant
    levers: Float[np.ndarray, "lines 2 axes"] = field(init=False)
    beside: Float[np.ndarray, "lines samples 2"] | float = field(init=False)  # px, what the scene's flow adds to a path
    counted: tuple[Float[np.ndarray, "parts taken"], Float[np.ndarray, " parts"]] = field(init=False)  # S where it counts, and n

    def __post_init__(self) -> None:
        timing, lens = self.scene.camera.timing, self.scene.camera.intrinsics
        axes = self.curve.coefficients.shape[1]
        lines = (self.patches.rows[:, None] + np.array(LINES)).ravel()
        open_for = (np.arange(SAMPLES) + 0.5) * (timing.exposure / SAMPLES)
        times = lines[:, None] * timing.row_time + open_for
        basis = self.curve.basis(times)[..., 1:]
        object.__setattr__(self, "basis", basis - basis.mean(axis=1, keepdims=True))
        columns, beside = np.repeat(self.patches.columns, len(LINES)), 0.0
        object.__setattr__(self, "levers", lever(lens, columns, lines, axes) * self.scene.unit(axes))
        if flow := self.scene.flow:
            beside = (open_for.mean() - open_for)[:, None] * flow.at(np.stack([columns, lines], axis=-1))[:, None]
        object.__setattr__(self, "beside", beside)
        object.__setattr__(self, "counted", (_counted(self.patches.power), self.patches.noise.astype(np.float32)))

    def value(self, path: Trajectory) -> float:
        """The misfit of a path."""
        return self.misfit(path.coefficients[1:], slope=False)[0]

    def drop(self, path: Trajectory) -> float:
        """By how much the misfit along a path is lower than at rest."""
        return self.value(path.with_coefficients(0 * path.coefficients)) - self.value(path)

    def misfit(self, coefficients: Float[np.ndarray, "unknowns axes"], *, slope: bool = True) -> tuple[float, np.ndarray]:
        """The mean over frequencies of log M + S / M, and its derivative in the coefficients but the constant ones."""
        q = np.matmul(self.basis @ coefficients, self.levers.swapaxes(-1, -2)) + self.beside
        ey, ex = _waves(q[..., 1], _DOWN), _waves(q[..., 0], _ACROSS)
        k = np.matmul(ey.swapaxes(-1, -2), ex) / SAMPLES
        dark = (k.real**2 + k.imag**2).reshape(-1, len(LINES), *k.shape[1:]).mean(axis=1) + LEAK
        value, by_power = _whittle(self.counted, self.patches.weight, dark, soft=self.soft)
        if not slope:
            return value, np.zeros_like(coefficients)
        shared = np.repeat(by_power, len(LINES), axis=0) * k.conj() * (2 / SAMPLES / len(LINES))
        by_path = np.stack([_along(shared.swapaxes(-1, -2), ey, ex, _ACROSS), _along(shared, ex, ey, _DOWN)], axis=-1)
        return value, np.tensordot(self.basis, np.matmul(by_path, self.levers), axes=((0, 1), (0, 1)))


def _waves(place: Float[np.ndarray, "lines samples"], frequencies: Float[np.ndarray, " m"]) -> Complex[np.ndarray, "lines samples m"]:
    phase = (place[..., None] * frequencies).astype(np.float32)
    waves = np.empty(phase.shape, np.complex64)
    np.cos(phase, out=waves.real)
    np.sin(phase, out=waves.imag)
    return waves


def _along(
    shared: Complex[np.ndarray, "lines m n"],
    other: Complex[np.ndarray, "lines samples n"],
    own: Complex[np.ndarray, "lines samples m"],
    frequencies: Float[np.ndarray, " m"],
) -> Float[np.ndarray, "lines samples"]:
    """The derivative in each path sample's place along the axis of `own`, given that in conj(k)."""
    inner = np.matmul(shared, other.swapaxes(-1, -2))
    return -frequencies.astype(np.float32) @ (own.swapaxes(-1, -2) * inner).imag


def _features() -> tuple[Float[np.ndarray, "features all"], Float[np.ndarray, "n half"]]:
    """phi(w), and how often each frequency counts: twice, for the half that is not held, but once on its edge; 0 beyond the bounds."""
    angle = np.arctan2(_DOWN[:, None], _ACROSS[None])
    fall = 2 * np.log(np.maximum(_MAGNITUDE, _ACROSS[1] / 2))
    periods = _MAGNITUDE / _ACROSS[1]
    times = ((periods > LOWEST) & (periods < HIGHEST / _ACROSS[1])) * np.where(_ACROSS == 0, 1.0, 2.0)
    features = np.array([np.ones_like(fall), fall, np.cos(2 * angle), np.sin(2 * angle), np.cos(4 * angle), -(_MAGNITUDE**2)])
    return features.reshape(len(features), -1).astype(np.float32), times.astype(np.float32)


_FEATURES, _TIMES = _features()
_COUNTED = np.flatnonzero(_TIMES)
_SPARE = -len(_COUNTED) % LANES  # of the last lanes
_TAKEN = np.concatenate([_COUNTED, np.full(_SPARE, _COUNTED[0])])  # the frequencies that count, and one of them where lanes are to spare
_COUNT = np.concatenate([_TIMES.ravel()[_COUNTED], np.zeros(_SPARE, np.float32)])  # where it does not count
_WHOLE = _COUNT.sum()
_PHI = np.ascontiguousarray(_FEATURES[:, _TAKEN])
_PAIRS = _PHI[:, None] * _PHI
_LEAST_LEVEL = 1e-12  # of a signal: log is taken of it


def _counted(image: Float[np.ndarray, "parts n half"]) -> Float[np.ndarray, "parts taken"]:
    """What each part has at the frequencies that count."""
    return np.ascontiguousarray(image.reshape(len(image), -1)[:, _TAKEN], np.float32)


def _whittle(
    observed: tuple[Float[np.ndarray, "parts taken"], Float[np.ndarray, " parts"]],
    weight: Float[np.ndarray, " parts"],
    dark: Float[np.ndarray, "parts n half"],
    *,
    soft: bool,
) -> tuple[float, Float[np.ndarray, "parts n half"]]:
    """The misfit for |k|^2 = `dark`, the betas at their best, and its derivative in `dark`."""
    power, noise = observed
    misfit, slope = np.empty(len(power)), np.empty_like(power)
    some = len(_PHI) if soft else len(_PHI) - 1  # softness is the last of phi
    mean = np.array([0.0, FALL, 0.0, 0.0, 0.0, 0.0])[:some]
    stiffness = BELIEF * np.array([0.0, FALL_SPREAD**-2, DIRECTED**-2, DIRECTED**-2, DIRECTED**-2, SOFT**-2])[:some]
    model = (_PHI[:some].ravel(), _PAIRS[:some, :some].ravel(), _COUNT, _WHOLE, mean, stiffness)
    flat = (power.ravel(), noise, _counted(dark).ravel(), *model, misfit, slope.ravel())
    spread(_fitted, len(power), *flat)
    by_dark = np.zeros((len(dark), dark[0].size), np.float32)
    by_dark[:, _COUNTED] = slope[:, : len(_COUNTED)] * weight[:, None].astype(np.float32)
    return float(weight @ misfit), by_dark.reshape(dark.shape)


@no_type_check
@loop(fastmath=False)
def _fitted(first, last, power, noise, dark, phi, pairs, times, whole, mean, stiffness, misfit, slope):
    """Newton's method for each part's beta, and what it leads to."""
    count, features = len(times), len(phi) // len(times)
    signal, along, bend = np.empty(count, np.float32), np.empty(count, np.float32), np.empty(count, np.float32)
    beta, gradient, curvature = np.empty(features), np.empty(features), np.empty((features, features))
    one, two = alike(np.float32(1)), alike(np.float32(2))
    for p in range(first, last):
        n, own = alike(noise[p]), p * count
        for a in range(features):
            beta[a] = mean[a]
        _signal(beta, phi, dark, own, signal)
        level = alike(np.float32(0))
        for w in range(0, count, LANES):
            above = larger(load(power, own + w) - n, alike(np.float32(0)))
            level = level + load(times, w) * above / load(signal, w)
        beta[0] = np.log(max(total(level) / whole, _LEAST_LEVEL))
        for _ in range(STEPS):
            _signal(beta, phi, dark, own, signal)
            for w in range(0, count, LANES):
                weight, inverse = load(times, w), one / (load(signal, w) + n)
                ratio, excess = load(signal, w) * inverse, load(power, own + w) * inverse
                store(along, w, weight * (excess - one) * ratio)
                curved = ratio * (one - ratio - excess * (one - two * ratio))
                store(bend, w, weight * larger(curved, alike(np.float32(LEAST_CURVATURE)) * ratio * ratio))
            for a in range(features):
                belief = 2 * whole * stiffness[a]
                gradient[a] = _dot(along, phi, a * count) - belief * (beta[a] - mean[a])
                for b in range(a + 1):
                    curvature[a, b] = _dot(bend, pairs, (a * features + b) * count)
                curvature[a, a] += belief
            _solved(curvature, gradient)
            farthest = 0.0
            for a in range(features):
                step = min(max(gradient[a], -LONGEST_STEP), LONGEST_STEP)
                beta[a] += step
                farthest = max(farthest, abs(step))
            if farthest < SHORTEST_STEP:
                break
        _signal(beta, phi, dark, own, signal)
        value = 0.0
        for w in range(count):
            value += times[w] * (np.log(signal[w] + noise[p]) + power[own + w] / (signal[w] + noise[p]))
        value /= whole
        for w in range(0, count, LANES):
            inverse = one / (load(signal, w) + n)
            by_signal = load(times, w) * (one - load(power, own + w) * inverse) * inverse
            store(slope, own + w, by_signal * load(signal, w) / load(dark, own + w) / alike(np.float32(whole)))
        for a in range(features):
            value += stiffness[a] * (beta[a] - mean[a]) ** 2
        misfit[p] = value


@no_type_check
@njit(cache=True)
def _signal(beta, phi, dark, own, signal):
    """exp(beta . phi) |k|^2 of each frequency."""
    count = len(signal)
    for w in range(0, count, LANES):
        power = alike(np.float32(0))
        for a in range(len(beta)):
            power = power + alike(np.float32(beta[a])) * load(phi, a * count + w)
        store(signal, w, exponential(power) * load(dark, own + w))


@no_type_check
@njit(cache=True)
def _dot(a, b, at):
    """Of an array with the part of another from a place on."""
    summed = alike(np.float32(0))
    for w in range(0, len(a), LANES):
        summed = summed + load(a, w) * load(b, at + w)
    return total(summed)


@no_type_check
@njit(cache=True)
def _solved(matrix, vector):
    """In place: vector <- matrix^-1 vector, by Cholesky's factor of a few rows, of which the lower triangle is read."""
    n = len(vector)
    for i in range(n):
        for j in range(i + 1):
            total = matrix[i, j]
            for k in range(j):
                total -= matrix[i, k] * matrix[j, k]
            matrix[i, j] = np.sqrt(total) if i == j else total / matrix[j, j]
    for i in range(n):
        for k in range(i):
            vector[i] -= matrix[i, k] * vector[k]
        vector[i] /= matrix[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            vector[i] -= matrix[k, i] * vector[k]
        vector[i] /= matrix[i, i]
