"""How codes stand for light, from one scene taken at several exposures: tone curve, clipping and noise.

A pixel of radiance E_i, exposed t_j seconds, has code Z_ij with light(Z_ij) = E_i t_j. A curve is judged by what it leaves of
log light(Z_ij) - log t_j, which must be the same for all j.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float, Float32, UInt
from scipy.optimize import nnls
from scipy.special import chdtri

from rsvideo.physics import tone
from rsvideo.physics.tone import Transfer

MOST_PIXELS = 60_000_000
_PATCH = 8  # px, the side of the patches that are looked at
_PATCHES = 1600
_ENTRIES = 65  # of a curve that is written down
_EDGE = 0.02  # of the codes: so near to black and to clipping, codes say little of light
_CALM = 0.1  # how much a patch may vary, as part of its mean
_AS_GOOD, _CLOSE = 1.3, 0.01  # a standard's curve is taken if it leaves no more than that times the free curve's rest, or so little
_SMOOTH, _MOST_TOLD = 3.0, 300  # weight of the free curve's smoothness, and patches that it is found from
_LEVELS, _FLAT = 24, 0.2  # of light, at each of which the calmest patches count as flat
_PLATEAU = 5e-4  # of the pixels
_NOMINAL = [
    8000,
    6400,
    5000,
    4000,
    3200,
    2500,
    2000,
    1600,
    1250,
    1000,
    800,
    640,
    500,
    400,
    320,
    250,
    200,
    160,
    125,
    100,
    80,
    60,
    50,
    40,
    30,
]
_NOMINAL += [25, 20, 15, 13, 10, 8, 6, 5, 4]


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """One photograph of the series."""

    name: str
    samples: UInt[np.ndarray, "rows cols channels"]  # codes
    exposure: float  # seconds
    linear: bool = False  # whether its codes are light, as those of raw are


@dataclass(frozen=True, kw_only=True)
class NoiseModel:
    """variance = read^2 + shot * light, and how surely."""

    read: float
    shot: float
    read_std: float
    shot_std: float
    levels: tuple[tuple[float, float], ...]  # (light, variance) that it was fitted to
    how: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """What the series tells."""

    transfer: Transfer | None  # None: no standard's curve fits
    curve: Float[np.ndarray, " entries"]  # light at codes evenly spaced from 0 to 1, by either
    std: float  # of the logarithm of light
    rests: dict[str, float]  # of each curve tried
    black: float
    clip: float | None  # None: nothing was clipped
    noise: NoiseModel | None
    exposures: tuple[float, ...]
    notes: tuple[str, ...]


def exact(exposures: Sequence[float]) -> tuple[float, ...]:
    """Times as shutters keep them: where all are the rounded ones that cameras display, whole thirds of a stop."""
    nominal = {round(1 / d, 9) for d in _NOMINAL} | {0.3, 0.4, 0.5, 0.6, 0.8, 1.0}
    if all(any(abs(t / n - 1) < 2e-3 for n in nominal) for t in exposures):
        return tuple(2.0 ** (round(3 * math.log2(t)) / 3) for t in exposures)
    return tuple(exposures)


def measure(shots: Sequence[Shot]) -> Response:
    """The response of the camera that took `shots`."""
    _check(shots)
    ordered = sorted(shots, key=lambda shot: shot.exposure)
    codes = [_coded(shot) for shot in ordered]
    times = np.array([shot.exposure for shot in ordered])
    black, clip = _black(codes[0]), _clip(codes)
    high = (clip or 1.0) - _EDGE
    patches, usable = _patches(codes, black, high)
    if (usable.sum(axis=1) >= 2).sum() < 20:
        raise ValueError("the series must show the same places well exposed at two exposures at least; are they a stop or two apart?")
    candidates = [Transfer.LINEAR] if ordered[0].linear else list(Transfer)
    rests = {transfer.value: _rest(_decoded(transfer, patches), times, usable) for transfer in candidates}
    notes = []
    best = min(candidates, key=lambda transfer: rests[transfer.value])
    curve, chosen = _curve_of(best), best
    if not ordered[0].linear:
        free = _debevec(patches, times, usable)
        rests["free"] = _rest(np.interp(patches, np.linspace(0, 1, len(free)), free), times, usable)
        if rests[best.value] > max(_AS_GOOD * rests["free"], _CLOSE):
            curve, chosen = np.interp(np.linspace(0, 1, _ENTRIES), np.linspace(0, 1, len(free)), free), None
            notes.append(
                f"no standard's curve fits; the nearest, {best.value}, leaves {rests[best.value]:.1%} of light, its own {rests['free']:.1%}"
            )
    if clip is None:
        notes.append("no picture is clipped, so where highlights are lost is not known; a longer exposure would show it")
    return Response(
        transfer=chosen,
        curve=curve,
        std=rests[chosen.value if chosen else "free"],
        rests=rests,
        black=black,
        clip=clip,
        noise=_noise(ordered, codes, curve, high),
        exposures=tuple(times.tolist()),
        notes=tuple(notes),
    )


def _check(shots: Sequence[Shot]) -> None:
    if len(shots) < 2 or len({shot.exposure for shot in shots}) < 2:
        raise ValueError(
            f"a response needs one scene at two exposures or more, got {len(shots)} pictures of {len({s.exposure for s in shots})}"
        )
    for shot in shots:
        if shot.samples.shape != shots[0].samples.shape or shot.samples.dtype != shots[0].samples.dtype or shot.linear != shots[0].linear:
            raise ValueError(f"the pictures must be of one size, depth and kind, {shot.name} is not like {shots[0].name}")
        if shot.samples[..., 0].size > MOST_PIXELS:
            raise ValueError(f"{shot.name} must hold at most {MOST_PIXELS / 1e6:g} Mpx")
        if not 1e-6 <= shot.exposure <= 3600:
            raise ValueError(f"the exposure of {shot.name} must lie in 1 us to an hour, got {shot.exposure:g} s")


def _coded(shot: Shot) -> Float32[np.ndarray, "rows cols"]:
    """The green codes, or the only ones, in [0, 1]."""
    plane = shot.samples[..., min(1, shot.samples.shape[2] - 1)]
    return plane.astype(np.float32) / np.iinfo(plane.dtype).max


def _black(codes: Float32[np.ndarray, "rows cols"]) -> float:
    """The lowest code of the darkest picture, if it holds any darkness."""
    low = float(np.quantile(codes, 1e-3))
    return low if low < 0.1 else 0.0


def _clip(codes: Sequence[Float32[np.ndarray, "rows cols"]]) -> float | None:
    """The lowest code of the plateau at the top, if there is one: many pixels at the top, few just below."""
    top = max(float(plane.max()) for plane in codes)
    step = 1 / 255
    at = sum(int((plane >= top - 1.5 * step).sum()) for plane in codes)
    below = sum(int(((plane < top - 2.5 * step) & (plane >= top - 5.5 * step)).sum()) for plane in codes)
    total = sum(plane.size for plane in codes)
    return top - 1.5 * step if at > max(_PLATEAU * total, 2 * below) else None


def _patches(
    codes: Sequence[Float32[np.ndarray, "rows cols"]], black: float, high: float
) -> tuple[Float[np.ndarray, "patches n"], Bool[np.ndarray, "patches n"]]:
    """Mean codes of the calmest patches of all brightnesses in every picture, and where they can be trusted: no pixel of the patch is
    clipped at either end, and they vary so little that the light of their mean is the mean of their light."""
    blocks = [_blocks(plane) for plane in codes]
    means = np.stack([of.mean(axis=1) for of in blocks], axis=1).astype(float)
    spread = np.stack([of.std(axis=1) for of in blocks], axis=1)
    inside = np.stack([(of.min(axis=1) > black) & (of.max(axis=1) < high) for of in blocks], axis=1)
    level = np.argsort(np.argsort(means.mean(axis=1))) * 40 // len(means)  # forty groups, as many patches in each
    kept = [np.flatnonzero(level == k)[np.argsort(spread[level == k].max(axis=1))[: _PATCHES // 40]] for k in range(40)]
    chosen = np.concatenate(kept)
    usable = inside & (spread < _CALM * (means - black)) & (means > black + _EDGE)
    return means[chosen], usable[chosen]


def _blocks(plane: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "patches pixels"]:
    rows, cols = (side // _PATCH for side in plane.shape)
    cut = plane[: rows * _PATCH, : cols * _PATCH].reshape(rows, _PATCH, cols, _PATCH)
    return cut.swapaxes(1, 2).reshape(rows * cols, _PATCH * _PATCH)


def _decoded(transfer: Transfer, codes: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    return tone.decode(transfer, codes.astype(np.float32)).astype(float)


def _curve_of(transfer: Transfer) -> Float[np.ndarray, " entries"]:
    curve = np.maximum.accumulate(np.maximum(_decoded(transfer, np.linspace(0, 1, _ENTRIES)), 0))
    return curve / curve[-1]


def _rest(light: Float[np.ndarray, "patches n"], times: Float[np.ndarray, " n"], usable: Bool[np.ndarray, "patches n"]) -> float:
    """What a curve leaves: the root mean square of log radiance about each patch's own mean."""
    usable = usable & (light > 0)
    usable = usable & (usable.sum(axis=1, keepdims=True) >= 2)
    if usable.sum() < 20:
        return math.inf
    radiance = np.where(usable, np.log(np.where(usable, light, 1.0)) - np.log(times), 0.0)
    count = usable.sum(axis=1, keepdims=True)
    about = np.where(usable, radiance - radiance.sum(axis=1, keepdims=True) / np.maximum(count, 1), 0.0)
    return float(np.sqrt((about**2).sum() / (usable.sum() - (count > 0).sum())))


