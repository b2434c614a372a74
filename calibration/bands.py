"""The wave that a flickering light leaves in the logarithm of scanlines' light, fitted by least squares.

In a clip the bands wander by f (t_k+1 - t_k) cycles a frame while the scene stays. What frames share is taken out, and the wave that is
left is fitted with phases that follow the frames' times within runs of a few frames, so that light and clock may drift slowly. The sign
of nu for which this succeeds is the direction of the readout. Where bands stand still, and in a photograph, the scene's own rows are
noise with a falling spectrum, which is whitened.

The fit of H harmonics by least squares is nonlinear in nu, the cycles a row, alone. Its curvature, and how far parts of the material
disagree, give the standard deviation.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from jaxtyping import Float
from scipy.linalg import solve_toeplitz
from scipy.optimize import minimize_scalar

FEWEST_BANDS = 2.0  # in a picture whose bands do not wander
NYQUIST = 0.45  # cycles a row; faster bands may be others' aliases
_FLOOR = 0.05  # of the mean light; keeps the logarithm of dark bands finite
_RUN = 8  # frames over which a light keeps its phase
_ORDER = 6  # of the autoregression that whitens
_HARMONICS = (1, 2, 3, 4, 6, 8, 12)
_SURE = 25.0  # gain of log-likelihood beyond what chance gives
_ALIKE = 0.7  # of the energy of bands, that all columns share
_FAINTEST = 5e-3  # of a light's energy, in a fundamental that is weaker than its harmonics
_FOLLOWS = 0.7  # of the energy of bands, that follows the frames' times
_WANDERS = 0.1  # of a cycle; less is standing still
_STRAYS = 0.025  # cycles a frame; lamps, clocks and mains drift by less
_FALLING = np.array([1.0, -1.0])  # whitens a scene's rows, at first


class CannotTellError(ValueError):
    """The material does not say it; the words tell why, and what would help."""


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
        columns = [replace(self, parts=self.parts[i::4].mean(axis=0, keepdims=True)) for i in range(min(4, len(self.parts)))]
        count = min(4, len(self.phases))
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
        return _fitted(self.runs.values, self.runs, self.sign * nu, self.harmonics)[0]

    def likelihood(self, nu: float) -> float:
        """The logarithm of it, against no wave at all."""
        return -0.5 * self.runs.samples * float(np.log(max(1 - self.share(nu), 1e-12)))

    @property
    def gain(self) -> float:
        """The likelihood, less what so many coefficients are worth (Schwarz)."""
        return self.likelihood(self.nu) - self.harmonics * len(self.runs.phases) * np.log(self.runs.samples)

    @property
    def evidence(self) -> float:
        """The likelihood that may be compared between filters that whiten, for all of them leave the newest row's weight at 1."""
        left = (1 - self.share(self.nu)) * np.sum(self.runs.values**2) / self.runs.samples
        chance = self.harmonics * len(self.runs.phases) * np.log(self.runs.samples)
        return -0.5 * self.runs.samples * float(np.log(max(left, 1e-300))) - chance

    def before(self, raw: Runs) -> float:
        """The part of the energy that the wave explains before whitening."""
        return _fitted(raw.values, raw, self.sign * self.nu, self.harmonics)[0]

    def follows(self, raw: Runs) -> float:
        """The part of the energy that the fundamental explains before whitening, beyond what noise lends it."""
        share, _ = _fitted(raw.values, raw, self.sign * self.nu, 1)
        return share - (1 - share) * 2 * len(raw.phases) / raw.samples

    def refined(self) -> "Wave":
        """The most likely one nearby."""
        reach = 0.25 / self.runs.parts.shape[-1]
        bounds = (max(self.nu - reach, 0.1 * self.nu), self.nu + reach)
        found: Any = minimize_scalar(
            lambda nu: -self.likelihood(float(nu)), bounds=bounds, method="bounded", options={"xatol": 1e-5 * reach}
        )
        return replace(self, nu=float(found.x))

    def alike(self) -> float:
        """The part of the wave's energy that all columns share."""
        _, each = zip(*(_fitted(part, self.runs, self.sign * self.nu, 1) for part in self.runs.parts), strict=True)
        return float(np.sum(np.mean(each, axis=0) ** 2) / max(np.mean(np.sum(np.square(each), axis=(1, 2, 3))), 1e-300))

    def spread(self) -> float:
        """The standard deviation of nu: from the curvature of the likelihood, and from how far pieces of the material disagree."""
        here = self.likelihood(self.nu)

        def cost(step: float) -> float:
            return 2 * here - self.likelihood(self.nu + step) - self.likelihood(self.nu - step)

        step = 0.02 / self.runs.parts.shape[-1]
        while cost(step) > 4 and step > 1e-6 * self.nu:
            step /= 2
        variances = [step**2 / max(cost(step), 1e-6)]
        for pieces in self.runs.pieces():
            if len(pieces) > 2:
                variances.append(float(np.var([replace(self, runs=piece).refined().nu for piece in pieces], ddof=1)) / len(pieces))
        return float(np.sqrt(max(variances)))


