"""Readout time from the bands that a flickering light leaves across a picture.

A light that flickers f times a second multiplies scanline r of frame k, read at t_k + r t_r, by m(t_k + r t_r), so that the logarithm of
a scanline's mean light is the scene's plus a wave of nu = f t_r cycles a row. The period 1 / nu of the bands in rows gives
t_r = nu / f (Forssen & Ringaby, CVPR 2010); an exposure blurs the bands but leaves their period as it is.

The wave is found by `flicker_wave`; here it becomes a time. The light's frequency is taken as exact.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from calibration.timing.cannot_tell import CannotTellError
from calibration.timing.flicker_wave import standing, wandering
from calibration.timing.wave_search import NYQUIST
from rsvideo.physics.shutter import Direction

LONGEST_S = 0.5  # no photograph that is taken by hand is read more slowly
SLOW_S = 0.25  # the slowest electronic shutters of photographs
SHORTEST_S = 1e-3  # faster than any rolling shutter on sale
BLOCKS = 16  # of columns, which bands cross alike and a scene does not
MAINS_HZ = (50.0, 60.0)
_LAMPS_HZ = (100.0, 120.0)  # at which lamps on mains flicker
_FEWEST_BANDS = 0.2  # in a frame
_GRID = 8  # readouts that are tried a cycle a frame's height
_BEYOND = 1.05  # times the longest readout, up to which is searched, so that one that is too long is noticed
_TOLERANCE = 0.01  # of the longest readout, by which the one found may exceed it
_TOO_FAST = 1.001  # times the bands' Nyquist frequency, which leaves room for rounding
_DISAGREE = 5.0  # deviations between photographs
_VAGUE = 0.05  # of the readout; a larger deviation is no answer
_EDGE_ROWS = 1.0  # of the frame's height: resampling of the sensor's rows leaves half a one uncertain at either edge
_SAME_PHASE = 0.02  # cycles a frame, by which bands of two lights must differ to be distinguished


@dataclass(frozen=True, kw_only=True)
class Bands:
    """A readout, from bands."""

    light: float  # Hz, of the wave that was measured
    period: float  # rows
    row_time: float  # seconds
    readout: float  # seconds
    std: float  # seconds, of the readout; the light's frequency taken as exact
    direction: Direction | None  # None: they do not say it
    frames: int
    notes: tuple[str, ...] = ()  # what was assumed


def row_profile(light: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "blocks rows"]:
    """The mean light of every scanline within equal blocks of columns, of a picture whose first axis counts scanlines."""
    grey = light.mean(axis=2, dtype=float)
    return np.stack([part.mean(axis=1) for part in np.array_split(grey, min(BLOCKS, grey.shape[1]), axis=1)])


def measure(
    profiles: Sequence[Float[np.ndarray, "blocks rows"]],
    times: Sequence[float],
    flicker: float,
    *,
    longest: float | None = None,
    downwards: tuple[Direction, Direction] = (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP),
) -> Bands:
    """The readout of frames that begin at `times`, under a light of `flicker` Hz; CannotTellError where they do not show it.

    `longest` is the frame's period, which no readout exceeds; a photograph has none. `downwards` names the direction in which scanlines
    count, and the other.
    """
    if len(profiles) != len(times) or not profiles:
        raise ValueError(f"every frame needs its time, got {len(profiles)} frames and {len(times)} times")
    if flicker in MAINS_HZ:
        found = measure(profiles, times, 2 * flicker, longest=longest, downwards=downwards)
        return replace(found, notes=(f"mains of {flicker:g} Hz make lamps flicker at {2 * flicker:g} Hz, which is taken", *found.notes))
    light, begins = np.stack(profiles), np.array(times, float)
    if not light.mean() > 0:
        raise CannotTellError("the picture is black; is the light on?")
    rows = light.shape[2]
    beyond: tuple[str, ...] = ()
    if longest is None and (longest := min(LONGEST_S, NYQUIST * rows / flicker)) < SLOW_S:
        beyond = (f"a readout of more than {longest * 1e3:.4g} ms was not thought of",)
    if (most := flicker * longest / rows) > _TOO_FAST * NYQUIST:
        raise CannotTellError(
            f"{rows} rows are too few for a light of {flicker:g} Hz, whose bands may be only {1 / most:.2g} rows apart; take a slower one"
        )
    grid = np.arange(max(SHORTEST_S, _FEWEST_BANDS / flicker) * flicker / rows, most * _BEYOND, 1 / (_GRID * rows))
    phases = 2 * np.pi * flicker * (begins - begins[0])
    wave, sign = wandering(light, phases, grid) or standing(light, phases, grid)
    if wave.nu > (1 + _TOLERANCE) * most:
        raise CannotTellError(
            f"the bands are {1 / wave.nu:.4g} rows apart, which means a readout longer than a frame's {longest * 1e3:.4g} ms;"
            " is the light's frequency right?"
        )
    nu = wave.nu
    std = float(np.hypot(wave.spread(), nu * _EDGE_ROWS / rows))
    if std > _VAGUE * nu:
        raise CannotTellError(f"the bands say the readout only to {std / nu:.0%}; more frames, a faster light or a plainer wall say more")
    return Bands(
        light=flicker,
        period=1 / nu,
        row_time=nu / flicker,
        readout=rows * nu / flicker,
        std=rows * std / flicker,
        direction=None if sign is None else downwards[0 if sign > 0 else 1],
        frames=len(light),
        notes=_rivals(flicker, rows * nu / flicker, sign, begins, longest) + _upwards(flicker, sign, begins, downwards[1]) + beyond,
    )


def combined(bands: Sequence[Bands]) -> Bands:
    """What several photographs of one mode say together: the mean, whose deviation is the larger of what is stated and what is observed."""
    readouts, stds = np.array([one.readout for one in bands]), np.array([one.std for one in bands])
    weights = stds**-2 / np.sum(stds**-2)
    mean, rows = float(weights @ readouts), bands[0].readout / bands[0].row_time
    spread = float(np.sqrt(weights @ (readouts - mean) ** 2 / max(len(bands) - 1, 1)))
    if (apart := float(np.max(np.abs(readouts - mean) / stds))) > _DISAGREE:
        between = f"{1e3 * readouts.min():.4g} to {1e3 * readouts.max():.4g} ms"
        raise CannotTellError(f"the photographs say {between}, {apart:.1f} deviations apart; are all of one mode, under one light?")
    row_time = mean / rows
    return replace(
        bands[0],
        period=1 / (bands[0].light * row_time),
        row_time=row_time,
        readout=mean,
        std=max(spread, float(stds.min())),
        frames=len(bands),
        notes=tuple(dict.fromkeys(note for one in bands for note in one.notes)),
    )


def _rivals(flicker: float, readout: float, sign: int | None, begins: np.ndarray, longest: float) -> tuple[str, ...]:
    """Lights of half or double the frequency that would look the same, where there is reason to think of them."""
    if flicker not in _LAMPS_HZ and len(begins) == 1:
        return ()
    advance = flicker * float(np.median(np.diff(begins))) if len(begins) > 1 else None
    rivals = []
    for other in (flicker / 2, 2 * flicker):
        if not SHORTEST_S <= (slower := readout * flicker / other) <= longest:
            continue
        same_wander = (
            advance is None
            or sign is None
            or any(_apart(turn * advance * other / flicker, sign * advance) < _SAME_PHASE for turn in (1, -1))
        )
        if same_wander:
            rivals.append(f"{slower * 1e3:.4g} ms if it flickers at {other:g} Hz")
    alike = f" (at this frame rate lights {1 / float(np.median(np.diff(begins))):.4g} Hz apart look alike)" if advance is not None else ""
    return (f"the light is taken to flicker at {flicker:g} Hz{alike}; the readout is {' and '.join(rivals)}",) if rivals else ()


def _upwards(flicker: float, sign: int | None, begins: np.ndarray, direction: Direction) -> tuple[str, ...]:
    """The lights whose bands would wander so under a readout in the other direction, which is the usual one."""
    if sign != -1:
        return ()
    rate = 1 / float(np.median(np.diff(begins)))
    other = round(2 * flicker / rate) * rate - flicker
    return (
        f"the readout is {direction.value}, as few cameras do it; is it surely a light of {flicker:g} Hz? one of {other:.4g} Hz,"
        f" or of {rate:.4g} Hz more or less, would leave such bands under the usual one",
    )


def _apart(one: float, other: float) -> float:
    """Of two phases in cycles."""
    return abs((one - other + 0.5) % 1 - 0.5)
