"""The wave that a flickering light leaves in the logarithm of scanlines' light, separated from the scene's rows.

In a clip the bands wander by f (t_k+1 - t_k) cycles a frame while the scene stays. What frames share is taken out, and the wave that is
left is fitted with phases that follow the frames' times within runs of a few frames, so that light and clock may drift slowly. The sign
of nu for which this succeeds is the direction of the readout. Where bands stand still, and in a photograph, the scene's own rows are
noise with a falling spectrum, which is whitened.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from calibration.timing.cannot_tell import CannotTellError
from calibration.timing.wave import Runs, Wave, fit_wave
from calibration.timing.wave_search import SURE, search

FEWEST_BANDS = 2.0  # in a picture whose bands do not wander
_FLOOR, _DARK = 0.05, 0.1  # of the mean light, and of that: keep logarithms and ratios of dark rows finite
_RUN = 8  # frames over which a light keeps its phase
_SHARED = 0.7  # of the energy of bands, that all columns share
_FOLLOWS = 0.7  # of the energy of bands, that follows the frames' times
_WANDERING = 0.1  # of a cycle a frame; less is standing still
_MOST_STRAY = 0.025  # cycles a frame; lamps, clocks and mains drift by less
_SMALL_STRAYS = np.linspace(-0.08, 0.08, 41)  # cycles a frame, that are tried where bands wander about as they should
_ALL_STRAYS = np.linspace(-0.5, 0.5, 101)  # where nothing is expected of them
_SCENE_WHITENING = np.array([1.0, -1.0])  # whitens a scene's rows, at first


def _logarithms(light: Float[np.ndarray, "frames parts rows"], *, over_mean: bool) -> Float[np.ndarray, "parts frames rows"]:
    """Of each part's rows; with `over_mean`, relative to their mean over frames, which takes out a scene that keeps still."""
    if over_mean:
        dark = _DARK * _FLOOR * light.mean()
        light = (light + dark) / (light + dark).mean(axis=0)
    return np.moveaxis(np.log(light + _FLOOR * light.mean()), 1, 0)