def _fitted(values: np.ndarray, runs: Runs, nu: float, harmonics: int) -> tuple[float, np.ndarray]:
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
    ridge = 1e-9 * np.trace(gram, axis1=1, axis2=2)[:, None, None] * np.eye(2 * harmonics) + 1e-300 * np.eye(2 * harmonics)
    x = np.linalg.solve(gram + ridge, target[..., None])[..., 0]
    a = x[:, :harmonics] - 1j * x[:, harmonics:]
    wave = np.einsum("bh,bhk,hr->bkr", a, across, along, optimize=True).real
    return float(np.sum(target * x) / max(np.sum(values**2), 1e-300)), wave


def _search(raw: Runs, grid: np.ndarray, signs: tuple[int, ...], taps: np.ndarray, rounds: int = 2) -> Wave | None:
    """The fundamental of the most likely wave; None where chance explains it. `taps` whiten at first, and are bettered in `rounds`."""
    runs, rows = raw.whitened(taps), raw.parts.shape[-1]
    waves = [Wave(runs=runs, nu=float(nu), sign=sign, harmonics=1, taps=taps) for sign in signs for nu in grid]
    best = max(waves, key=lambda wave: wave.likelihood(wave.nu)).refined()
    for _ in range(rounds):
        best = _whitened(_with_harmonics(best), raw, taps)
    best = _with_harmonics(best)
    for times in (2, 3):  # the strongest wave may be the fundamental's harmonic
        if best.nu / times >= grid[0]:
            slower = replace(best, nu=best.nu / times, harmonics=times * best.harmonics).refined()
            for _ in range(rounds):
                slower = _whitened(slower, raw, taps)
            if slower.evidence > best.evidence + _SURE and slower.before(raw) > (1 + _FAINTEST) * best.before(raw):
                best = _with_harmonics(slower)
                break
    return best if best.gain > _SURE and best.nu * rows > 0.1 else None


def _whitened(wave: Wave, raw: Runs, taps: np.ndarray) -> Wave:
    """The wave fitted again, after whitening what it leaves: `taps`, and then an autoregression."""
    _, fitted = _fitted(raw.values, raw, wave.sign * wave.nu, wave.harmonics)
    better = _whitening(raw.values - fitted, taps)
    return replace(wave, runs=raw.whitened(better), taps=better).refined()


def _with_harmonics(wave: Wave) -> Wave:
    counts = [h for h in _HARMONICS if h * wave.nu < NYQUIST] or [1]
    return max((replace(wave, harmonics=h).refined() for h in counts), key=lambda each: each.gain)


