"""A wave in the logarithm of scanlines' light, fitted by least squares: how likely it is, and how sure its period is.

The fit of H harmonics by least squares is nonlinear in nu, the cycles a row, alone. Its curvature, and how far parts of the material
disagree, give the standard deviation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize_scalar

_PIECES = 4  # into which columns, and runs, are divided to see how far they disagree
_FEWEST_PIECES = 3  # for a variance between them
_REFINED, _RESOLVED = 0.25, 1e-5  # cycles a frame's height about nu, within which the likeliest one lies; and part of it that is resolved
_SLOWEST = 0.1  # of nu, which a refined one is not below
_FIRST_STEP, _LEAST_STEP = 0.02, 1e-6  # cycles a frame's height, and part of nu: steps by which the curvature is measured
_MOST_COST, _LEAST_COST = 4.0, 1e-6  # fall of the log-likelihood over such a step; one that is about quadratic, and one above 0
_LEAST_LEFT = 1e-12  # of the energy, that a wave leaves; keeps the logarithm finite
_RIDGE = 1e-9  # of the normal equations' trace, for harmonics that rows and frames cannot tell apart
_TINY = 1e-300  # keeps divisors from being 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Runs:
    """Rows' logarithms in runs of frames, for parts of the columns; and the phase that each frame's wave has within its run."""

    parts: Float[np.ndarray, "parts runs frames rows"]
    phases: Float[np.ndarray, "runs frames"]
    scene: bool  # whether a scene is taken out of each run, which costs a frame

    @classmethod
    def of(cls, parts: np.ndarray, phases: np.ndarray, *, scene: bool) -> "Runs":
        parts = parts - parts.mean(axis=-1, keepdims=True)
        return cls(parts=parts - parts.mean(axis=-2, keepdims=True) if scene else parts, phases=phases, scene=scene)

    @property
    def values(self) -> np.ndarray:
        """Of all columns: (runs, frames, rows)."""
        return self.parts.mean(axis=0)

    @property
    def samples(self) -> int:
        """Independent numbers."""
        runs, frames, rows = self.parts.shape[1:]
        return runs * (frames - self.scene) * rows

    def whitened(self, taps: np.ndarray) -> "Runs":
        """Filtered along rows; a wave stays a wave of the same period."""
        rows, last = self.parts.shape[-1] - len(taps) + 1, len(taps) - 1
        filtered = sum(tap * self.parts[..., last - k : last - k + rows] for k, tap in enumerate(taps))
        return Runs.of(np.asarray(filtered), self.phases, scene=self.scene)

    def loose(self) -> "Runs":
        """The same with a phase of its own for every frame."""
        parts = self.parts.reshape(len(self.parts), -1, 1, self.parts.shape[-1])
        return Runs.of(parts, np.zeros(parts.shape[1:3]), scene=False)

    def pieces(self) -> "tuple[Sequence[Runs], ...]":
        """The material divided by columns, and by runs: the pieces should agree."""
        columns = [replace(self, parts=self.parts[i::_PIECES].mean(axis=0, keepdims=True)) for i in range(min(_PIECES, len(self.parts)))]
        count = min(_PIECES, len(self.phases))
        runs = [replace(self, parts=self.parts[:, i::count], phases=self.phases[i::count]) for i in range(count)]
        return columns, runs


@dataclass(frozen=True, kw_only=True, eq=False)
class Wave:
    """A wave that was fitted to runs of frames."""

    runs: Runs
    nu: float  # cycles a row
    sign: int  # of the direction in which phases count
    harmonics: int
    taps: Float[np.ndarray, " taps"]  # of the filter that whitened the runs

    def share(self, nu: float) -> float:
        """The part of the energy that the wave explains at another nu."""
        return fit_wave(self.runs.values, self.runs, self.sign * nu, self.harmonics)[0]

    def likelihood(self, nu: float) -> float:
        """The logarithm of it, against no wave at all."""
        return -0.5 * self.runs.samples * float(np.log(max(1 - self.share(nu), _LEAST_LEFT)))

    @property
    def gain(self) -> float:
        """The likelihood, less what so many coefficients are worth (Schwarz)."""
        return self.likelihood(self.nu) - self.harmonics * len(self.runs.phases) * np.log(self.runs.samples)

    @property
    def evidence(self) -> float:
        """The likelihood that may be compared between filters that whiten, for all of them leave the newest row's weight at 1."""
        left = (1 - self.share(self.nu)) * np.sum(self.runs.values**2) / self.runs.samples
        chance = self.harmonics * len(self.runs.phases) * np.log(self.runs.samples)
        return -0.5 * self.runs.samples * float(np.log(max(left, _TINY))) - chance

    def before(self, raw: Runs) -> float:
        """The part of the energy that the wave explains before whitening."""
        return fit_wave(raw.values, raw, self.sign * self.nu, self.harmonics)[0]

    def follows(self, raw: Runs) -> float:
        """The part of the energy that the fundamental explains before whitening, beyond what noise lends it."""
        share, _ = fit_wave(raw.values, raw, self.sign * self.nu, 1)
        return share - (1 - share) * 2 * len(raw.phases) / raw.samples

    def refined(self) -> "Wave":
        """The most likely one nearby."""
        reach = _REFINED / self.runs.parts.shape[-1]
        bounds = (max(self.nu - reach, _SLOWEST * self.nu), self.nu + reach)
        found: Any = minimize_scalar(
            lambda nu: -self.likelihood(float(nu)), bounds=bounds, method="bounded", options={"xatol": _RESOLVED * reach}
        )
        return replace(self, nu=float(found.x))

    def alike(self) -> float:
        """The part of the wave's energy that all columns share."""
        _, each = zip(*(fit_wave(part, self.runs, self.sign * self.nu, 1) for part in self.runs.parts), strict=True)
        return float(np.sum(np.mean(each, axis=0) ** 2) / max(np.mean(np.sum(np.square(each), axis=(1, 2, 3))), _TINY))

    def spread(self) -> float:
        """The standard deviation of nu: from the curvature of the likelihood, and from how far pieces of the material disagree."""
        here = self.likelihood(self.nu)

        def cost(step: float) -> float:
            return 2 * here - self.likelihood(self.nu + step) - self.likelihood(self.nu - step)

        step = _FIRST_STEP / self.runs.parts.shape[-1]
        while cost(step) > _MOST_COST and step > _LEAST_STEP * self.nu:
            step /= 2
        variances = [step**2 / max(cost(step), _LEAST_COST)]
        for pieces in self.runs.pieces():
            if len(pieces) >= _FEWEST_PIECES:
                variances.append(float(np.var([replace(self, runs=piece).refined().nu for piece in pieces], ddof=1)) / len(pieces))
        return float(np.sqrt(max(variances)))


