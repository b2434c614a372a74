"""SMPTE 12M timecode: names of frames, HH:MM:SS:FF, as editors count them."""

import re
from fractions import Fraction

_WRITTEN = re.compile(r"(\d\d):(\d\d):(\d\d)([:;.])(\d\d)")


def later(timecode: str, frames: int, rate: Fraction) -> str:
    """The name of the frame that comes `frames` after the one named, at `rate` frames a second; what is no timecode stays as it is.

    After a semicolon the count drops frames: at 29.97 the names 00 and 01 are left out at every minute but each tenth, at 59.94 four.
    A day has an end, where the count begins anew.
    """
    found, base = _WRITTEN.fullmatch(timecode), round(rate)
    if not found or base < 1:
        return timecode
    hours, minutes, seconds, frame = (int(found[k]) for k in (1, 2, 3, 5))
    dropped = 0 if found[4] == ":" else base // 15
    minutes += 60 * hours
    ten = 600 * base - 9 * dropped  # frames in ten minutes
    count = (60 * minutes + seconds) * base + frame - dropped * (minutes - minutes // 10) + frames
    tens, rest = divmod(count % (144 * ten), ten)
    minute = max(0, (rest - dropped) // (60 * base - dropped))
    name = tens * 600 * base + rest + dropped * minute
    seconds, frame = divmod(name, base)
    return f"{seconds // 3600:02}:{seconds // 60 % 60:02}:{seconds % 60:02}{found[4]}{frame:02}"
