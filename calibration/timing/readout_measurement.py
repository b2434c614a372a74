"""A readout time that was measured or looked up, and what a profile says of it."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

from calibration.footage import Footage
from calibration.provenance import camera_name, provenance
from calibration.sources import by_name
from rsvideo.physics.shutter import Direction
from rsvideo.shooting.camera_profile import CameraProfile, Clock, Measured, Mode

_CONFIDENCE = 2  # deviations to either side: 19 times of 20
_READOUT_DIGITS, _FPS_DIGITS = 9, 3  # of seconds and of frames a second, that a profile keeps


@dataclass(frozen=True, kw_only=True, eq=False)
class ReadoutMeasurement:
    """The time from the opening of the first scanline to that of the one that would follow the last, of one camera mode."""

    value: float  # seconds
    std: float | None  # seconds; None: not estimated
    direction: Direction | None  # as observed, over the picture as stored; None: not observed
    stated_direction: Direction | None = None  # as the caller states it, which a profile takes first
    how: str  # the method, in words
    source: str | None = None  # of numbers that were published
    rows: int  # of the mode, as stored
    cols: int
    fps: float | None  # frames a second; None: photographs
    files: tuple[Path, ...] = ()
    camera: str | None = None  # as the files or the table name it
    notes: tuple[str, ...] = ()  # what was assumed, and what should be minded
    details: Mapping[str, object] = field(default_factory=dict)  # more numbers of the method; units stand in their names

    @property
    def confidence(self) -> tuple[float, float] | None:
        """Seconds between which the readout lies, 19 times of 20: two standard deviations to either side; None where there is none."""
        if self.std is None:
            return None
        return max(self.value - _CONFIDENCE * self.std, 0.0), self.value + _CONFIDENCE * self.std

    def profile(self, *, name: str | None = None, maker: str | None = None) -> CameraProfile:
        """A profile with this readout; `name` is the camera's model, as the files name it unless given."""
        found = provenance(self.how, by_name(self.files))
        if self.source:
            found = found.model_copy(update={"source": self.source})
        return CameraProfile(
            name=camera_name(name, self.camera),
            maker=maker,
            mode=Mode(rows=self.rows, cols=self.cols, fps=None if self.fps is None else round(self.fps, _FPS_DIGITS)),
            timing=Clock(
                readout_s=Measured(value=round(self.value, _READOUT_DIGITS), std=None if self.std is None else float(f"{self.std:.3g}")),
                direction=self.stated_direction or self.direction or Direction.TOP_TO_BOTTOM,
                found=found,
            ),
        )


def of_footage(
    footage: Footage,
    value: float,
    std: float | None,
    direction: Direction | None,
    *,
    how: str,
    notes: tuple[str, ...],
    details: Mapping[str, object],
) -> ReadoutMeasurement:
    """The readout of the camera mode that a footage is of."""
    return ReadoutMeasurement(
        value=value,
        std=std,
        direction=direction,
        how=how,
        rows=footage.rows,
        cols=footage.cols,
        fps=footage.fps,
        files=footage.files,
        camera=footage.camera,
        notes=notes,
        details=details,
    )


def scanlines_are_rows(direction: Direction | None) -> bool:
    """Whether scanlines are rows of the picture as stored, as they are unless the direction says otherwise."""
    return direction not in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT)


def directions(direction: Direction | None) -> tuple[Direction, Direction]:
    """The direction in which scanlines are counted, and the other one along the same axis."""
    first = Direction.TOP_TO_BOTTOM if scanlines_are_rows(direction) else Direction.LEFT_TO_RIGHT
    return first, first.opposite


def counted(number: int, noun: str) -> str:
    """A number of things, in words."""
    return f"{number} {noun}{'' if number == 1 else 's'}"