def wandering(
    light: Float[np.ndarray, "frames parts rows"], phases: Float[np.ndarray, " frames"], grid: Float[np.ndarray, " nus"]
) -> tuple[Wave, int | None] | None:
    """The wave that wanders through a clip, and its sign if that is certain; None where it is not expected to wander.

    `phases` are those of the light when frames begin, in radians; `grid` are the cycles a row that are tried.
    """
    length = min(_RUN, len(light))
    if length < 2 or abs(np.exp(1j * phases[:length]).mean()) > np.cos(np.pi * _WANDERING):
        return None
    raw = _runs(_logarithms(light[: len(light) // length * length], over_mean=True), phases, length, scene=True)
    loose = search(raw.loose(), grid, (1,), np.ones(1))
    signs = (1, -1) if length > 2 else (1,)
    wave = search(raw, grid, signs, np.ones(1)) if loose is None else search(raw, grid, signs, loose.taps, rounds=0)
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
        _refuse_stray(_stray(wave, raw, _SMALL_STRAYS))
    return wave, _sign(wave, raw, light, length)


def standing(
    light: Float[np.ndarray, "frames parts rows"], phases: Float[np.ndarray, " frames"], grid: Float[np.ndarray, " nus"]
) -> tuple[Wave, None]:
    """The wave that is common to all columns of a picture, or of a clip in which bands stand still or drift in no time with the frames."""
    if len(light) > 2 and (adrift := _adrift(light, phases, grid)):
        return _with_enough_bands(adrift), None
    parts = _logarithms(light.mean(axis=0, keepdims=True), over_mean=False)
    raw = Runs.of(parts[:, None], np.zeros((1, 1)), scene=False)
    wave = search(raw, grid[grid * light.shape[2] > 1], (1,), _SCENE_WHITENING)
    if wave is None:
        raise CannotTellError("no bands stand out from the scene; film a plain wall, more closely lit, with a short exposure")
    if (shared := wave.alike()) < _SHARED:
        raise CannotTellError(f"columns share only {shared:.0%} of what looks like bands, so it is the scene's; film a plain wall")
    return _with_enough_bands(wave), None


def _sign(wave: Wave, raw: Runs, light: np.ndarray, length: int) -> int | None:
    """The sign of the direction in which the wave's phases count; None where the other one is nearly as likely."""
    if length == 2:  # without a scene taken out, which leaves nothing to tell the directions apart
        runs, parts = raw.phases.shape[0], raw.parts.shape[0]
        logarithms = _logarithms(light[: 2 * runs], over_mean=False)
        pairs = Runs.of(logarithms.reshape(parts, runs, 2, -1), raw.phases, scene=False)
        both = [replace(wave, runs=pairs.whitened(_SCENE_WHITENING), taps=_SCENE_WHITENING, sign=sign) for sign in (1, -1)]
        better, worse = sorted(both, key=lambda one: one.gain, reverse=True)
    else:
        better, worse = wave, replace(wave, sign=-wave.sign).refined()
    return better.sign if better.gain > worse.gain + SURE else None


def _adrift(light: np.ndarray, phases: np.ndarray, grid: np.ndarray) -> Wave | None:
    """A wave that moves over a scene that does not, by whatever phases; refused where it follows a light of another frequency."""
    logarithms = _logarithms(light, over_mean=True)
    wave = search(Runs.of(logarithms[:, None], phases[None], scene=True).loose(), grid, (1,), np.ones(1))
    if wave is None or wave.alike() <= _SHARED:
        return None
    length = min(_RUN, len(light))
    raw = _runs(logarithms[:, : len(light) // length * length], phases, length, scene=False)
    stray = _stray(replace(wave, harmonics=1), raw, _ALL_STRAYS)
    if replace(wave, runs=_ahead(raw, stray)).follows(_ahead(raw, stray)) > _FOLLOWS * wave.follows(raw.loose()):
        ahead = float(np.angle(np.exp(1j * np.diff(raw.phases, axis=1)).mean())) / (2 * np.pi)
        _refuse_stray(min((stray, stray + 2 * ahead), key=abs))  # of a readout in either direction
    return wave


def _runs(logarithms: Float[np.ndarray, "parts frames rows"], phases: np.ndarray, length: int, *, scene: bool) -> Runs:
    """Frames in runs of `length`."""
    parts, frames, rows = logarithms.shape
    by_run = logarithms.reshape(parts, frames // length, length, rows)
    return Runs.of(by_run, phases[:frames].reshape(frames // length, length), scene=scene)


def _ahead(runs: Runs, stray: float) -> Runs:
    """The same with waves that go on by so many cycles a frame more."""
    return replace(runs, phases=runs.phases + 2 * np.pi * stray * np.arange(runs.phases.shape[1]))


def _stray(wave: Wave, raw: Runs, tried: np.ndarray) -> float:
    """By how many cycles a frame, of those tried, the bands most likely wander beyond what the frames' times say."""
    shares = [fit_wave(raw.values, _ahead(raw, stray), wave.sign * wave.nu, wave.harmonics)[0] for stray in tried]
    return float(tried[int(np.argmax(shares))])


def _refuse_stray(stray: float) -> None:
    if abs(stray) > _MOST_STRAY:
        raise CannotTellError(
            f"the bands wander by {abs(stray):.2g} of their period a frame otherwise than those of a light of this frequency"
            " at this frame rate; is the frequency right, and does the clip play at the rate at which it was recorded?"
        )


def _with_enough_bands(wave: Wave) -> Wave:
    """The wave itself, if it has bands enough to be recognised without the frames' times."""
    if (bands := wave.nu * wave.runs.parts.shape[-1]) < FEWEST_BANDS:
        raise CannotTellError(
            f"only {bands:.2g} bands are in a frame, and they do not wander with the frames' times, so that a scene may imitate them;"
            " take a faster light, or a frame rate that does not divide its frequency"
        )
    return wave