def _debevec(
    patches: Float[np.ndarray, "patches n"], times: Float[np.ndarray, " n"], usable: Bool[np.ndarray, "patches n"]
) -> Float[np.ndarray, "256"]:
    """Light by code, rising, and 1 at the highest code: Eq. (3) of Debevec and Malik (1997), g(Z_ij) - log E_i = log t_j with g'' small.

    OpenCV's solver cannot leave out clipped patches, which bend its curve near white; so the equations are written out here, and codes
    between two entries of g count for both.
    """
    told = np.flatnonzero(usable.sum(axis=1) >= 2)
    told = told[np.linspace(0, len(told) - 1, min(_MOST_TOLD, len(told))).astype(int)]
    i, j = np.nonzero(usable[told])
    z = 255 * patches[told][i, j]
    k = np.minimum(z.astype(int), 254)
    w = np.minimum(z, 255 - z) / 127.5
    A, lines = np.zeros((len(i) + 255, 256 + len(told))), np.arange(len(i))
    A[lines, k], A[lines, k + 1], A[lines, 256 + i] = w * (1 - z + k), w * (z - k), -w
    for entry in range(254):
        A[len(i) + entry, entry : entry + 3] = _SMOOTH * np.array([1.0, -2.0, 1.0])
    A[-1, 128] = 1.0  # the scale is free
    g = np.linalg.lstsq(A, np.concatenate([w * np.log(times)[j], np.zeros(255)]), rcond=None)[0][:256]
    light = np.maximum.accumulate(np.exp(np.clip(g, -50, 50)))
    return light / light[-1]


