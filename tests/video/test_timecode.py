"""Names of frames, against counting them one by one."""

from collections.abc import Iterator
from fractions import Fraction

import pytest

from rsvideo.video.timecode import later

NTSC = Fraction(30000, 1001)


def counted(base: int, mark: str, dropped: int) -> Iterator[str]:
    """All names of a day, in order."""
    for minute in range(24 * 60):
        for second in range(60):
            for frame in range(dropped if second == 0 and minute % 10 else 0, base):
                yield f"{minute // 60:02}:{minute % 60:02}:{second:02}{mark}{frame:02}"


@pytest.mark.parametrize(
    ("rate", "base", "mark", "dropped"), [(NTSC, 30, ";", 2), (2 * NTSC, 60, ";", 4), (NTSC, 30, ":", 0), (Fraction(24), 24, ":", 0)]
)
def test_a_frame_is_named_as_counting_names_it(rate: Fraction, base: int, mark: str, dropped: int) -> None:
    names = list(counted(base, mark, dropped))
    start = len(names) // 3 + 17
    for step in [0, 1, 2, base, 59 * base, *range(0, len(names), 10_007)]:
        assert later(names[start], step, rate) == names[(start + step) % len(names)]


@pytest.mark.parametrize("words", ["", "soon", "1:2:3:4", "00:00:00"])
def test_what_is_no_timecode_stays_as_it_is(words: str) -> None:
    assert later(words, 5, NTSC) == words
