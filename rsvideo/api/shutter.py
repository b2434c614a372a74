"""When the rows of a picture collect light, as a user states it."""

from dataclasses import dataclass

from rsvideo.api.words import one_of
from rsvideo.config.quantity import hand_held, seconds
from rsvideo.physics.shutter import Direction


@dataclass(frozen=True, kw_only=True, init=False)
class Shutter:
    """The shutter of a camera: how long each row is open, and how long reading all rows takes.

    Args:
        exposure: Seconds that each row collects light, in (0, 1]; a number, or a text such as "1/50", "20ms" or "0.02".
            None leaves it to the file, a photograph's EXIF or a clip's metadata, and then to what the blur of a clip shows.
        readout: Seconds from the opening of the first row to that of the one that would follow the last, in [0, 1];
            0 is a global shutter. None leaves it to the camera's profile, to a clip's metadata, or to what the motion of a clip shows.
        direction: In which direction the readout runs over the stored picture: "top-to-bottom", "bottom-to-top", "left-to-right" or
            "right-to-left". None leaves it to the camera's profile, and is top-to-bottom where that does not state one.

    Raises:
        ValueError: A time cannot be that of a hand-held camera (is it in milliseconds?), or the direction is none of the four.

    Examples:
        >>> import rsvideo
        >>> rsvideo.Shutter(exposure="1/50", readout="20ms")
        Shutter(exposure=0.02, readout=0.02, direction=None)
        >>> rsvideo.Shutter(exposure=20, readout=0)
        Traceback (most recent call last):
        ValueError: exposure must lie in (0, 1] s, got 20 s; is it in milliseconds? a unit may follow, as in 20ms
    """

    exposure: float | None
    readout: float | None
    direction: Direction | None

    def __init__(
        self,
        *,
        exposure: float | str | None = None,
        readout: float | str | None = None,
        direction: Direction | str | None = None,
    ) -> None:
        runs = None if direction is None else Direction(one_of("direction", str(direction), list(Direction)))
        object.__setattr__(self, "exposure", _time("exposure", exposure, zero=False))
        object.__setattr__(self, "readout", _time("readout", readout, zero=True))
        object.__setattr__(self, "direction", runs)


def _time(name: str, value: float | str | None, *, zero: bool) -> float | None:
    if value is None:
        return None
    return hand_held(name, seconds(name, value) if isinstance(value, str) else float(value), zero=zero)
