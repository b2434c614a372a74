"""The most likely wave in runs of frames: searched over periods, in noise that is whitened as the wave is found."""

from dataclasses import replace

import numpy as np
from scipy.linalg import solve_toeplitz

from calibration.timing.wave import Runs, Wave, fit_wave

NYQUIST = 0.45  # cycles a row; faster bands may be others' aliases
SURE = 25.0  # gain of log-likelihood beyond what chance gives
_HARMONICS = (1, 2, 3, 4, 6, 8, 12)  # numbers of harmonics that are tried
_MISTAKEN_HARMONICS = (2, 3)  # of the fundamental, that may be the strongest wave
_FAINTEST = 5e-3  # of a light's energy, in a fundamental that is weaker than its harmonics
_AUTOREGRESSION = 6  # order of the one that whitens
_RIDGE = 1e-6  # of the variance, in the autoregression's equations
_FEWEST_CYCLES = 0.1  # a frame's height; fewer are a slope


def search(raw: Runs, grid: np.ndarray, signs: tuple[int, ...], taps: np.ndarray, rounds: int = 2) -> Wave | None:
    """The fundamental of the most likely wave; None where chance explains it. `taps` whiten at first, and are bettered in `rounds`."""
    runs, rows = raw.whitened(taps), raw.parts.shape[-1]
    waves = [Wave(runs=runs, nu=float(nu), sign=sign, harmonics=1, taps=taps) for sign in signs for nu in grid]
    best = max(waves, key=lambda wave: wave.likelihood(wave.nu)).refined()
    for _ in range(rounds):
        best = _whitened(_with_harmonics(best), raw, taps)
    best = _with_harmonics(best)
    for times in _MISTAKEN_HARMONICS:
        if best.nu / times >= grid[0]:
            slower = replace(best, nu=best.nu / times, harmonics=times * best.harmonics).refined()
            for _ in range(rounds):
                slower = _whitened(slower, raw, taps)
            if slower.evidence > best.evidence + SURE and slower.before(raw) > (1 + _FAINTEST) * best.before(raw):
                best = _with_harmonics(slower)
                break
    return best if best.gain > SURE and best.nu * rows > _FEWEST_CYCLES else None


def _whitened(wave: Wave, raw: Runs, taps: np.ndarray) -> Wave:
    """The wave fitted again, after whitening what it leaves: `taps`, and then an autoregression."""
    _, fitted = fit_wave(raw.values, raw, wave.sign * wave.nu, wave.harmonics)
    better = _whitening(raw.values - fitted, taps)
    return replace(wave, runs=raw.whitened(better), taps=better).refined()


def _with_harmonics(wave: Wave) -> Wave:
    counts = [h for h in _HARMONICS if h * wave.nu < NYQUIST] or [1]
    return max((replace(wave, harmonics=h).refined() for h in counts), key=lambda each: each.gain)


def _whitening(residual: np.ndarray, taps: np.ndarray) -> np.ndarray:
    """`taps`, followed by the prediction-error filter of an autoregression fitted to what they leave of the residual (Yule-Walker)."""
    rows = np.stack([np.convolve(row, taps, mode="valid") for row in residual.reshape(-1, residual.shape[-1])])
    rows -= rows.mean(axis=1, keepdims=True)
    lags = np.array([np.sum(rows[:, lag:] * rows[:, : rows.shape[1] - lag]) for lag in range(_AUTOREGRESSION + 1)])
    if lags[0] <= 0:
        return taps
    lags[0] *= 1 + _RIDGE
    return np.convolve(taps, [1.0, *(-solve_toeplitz(lags[:-1], lags[1:]))])
