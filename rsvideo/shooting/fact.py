"""A fact, and its source."""

from dataclasses import dataclass
from typing import Generic, TypeVar

T = TypeVar("T")


@dataclass(frozen=True, kw_only=True)
class Fact(Generic[T]):
    """A value with its source, in words a person reads: `EXIF`, `GoPro's telemetry`, `the camera profile nikon_1_j1`."""

    value: T
    source: str
    within: tuple[float, float] | None = None  # where a number lies, 19 times of 20; None where nobody stated it
    assumed: bool = False  # nobody states or has measured it
