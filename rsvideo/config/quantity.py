"""Quantities as people write them: times as 1/50, 20ms or 0.02, lengths in pixels, frames a second."""

import math
import re
from fractions import Fraction

HAND_HELD_LIMIT = 1.0  # seconds; a hand-held exposure or readout beyond this is a slip of the unit
SLOWEST_RATE, FASTEST_RATE = Fraction(1, 100), 100_000  # frames a second; a rate outside is a slip of the unit
_SAME_RATE = 0.002  # of a rate; 30 and 29.97 are one mode of a camera, 30 and 25 are two
_MOST_CHARACTERS = 60  # of a quantity; patterns and exact fractions take long over more
_RATE = re.compile(r"\s*(\d{1,20}(?:\.\d{0,20})?|\.\d{1,20})(?:\s*/\s*(\d{1,20}))?\s*")

_SIZE = re.compile(r"\s*(\d{1,6})\s*[xX]\s*(\d{1,6})\s*")
MOST_PIXELS = 100_000_000  # of a picture of a clip: cameras film 12288 x 6480 at most

_SECONDS_PER_UNIT = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6}
_TIME = re.compile(r"\s*([-+]?)(\d+\.?\d*(?:e[-+]?\d+)?|\.\d+)(?:\s*/\s*(\d+\.?\d*))?\s*([a-zµμ]*)\s*", re.IGNORECASE)
_CLOCK = r"((?:\d+:){0,2}\d+(?:\.\d*)?)"
_SPAN = re.compile(rf"\s*{_CLOCK}\s*-\s*{_CLOCK}\s*")


def seconds(name: str, text: str) -> float:
    """The time that `text` writes; `name` is what an error calls it."""
    rule = f"{name} must be a time such as 1/50, 20ms or 0.02 (seconds), got {_bounded(name, text)!r}"
    if not (match := _TIME.fullmatch(text)):
        raise ValueError(rule + ("; write the decimal point as a point" if "," in text else ""))
    sign, number, divisor, unit = match.groups()
    if unit.lower() not in _SECONDS_PER_UNIT:
        raise ValueError(f"{rule}; the units are s, ms and us")
    if divisor is not None and float(divisor) == 0:
        raise ValueError(f"{rule}; it divides by zero")
    if sign == "-":
        raise ValueError(f"{name} must not be negative, got {text!r}; a readout that runs upwards is --direction bottom-to-top")
    return float(number) / float(divisor or 1) * _SECONDS_PER_UNIT[unit.lower()]


def _bounded(name: str, text: str) -> str:
    """The text itself, if it is short enough to be a quantity."""
    if len(text) > _MOST_CHARACTERS:
        raise ValueError(f"{name} must be written in at most {_MOST_CHARACTERS} characters, got {len(text)}: {text[:20]!r}...")
    return text


def frame_rate(text: str) -> Fraction:
    """The frames a second that `text` writes; ValueError for what is none, or what no camera has."""
    value = Fraction(0)
    if (found := _RATE.fullmatch(_bounded("rate", text))) and (divisor := int(found[2] or 1)):
        value = Fraction(found[1]) / divisor
    if not SLOWEST_RATE <= value <= FASTEST_RATE:
        raise ValueError(
            f"rate must be a number of frames a second such as 25 or 24000/1001, from {SLOWEST_RATE} to {FASTEST_RATE}, got {text!r}"
        )
    return value


def same_rate(one: float, other: float) -> bool:
    """Whether two frame rates are one mode of a camera: NTSC's 29.97 is called 30."""
    return abs(one / other - 1) < _SAME_RATE


def hand_held(name: str, value: float, *, zero: bool) -> float:
    """`value` itself, in seconds, if a hand-held camera can have it; `zero` says whether 0 counts."""
    if 0 < value <= HAND_HELD_LIMIT or (zero and value == 0):
        return value
    slip = f"is it in milliseconds? a unit may follow, as in {value:g}ms" if value > HAND_HELD_LIMIT else "no light is collected in no time"
    raise ValueError(f"{name} must lie in {'[' if zero else '('}0, {HAND_HELD_LIMIT:g}] s, got {value:g} s; {slip}")


def span(text: str) -> tuple[float, float]:
    """The seconds that `00:10-00:12` or `10-12.5` writes."""
    rule = f"range must read like 00:10-00:12 or 10-12.5, from an earlier to a later time in the clip, got {_bounded('range', text)!r}"
    if not (match := _SPAN.fullmatch(text)):
        raise ValueError(rule)
    first, last = (sum(float(part) * 60**power for power, part in enumerate(reversed(end.split(":")))) for end in match.groups())
    if not first < last:
        raise ValueError(rule)
    return first, last


def size(text: str) -> tuple[int, int]:
    """The columns and rows that `1920x1080` writes."""
    if not (found := _SIZE.fullmatch(_bounded("size", text))) or not 0 < int(found[1]) * int(found[2]) <= MOST_PIXELS:
        raise ValueError(f"size must read like 1920x1080, columns x rows, at most {MOST_PIXELS / 1e6:g} Mpx, got {text!r}")
    return int(found[1]), int(found[2])


def pixels(name: str, text: str) -> float:
    """The positive length in pixels that `text` writes."""
    number = _bounded(name, text).strip().lower().removesuffix("px")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not (0 < value < math.inf):
        raise ValueError(f"{name} must be a positive number of pixels such as 1400, got {text!r}" + (_MM if number.endswith("mm") else ""))
    return value


_MM = "; pixels = millimetres * width of the picture in pixels / width of the sensor in millimetres"
