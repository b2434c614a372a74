"""How codes stand for light, from one scene taken at several exposures: tone curve, clipping and noise.

A pixel of radiance E_i, exposed t_j seconds, has code Z_ij with light(Z_ij) = E_i t_j. A curve is judged by what it leaves of
log light(Z_ij) - log t_j, which must be the same for all j.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from calibration.radiometry.exposure_series import Photograph, check, codes
from calibration.radiometry.noise_fit import NoiseModel, fit_noise
from calibration.radiometry.patches import EDGE, calmest
from calibration.radiometry.response_curves import ENTRIES, decoded, free_curve, misfit, standard_curve
from rsvideo.physics.tone import Transfer

_FEWEST_PATCHES = 20  # that are well exposed twice
_AS_GOOD, _CLOSE = 1.3, 0.01  # a standard's curve is taken if it leaves no more than that times the free curve's rest, or so little
_DARKEST, _DARK = 1e-3, 0.1  # quantile of the darkest picture's codes that is its black, unless it is brighter than that
_CODE = 1 / 255  # one step of 8 bits
_PLATEAU, _JUST_BELOW = 1.5, (2.5, 5.5)  # steps below the highest code: what counts as clipped, and with what it is compared
_CLIPPED, _STEEP = 5e-4, 2  # of the pixels at least are on the plateau, and so many times as many as just below


@dataclass(frozen=True, kw_only=True, eq=False)
class Response:
    """How a camera's codes stand for light."""

    transfer: Transfer | None  # None: no standard's curve fits
    curve: Float[np.ndarray, " entries"]  # light at codes evenly spaced from 0 to 1, by either
    std: float  # of the logarithm of light
    misfits: dict[str, float]  # the same of each curve that was tried
    black: float  # the code, from 0 to 1, of no light
    clip: float | None  # the code from which on highlights are lost; None: nothing was clipped
    noise: NoiseModel | None  # None: too few flat patches
    exposures: tuple[float, ...]  # seconds, rising
    notes: tuple[str, ...]


def measure(series: Sequence[Photograph]) -> Response:
    """The response of the camera that took a series."""
    check(series)
    ordered = sorted(series, key=lambda one: one.exposure)
    planes, times = [codes(one) for one in ordered], np.array([one.exposure for one in ordered])
    black, clip = _black(planes[0]), _clip(planes)
    high = (clip or 1.0) - EDGE
    patches, usable = calmest(planes, black, high)
    if (usable.sum(axis=1) >= 2).sum() < _FEWEST_PATCHES:
        raise ValueError("the series must show the same places well exposed at two exposures at least; are they a stop or two apart?")
    candidates = [Transfer.LINEAR] if ordered[0].linear else list(Transfer)
    misfits = {transfer.value: misfit(decoded(transfer, patches), times, usable) for transfer in candidates}
    notes = []
    best = min(candidates, key=lambda transfer: misfits[transfer.value])
    curve, chosen = standard_curve(best), best
    if not ordered[0].linear:
        free = free_curve(patches, times, usable)
        entries = np.linspace(0, 1, len(free))
        misfits["free"] = misfit(np.interp(patches, entries, free), times, usable)
        if misfits[best.value] > max(_AS_GOOD * misfits["free"], _CLOSE):
            curve, chosen = np.interp(np.linspace(0, 1, ENTRIES), entries, free), None
            nearest, own = misfits[best.value], misfits["free"]
            notes.append(f"no standard's curve fits; the nearest, {best.value}, leaves {nearest:.1%} of light, its own {own:.1%}")
    if clip is None:
        notes.append("no picture is clipped, so where highlights are lost is not known; a longer exposure would show it")
    return Response(
        transfer=chosen,
        curve=curve,
        std=misfits[chosen.value if chosen else "free"],
        misfits=misfits,
        black=black,
        clip=clip,
        noise=fit_noise(ordered, planes, curve, high),
        exposures=tuple(times.tolist()),
        notes=tuple(notes),
    )


def _black(plane: Float32[np.ndarray, "rows cols"]) -> float:
    """The lowest code of the darkest picture, if it holds any darkness."""
    low = float(np.quantile(plane, _DARKEST))
    return low if low < _DARK else 0.0


def _clip(planes: Sequence[Float32[np.ndarray, "rows cols"]]) -> float | None:
    """The lowest code of the plateau at the top, if there is one: many pixels at the top, few just below."""
    top = max(float(plane.max()) for plane in planes)
    plateau, (nearest, farthest) = top - _PLATEAU * _CODE, _JUST_BELOW
    at = sum(int((plane >= plateau).sum()) for plane in planes)
    below = sum(int(((plane < top - nearest * _CODE) & (plane >= top - farthest * _CODE)).sum()) for plane in planes)
    total = sum(plane.size for plane in planes)
    return plateau if at > max(_CLIPPED * total, _STEEP * below) else None
