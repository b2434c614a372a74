"""Quantities as people write them: times as 1/50, 20ms or 0.02, lengths in pixels, frames a second."""

import math
import re
from fractions import Fraction

LONGEST = 1.0  # seconds; a hand-held exposure or readout beyond this is a slip of the unit

_SECONDS_PER_UNIT = {"": 1.0, "s": 1.0, "ms": 1e-3, "us": 1e-6, "µs": 1e-6, "μs": 1e-6}
_TIME = re.compile(r"\s*([-+]?)(\d+\.?\d*(?:e[-+]?\d+)?|\.\d+)(?:\s*/\s*(\d+\.?\d*))?\s*([a-zµμ]*)\s*", re.IGNORECASE)
_CLOCK = r"((?:\d+:){0,2}\d+(?:\.\d*)?)"
_SPAN = re.compile(rf"\s*{_CLOCK}\s*-\s*{_CLOCK}\s*")


def seconds(name: str, text: str) -> float:
    """The time that `text` writes; `name` is what an error calls it."""
    rule = f"{name} must be a time such as 1/50, 20ms or 0.02 (seconds), got {text!r}"
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


def frame_rate(text: str) -> Fraction:
    """Frames a second, as people write them."""
    try:
        value = Fraction(text[:40])
    except (ValueError, ZeroDivisionError):
        value = Fraction(0)
    if not 0 < value <= 100_000:
        raise ValueError(f"rate must be a number of frames a second such as 25 or 24000/1001, got {text[:40]!r}")
    return value


def hand_held(name: str, value: float, *, zero: bool) -> float:
    """`value` itself, in seconds, if a hand-held camera can have it; `zero` says whether 0 counts."""
    if 0 < value <= LONGEST or (zero and value == 0):
        return value
    slip = f"is it in milliseconds? a unit may follow, as in {value:g}ms" if value > LONGEST else "no light is collected in no time"
    raise ValueError(f"{name} must lie in {'[' if zero else '('}0, {LONGEST:g}] s, got {value:g} s; {slip}")


def span(text: str) -> tuple[float, float]:
    """The seconds that `00:10-00:12` or `10-12.5` writes."""
    rule = f"range must read like 00:10-00:12 or 10-12.5, from an earlier to a later time in the clip, got {text!r}"
    if not (match := _SPAN.fullmatch(text)):
        raise ValueError(rule)
    first, last = (sum(float(part) * 60**power for power, part in enumerate(reversed(end.split(":")))) for end in match.groups())
    if not first < last:
        raise ValueError(rule)
    return first, last


def pixels(name: str, text: str) -> float:
    """The positive length in pixels that `text` writes."""
    number = text.strip().lower().removesuffix("px")
    try:
        value = float(number)
    except ValueError:
        value = math.nan
    if not (0 < value < math.inf):
        raise ValueError(f"{name} must be a positive number of pixels such as 1400, got {text!r}" + (_MM if number.endswith("mm") else ""))
    return value


_MM = "; pixels = millimetres * width of the picture in pixels / width of the sensor in millimetres"