def fit_wave(values: np.ndarray, runs: Runs, nu: float, harmonics: int) -> tuple[float, np.ndarray]:
    """The share of energy that a wave explains, and the wave: per run Re sum_h a_h e^(i h phase) e^(2 pi i h nu r), all centred."""
    h = np.arange(1, harmonics + 1)
    along = np.exp(2j * np.pi * nu * h[:, None] * np.arange(values.shape[-1]))
    along -= along.mean(axis=1, keepdims=True)
    across = np.exp(1j * h[:, None] * runs.phases[:, None, :])  # runs harmonics frames
    if runs.scene:
        across -= across.mean(axis=2, keepdims=True)
    rhs = np.einsum("bhk,bkh->bh", across, values @ along.T)
    mixed = (across @ across.conj().swapaxes(1, 2)) * (along @ along.conj().T)  # sums of U U'* over a run
    alike = (across @ across.swapaxes(1, 2)) * (along @ along.T)  # of U U'
    gram = 0.5 * np.block([[(mixed + alike).real, (alike - mixed).imag], [(alike + mixed).imag, (mixed - alike).real]])
    target = np.concatenate([rhs.real, rhs.imag], axis=1)
    ridge = _RIDGE * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(2 * harmonics) + _TINY * np.eye(2 * harmonics)
    x = np.linalg.solve(gram + ridge, target[..., None])[..., 0]
    a = x[:, :harmonics] - 1j * x[:, harmonics:]
    wave = np.einsum("bh,bhk,hr->bkr", a, across, along, optimize=True).real
    return float(np.sum(target * x) / max(np.sum(values**2), _TINY)), wave
