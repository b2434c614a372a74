"""The types of a request's values: quantities as people write them (1/50, 20ms, 1400px), checked where they enter."""

import math
from collections.abc import Callable
from fractions import Fraction
from typing import Annotated, Any

from pydantic import BeforeValidator, WithJsonSchema

from rsvideo.config import quantity
from rsvideo.config.quantity import frame_rate, hand_held, seconds
from rsvideo.config.yaml import meant, shown
from rsvideo.physics.tone import Transfer


def text(value: object, rule: str) -> str:
    """A word or a number as it would be written; ValueError, with the rule, for anything else."""
    if isinstance(value, bool) or not isinstance(value, str | int | float):
        raise ValueError(f"{rule}, got {shown(value)}")
    return str(value)


def _read(reader: Callable[[str, object], Any]) -> BeforeValidator:
    """Lets `reader` make the value of what was written, and tells it the field's name for what it has to say of it."""
    return BeforeValidator(lambda value, info: reader(info.field_name or "a quantity", value))


def _positive_time(name: str, value: object) -> float:
    return _time(name, value, zero=False)


def _time_or_zero(name: str, value: object) -> float:
    return _time(name, value, zero=True)


def _time(name: str, value: object, *, zero: bool) -> float:
    rule = f"{name} must be a time such as 1/50, 20ms or 0.02 (seconds)"
    return hand_held(name, seconds(name, text(value, rule)), zero=zero)


def _pixels(name: str, value: object) -> float:
    return quantity.pixels(name, text(value, f"{name} must be a positive number of pixels such as 1400"))


def _angle(name: str, value: object) -> float:
    rule = f"{name} must lie in (0, 360] degrees"
    try:
        angle = float(text(value, rule))
    except ValueError:
        angle = math.nan
    if not 0 < angle <= 360:
        slip = "is it a time? then it is the exposure" if angle > 360 else "no light is collected in no time"
        raise ValueError(f"{rule}, got {shown(value)}; {slip}")
    return angle


def _range(name: str, value: object) -> tuple[float, float]:
    if isinstance(value, tuple):
        return value
    return quantity.span(text(value, f"{name} must read like 00:10-00:12 or 10-12.5"))


def _rate(name: str, value: object) -> str:
    rule = f"{name} must be a number of frames a second such as 25 or 24000/1001"
    written = str(value) if isinstance(value, Fraction) else text(value, rule)
    frame_rate(written)
    return written


def _size(name: str, value: object) -> tuple[int, int]:
    return value if isinstance(value, tuple) else quantity.size(text(value, f"{name} must read like 1920x1080"))


def _curve(name: str, value: object) -> Transfer:
    if value not in set(Transfer):
        words = f"{name} must be one of {', '.join(Transfer)}, got {shown(value)!r}"
        raise ValueError(words + meant(value, list(Transfer)))
    return Transfer(str(value))


def _written(pattern: str, example: str) -> WithJsonSchema:
    return WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string", "pattern": pattern}], "examples": [example]})


_TIME = _written(r"^\s*[\d.]+(/[\d.]+)?\s*(s|ms|us)?\s*$", "1/50")

Time = Annotated[float, _read(_positive_time), _TIME]
"""Seconds, more than 0 and at most what a hand-held camera can have."""
TimeOrZero = Annotated[float, _read(_time_or_zero), _TIME]
Pixels = Annotated[float, _read(_pixels), _written(r"^\s*[\d.]+\s*(px)?\s*$", "1400")]
Angle = Annotated[float, _read(_angle), WithJsonSchema({"type": "number", "exclusiveMinimum": 0, "maximum": 360})]
"""Degrees in (0, 360]."""
Range = Annotated[tuple[float, float], _read(_range), WithJsonSchema({"type": "string", "examples": ["00:10-00:12"]})]
"""Seconds from the first frame: from, to."""
Size = Annotated[tuple[int, int], _read(_size), WithJsonSchema({"type": "string", "examples": ["1920x1080"]})]
"""Columns and rows."""
Rate = Annotated[str, _read(_rate), WithJsonSchema({"anyOf": [{"type": "number"}, {"type": "string"}], "examples": ["24000/1001"]})]
"""Frames a second, as written; `Fraction` reads it."""
CurveName = Annotated[Transfer, _read(_curve)]
