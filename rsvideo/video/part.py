"""The part of a stream that is written: a clip of its own, which begins at time 0 and at its own timecode."""

import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from rsvideo.video.stream import Stream
from rsvideo.video.timecode import later


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """The pictures first, ..., last - 1 of a stream; ValueError where they are not within it."""

    stream: Stream
    first: int
    last: int

    def __post_init__(self) -> None:
        if not 0 <= self.first < self.last <= self.stream.frames:
            raise ValueError(f"the range must lie within the clip's {self.stream.frames} pictures, got {self.first} to {self.last}")

    @property
    def count(self) -> int:
        """Of the pictures."""
        return self.last - self.first

    @property
    def whole(self) -> bool:
        """Whether it is all of the stream."""
        return (self.first, self.last) == (0, self.stream.frames)

    @property
    def shift(self) -> int:
        """By how much its times are earlier than the stream's, in the stream's time base.

        From the first picture on it keeps the stream's own times; if they begin before 0, which no container that is written holds, 0
        is where they begin.
        """
        begins = int(self.stream.times[self.first])
        return begins if self.first else min(begins, 0)

    @property
    def span(self) -> tuple[Fraction, Fraction]:
        """When it begins and ends, in seconds of the stream's own times."""
        stream = self.stream
        end = int(stream.times[self.last]) if self.last < stream.frames else stream.end
        return int(stream.times[self.first]) * stream.time_base, end * stream.time_base

    @property
    def timecode(self) -> str | None:
        """The name of its first picture, where the stream names its own."""
        passed = round(int(self.stream.times[self.first] - self.stream.times[0]) * self.stream.time_base * self.stream.rate)
        return self.stream.timecode and later(self.stream.timecode, passed, self.stream.rate)

    def times(self, base: Fraction) -> np.ndarray:
        """The pts of its pictures in another time base, in seconds; halves are rounded outwards, as FFmpeg does."""
        exact = [(int(t) - self.shift) * self.stream.time_base / base for t in self.stream.times[self.first : self.last]]
        return np.array([math.floor(abs(t) + Fraction(1, 2)) * (1 if t >= 0 else -1) for t in exact])
