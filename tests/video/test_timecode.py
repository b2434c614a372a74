"""Names of frames, against counting them one by one."""

from collections.abc import Iterator
from fractions import Fraction

import pytest

from rsvideo.video.timecode import later

NTSC = Fraction(30000, 1001)


def counted(base: int, mark: str, dropped: int) -> Iterator[str]:
    """All names of a day's last half hour and the next one's first, in order."""
    for minute in range(-30, 30):
        for second in range(60):
            for frame in range(dropped if second == 0 and minute % 10 else 0, base):
                yield f"{minute // 60 % 24:02}:{minute % 60:02}:{second:02}{mark}{frame:02}"


@pytest.mark.parametrize(
    ("rate", "base", "mark", "dropped"), [(NTSC, 30, ";", 2), (2 * NTSC, 60, ";", 4), (NTSC, 30, ":", 0), (Fraction(24), 24, ":", 0)]
)
def test_a_frame_is_named_as_counting_names_it(rate: Fraction, base: int, mark: str, dropped: int) -> None:
    names = list(counted(base, mark, dropped))
    for step in [0, 1, 2, base, 59 * base, *range(0, len(names) - 1234, 997)]:
        assert later(names[1234], step, rate) == names[1234 + step]


@pytest.mark.parametrize("words", ["", "soon", "1:2:3:4", "00:00:00"])
def test_what_is_no_timecode_stays_as_it_is(words: str) -> None:
    assert later(words, 5, NTSC) == words