def _noise(
    shots: Sequence[Shot], codes: Sequence[Float32[np.ndarray, "rows cols"]], curve: Float[np.ndarray, " entries"], high: float
) -> NoiseModel | None:
    """From pictures that were taken twice, else from flat patches."""
    light = [np.interp(plane, np.linspace(0, 1, len(curve)), curve) for plane in codes]
    twins = [k for k in range(len(shots) - 1) if shots[k].exposure == shots[k + 1].exposure]
    means, variances, weights = [], [], []
    for k in twins or range(len(shots)):
        of = _blocks(codes[k])
        inside = (of.max(axis=1) < high) & (of.min(axis=1) > 0)
        mean = _blocks(light[k]).mean(axis=1)
        if twins:
            variance, freedom, quantile = _blocks((light[k] - light[k + 1]) / math.sqrt(2)).var(axis=1, ddof=1), _PATCH**2 - 1, 0.5
        else:
            variance, freedom, quantile = _about_planes(_blocks(light[k])), _PATCH**2 - 3, _FLAT
        edges = np.geomspace(1e-4, 1, _LEVELS + 1)
        for low, top in pairwise(edges.tolist()):
            here = inside & (mean >= low) & (mean < top)
            if here.sum() < 20:
                continue
            typical = float(np.quantile(variance[here], quantile)) * freedom / float(chdtri(freedom, 1 - quantile))
            if typical > 0:
                means.append(float(mean[here].mean()))
                variances.append(typical)
                weights.append(math.sqrt(float(here.sum())) / typical)
    if len(means) < 3:
        return None
    A = np.stack([np.ones(len(means)), np.array(means)], axis=1) * np.array(weights)[:, None]
    y = np.array(variances) * np.array(weights)
    (square, shot), rest = nnls(A, y)
    covariance = np.linalg.pinv(A.T @ A) * rest**2 / max(len(means) - 2, 1)
    read = math.sqrt(square)
    return NoiseModel(
        read=read,
        shot=float(shot),
        read_std=float(min(math.sqrt(covariance[0, 0]) / (2 * read), read)) if read else float(covariance[0, 0] ** 0.25),
        shot_std=float(math.sqrt(covariance[1, 1])),
        levels=tuple(sorted(zip(means, variances, strict=True))),
        how=f"{len(twins)} pairs of equal exposures" if twins else "the calmest patches at each level of light",
    )


def _about_planes(blocks: Float[np.ndarray, "patches pixels"]) -> Float[np.ndarray, " patches"]:
    """The variance of each patch about its own plane."""
    y, x = np.mgrid[:_PATCH, :_PATCH]
    basis, _ = np.linalg.qr(np.stack([np.ones(_PATCH**2), x.ravel(), y.ravel()], axis=1))
    rest = blocks - (blocks @ basis) @ basis.T
    return (rest**2).sum(axis=1) / (_PATCH**2 - 3)
