"""Read and shot noise, from pictures that were taken twice, else from flat patches."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Float, Float32
from scipy.optimize import nnls
from scipy.special import chdtri

from calibration.radiometry.exposure_series import Photograph
from calibration.radiometry.patches import SIDE_PX, blocks

_LIGHT = np.geomspace(1e-4, 1, 25)  # edges of levels, at each of which the variance is estimated
_FLAT = 0.2  # the calmest part of the patches at a level, that counts as flat
_FEWEST_PATCHES, _FEWEST_LEVELS = 20, 3  # for a level's variance, and for read and shot noise


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """variance = read^2 + shot * light, in light from 0 to 1, and how surely."""

    read: float
    shot: float
    read_std: float
    shot_std: float
    levels: tuple[tuple[float, float], ...]  # (light, variance) that it was fitted to
    how: str


def fit_noise(
    series: Sequence[Photograph], codes: Sequence[Float32[np.ndarray, "rows cols"]], curve: Float[np.ndarray, " entries"], high: float
) -> NoiseModel | None:
    """The noise of a series in order of exposure, whose light is `curve` of its codes and unclipped below `high`; None: too few patches."""
    light = [np.interp(plane, np.linspace(0, 1, len(curve)), curve) for plane in codes]
    twins = [k for k in range(len(series) - 1) if series[k].exposure == series[k + 1].exposure]
    means, variances, weights = [], [], []
    for k in twins or range(len(series)):
        patches = blocks(codes[k])
        inside = (patches.max(axis=1) < high) & (patches.min(axis=1) > 0)
        mean = blocks(light[k]).mean(axis=1)
        if twins:
            variance, freedom, quantile = blocks((light[k] - light[k + 1]) / math.sqrt(2)).var(axis=1, ddof=1), SIDE_PX**2 - 1, 0.5
        else:
            variance, freedom, quantile = _about_planes(blocks(light[k])), SIDE_PX**2 - 3, _FLAT
        for low, top in pairwise(_LIGHT.tolist()):
            here = inside & (mean >= low) & (mean < top)
            if here.sum() < _FEWEST_PATCHES:
                continue
            typical = float(np.quantile(variance[here], quantile)) * freedom / float(chdtri(freedom, 1 - quantile))
            if typical > 0:
                means.append(float(mean[here].mean()))
                variances.append(typical)
                weights.append(math.sqrt(float(here.sum())) / typical)
    if len(means) < _FEWEST_LEVELS:
        return None
    how = f"{len(twins)} pairs of equal exposures" if twins else "the calmest patches at each level of light"
    return _line(means, variances, weights, how)


def _line(means: Sequence[float], variances: Sequence[float], weights: Sequence[float], how: str) -> NoiseModel:
    """variance = read^2 + shot * light by weighted least squares, neither below 0."""
    A = np.stack([np.ones(len(means)), np.array(means)], axis=1) * np.array(weights)[:, None]
    y = np.array(variances) * np.array(weights)
    (square, shot), residual = nnls(A, y)
    covariance = np.linalg.pinv(A.T @ A) * residual**2 / max(len(means) - 2, 1)
    read = math.sqrt(square)
    return NoiseModel(
        read=read,
        shot=float(shot),
        read_std=float(min(math.sqrt(covariance[0, 0]) / (2 * read), read)) if read else float(covariance[0, 0] ** 0.25),
        shot_std=float(math.sqrt(covariance[1, 1])),
        levels=tuple(sorted(zip(means, variances, strict=True))),
        how=how,
    )


def _about_planes(patches: Float[np.ndarray, "patches pixels"]) -> Float[np.ndarray, " patches"]:
    """The variance of each patch about its own plane."""
    y, x = np.mgrid[:SIDE_PX, :SIDE_PX]
    basis, _ = np.linalg.qr(np.stack([np.ones(SIDE_PX**2), x.ravel(), y.ravel()], axis=1))
    residual = patches - (patches @ basis) @ basis.T
    return (residual**2).sum(axis=1) / (SIDE_PX**2 - 3)
