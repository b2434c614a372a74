"""Readout time from files, by one of four methods."""

from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from calibration.timing.cannot_tell import CannotTell, CannotTellError
from calibration.timing.from_flicker import from_flicker
from calibration.timing.from_frame_rate import from_frame_rate as from_rate
from calibration.timing.from_motion import from_motion
from calibration.timing.from_table import from_table
from calibration.timing.readout_measurement import ReadoutMeasurement
from rsvideo.physics.shutter import Direction
from rsvideo.progress import Observer, ignore

FLICKER_HZ = (20.0, 100e3)  # of lights that can be measured by
MOST_FRAMES = 10_000  # of a clip
FRAMES = 120  # of a clip that are used unless chosen: four or five seconds; origin: by trial


def readout(
    source: Path | str | None = None,
    *,
    flicker: float | None = None,
    from_clip: bool = False,
    table: tuple[str, str] | None = None,
    from_frame_rate: bool = False,
    scanlines_total: int | None = None,
    frame_rate: Fraction | float | None = None,
    direction: Direction | str | None = None,
    frames: int = FRAMES,
    observer: Observer = ignore,
) -> ReadoutMeasurement | CannotTell:
    """Measure a rolling shutter's readout: the time from its first scanline to its last.

    One of four methods is chosen by its argument. Best is `flicker`: an LED that flickers at an exact 500 to 1000 Hz, close to a white
    wall or the lens, filmed with a short exposure (Forssen & Ringaby, CVPR 2010).

    Args:
        source: A clip, a photograph, or the folder of a sequence or of photographs; none with `table`.
        flicker: The frequency in Hz of the light that lit `source`; 100 or 120 for lamps on mains.
        from_clip: Measure on hand-held footage of anything with texture, not stabilised.
        table: Camera and mode, such as `("GoPro HERO8 Black", "1080p60")`: what owners published.
        from_frame_rate: Compute it from the frame rate of `source` and `scanlines_total`.
        scanlines_total: Visible and blanking lines of the sensor's mode; alone, it means `from_frame_rate`.
        frame_rate: Frames a second at which `source` was taken, where the files do not say it.
        direction: `top-to-bottom` or another over the picture as stored; it also says whether scanlines are rows or columns.
        frames: How many of the clip's first frames are used, 1 to 10 000.
        observer: Is given a `Progress` while frames are read.

    Returns:
        The readout in seconds with its standard deviation; or `CannotTell`, whose `reason` says why the material does not show it.

    Raises:
        ValueError: not exactly one method is chosen, or a number cannot be meant.
        UnreadableError: a file is missing or damaged.

    Examples:
        A grey wall under a light of 1 kHz, photographed by a shutter that reads in 20 ms, simulated:

        >>> import tempfile, pathlib, cv2, calibration
        >>> from rsvideo.physics.shutter import ShutterTiming
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "wall.png"
        >>> timing = ShutterTiming.from_readout(exposure=2e-4, readout=0.020, rows=240)
        >>> _ = cv2.imwrite(str(file), calibration.flicker.wall(timing, hertz=1000.0))
        >>> found = calibration.readout(file, flicker=1000.0)
        >>> low, high = found.confidence
        >>> low < 0.020 < high, found.std < 2e-4
        (True, True)
    """
    stated = None if direction is None else Direction(direction)
    request = _Request(source, flicker, from_clip, table, from_frame_rate, scanlines_total, frame_rate, stated, frames)
    try:
        found = _measured(request, observer)
    except CannotTellError as error:
        return CannotTell(reason=str(error))
    notes = (*found.notes, *_direction_notes(found.direction, stated))
    return replace(found, stated_direction=stated, notes=notes, files=found.files[:frames])


@dataclass(frozen=True)
class _Request:
    """What `readout` was called with."""

    source: Path | str | None
    flicker: float | None  # Hz
    from_clip: bool
    table: tuple[str, str] | None
    from_frame_rate: bool
    scanlines_total: int | None
    frame_rate: Fraction | float | None  # frames a second
    direction: Direction | None
    frames: int

    def __post_init__(self) -> None:
        methods = {
            "flicker": self.flicker is not None,
            "from_clip": self.from_clip,
            "table": self.table is not None,
            "scanlines_total": self.from_frame_rate or self.scanlines_total is not None,
        }
        if sum(methods.values()) != 1:
            chosen = " and ".join(name for name, is_chosen in methods.items() if is_chosen) or "none"
            raise ValueError(f"the readout is measured by one of {', '.join(methods)}, got {chosen}")
        if (self.source is None) != (self.table is not None):
            raise ValueError("source must be a file or a folder, and none with a table")
        if not 1 <= self.frames <= MOST_FRAMES:
            raise ValueError(f"frames must lie in 1 to {MOST_FRAMES}, got {self.frames}")
        lowest, highest = FLICKER_HZ
        if self.flicker is not None and not lowest <= self.flicker <= highest:
            raise ValueError(f"flicker must lie in {lowest:g} Hz to {highest / 1e3:g} kHz, got {self.flicker:g} Hz")


def _measured(request: _Request, observer: Observer) -> ReadoutMeasurement:
    """The readout by the method that is chosen."""
    if request.table is not None:
        return from_table(*request.table)
    path, direction = Path(request.source or ""), request.direction
    rate = None if request.frame_rate is None else Fraction(request.frame_rate)
    if request.flicker is not None:
        return from_flicker(path, request.flicker, rate=rate, direction=direction, most=request.frames, observer=observer)
    if request.from_clip:
        return from_motion(path, rate=rate, direction=direction, most=request.frames, observer=observer)
    return from_rate(path, request.scanlines_total, rate=rate, direction=direction)


def _direction_notes(observed: Direction | None, stated: Direction | None) -> tuple[str, ...]:
    if observed is None and stated is None:
        return ("the direction is taken to be top-to-bottom; --direction says another",)
    if stated is not None and observed not in (None, stated):
        return (f"the direction is {stated.value} as asked for, though it looks {observed.value}",)
    return ()