def _whitening(residual: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """`taps`, followed by the prediction-error filter of an autoregression fitted to what they leave of the residual (Yule-Walker)."""
    rows = np.stack([np.convolve(row, taps, mode="valid") for row in residual.reshape(-1, residual.shape[-1])])
    rows -= rows.mean(axis=1, keepdims=True)
    lags = np.array([np.sum(rows[:, lag:] * rows[:, : rows.shape[1] - lag]) for lag in range(_ORDER + 1)])
    if lags[0] <= 0:
        return taps
    lags[0] *= 1 + 1e-6
    return np.convolve(taps, [1.0, *(-solve_toeplitz(lags[:-1], lags[1:]))])


def _logarithms(light: np.ndarray, *, over_mean: bool) -> Float[np.ndarray, "parts frames rows"]:
    """Of each part's rows; over what they are on average, which takes a scene out that keeps still."""
    if over_mean:
        dark = 0.1 * _FLOOR * light.mean()
        light = (light + dark) / (light + dark).mean(axis=0)
    return np.moveaxis(np.log(light + _FLOOR * light.mean()), 1, 0)


def wandering(light: np.ndarray, phases: np.ndarray, grid: np.ndarray) -> tuple[Wave, int | None] | None:
    """The wave that wanders through a clip, and its sign if that is certain; None where it is not expected to wander."""
    length = min(_RUN, len(light))
    if length < 2 or abs(np.exp(1j * phases[:length]).mean()) > np.cos(np.pi * _WANDERS):
        return None
    runs = len(light) // length
    parts = _logarithms(light[: runs * length], over_mean=True)
    raw = Runs.of(parts.reshape(len(parts), runs, length, -1), phases[: runs * length].reshape(runs, length), scene=True)
    loose = _search(raw.loose(), grid, (1,), np.ones(1))
    signs = (1, -1) if length > 2 else (1,)
    wave = _search(raw, grid, signs, np.ones(1)) if loose is None else _search(raw, grid, signs, loose.taps, rounds=0)
    if wave is None and loose is None:
        raise CannotTellError(
            "no bands wander through the clip; is the light's frequency right, and the exposure not a multiple of its period?"
        )
    if loose is not None and (wave is None or wave.follows(raw) < _FOLLOWS * loose.follows(raw.loose())):
        raise CannotTellError(
            f"bands {1 / loose.nu:.4g} rows apart wander otherwise than those of a light of this frequency at this frame rate;"
            " is the frequency right, and does the clip play at the rate at which it was recorded?"
        )
    assert wave is not None
    if length > 2:
        _refuse_stray(_stray(wave, raw, np.linspace(-0.08, 0.08, 41)))
    if length == 2:  # without a scene taken out, which leaves nothing to tell the ways apart
        pairs = Runs.of(_logarithms(light[: 2 * runs], over_mean=False).reshape(len(parts), runs, 2, -1), raw.phases, scene=False)
        ways = [replace(wave, runs=pairs.whitened(_FALLING), taps=_FALLING, sign=sign) for sign in (1, -1)]
        better, worse = sorted(ways, key=lambda one: one.gain, reverse=True)
    else:
        better, worse = wave, replace(wave, sign=-wave.sign).refined()
    return wave, better.sign if better.gain > worse.gain + _SURE else None


def standing(light: np.ndarray, phases: np.ndarray, grid: np.ndarray) -> tuple[Wave, int | None]:
    """The wave that is common to all columns of a picture, or of a clip in which bands stand still or drift in no time with the frames."""
    if len(light) > 2:
        adrift = _search(Runs.of(_logarithms(light, over_mean=True)[:, None], phases[None], scene=True).loose(), grid, (1,), np.ones(1))
        if adrift is not None and adrift.alike() > _ALIKE:
            length = min(_RUN, len(light))
            runs = len(light) // length
            parts = _logarithms(light, over_mean=True)[:, : runs * length]
            raw = Runs.of(parts.reshape(len(parts), runs, length, -1), phases[: runs * length].reshape(runs, length), scene=False)
            stray = _stray(replace(adrift, harmonics=1), raw, np.linspace(-0.5, 0.5, 101))
            if replace(adrift, runs=_ahead(raw, stray)).follows(_ahead(raw, stray)) > _FOLLOWS * adrift.follows(raw.loose()):
                ahead = float(np.angle(np.exp(1j * np.diff(raw.phases, axis=1)).mean())) / (2 * np.pi)
                _refuse_stray(min((stray, stray + 2 * ahead), key=abs))  # of a readout in either direction
            return _many(adrift), None
    parts = _logarithms(light.mean(axis=0, keepdims=True), over_mean=False)
    raw = Runs.of(parts[:, None], np.zeros((1, 1)), scene=False)
    wave = _search(raw, grid[grid * light.shape[2] > 1], (1,), _FALLING)
    if wave is None:
        raise CannotTellError("no bands stand out from the scene; film a plain wall, more closely lit, with a short exposure")
    if (alike := wave.alike()) < _ALIKE:
        raise CannotTellError(f"columns share only {alike:.0%} of what looks like bands, so it is the scene's; film a plain wall")
    return _many(wave), None


def _ahead(runs: Runs, stray: float) -> Runs:
    """The same with waves that go on by so many cycles a frame more."""
    return replace(runs, phases=runs.phases + 2 * np.pi * stray * np.arange(runs.phases.shape[1]))


def _stray(wave: Wave, raw: Runs, tried: np.ndarray) -> float:
    """By how many cycles a frame, of those tried, the bands most likely wander beyond what the frames' times say."""
    shares = [_fitted(raw.values, _ahead(raw, stray), wave.sign * wave.nu, wave.harmonics)[0] for stray in tried]
    return float(tried[int(np.argmax(shares))])


def _refuse_stray(stray: float) -> None:
    if abs(stray) > _STRAYS:
        raise CannotTellError(
            f"the bands wander by {abs(stray):.2g} of their period a frame otherwise than those of a light of this frequency"
            " at this frame rate; is the frequency right, and does the clip play at the rate at which it was recorded?"
        )


def _many(wave: Wave) -> Wave:
    """The wave itself, if it has bands enough to be told without the frames' times."""
    if (bands := wave.nu * wave.runs.parts.shape[-1]) < FEWEST_BANDS:
        raise CannotTellError(
            f"only {bands:.2g} bands are in a frame, and they do not wander with the frames' times, so that a scene may imitate them;"
            " take a faster light, or a frame rate that does not divide its frequency"
        )
    return wave
