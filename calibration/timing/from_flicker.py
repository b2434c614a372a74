"""The readout from files that a flickering light lit: a clip, a photograph, or a folder of photographs."""

from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from calibration.footage import Footage, frames, open_footage
from calibration.sources import photographs
from calibration.timing.bands import Bands, combined, measure, row_profile
from calibration.timing.cannot_tell import CannotTellError
from calibration.timing.readout_measurement import ReadoutMeasurement, counted, directions, of_footage
from rsvideo.config.files import UnreadableError
from rsvideo.physics.shutter import Direction
from rsvideo.progress import Observer, Progress


def from_flicker(
    path: Path, hertz: float, *, rate: Fraction | None, direction: Direction | None, most: int, observer: Observer
) -> ReadoutMeasurement:
    """The readout under a light of `hertz`; CannotTellError where the bands do not show it.

    Of a clip, the first `most` frames are used; `rate` is its frames a second, where the file does not say it.
    """
    if path.is_dir() and rate is None:
        return _from_photographs(path, hertz, directions(direction))
    downwards = directions(direction)
    footage = open_footage(path, rate)
    profiles, times, count = [], [], min(most, footage.frames)
    for time, light in frames(footage, most):
        observer(Progress(stage="reading", fraction=len(times) / count))
        profiles.append(row_profile(downwards[0].scanlines(light)))
        times.append(time)
    bands = measure(profiles, times, hertz, longest=footage.period, downwards=downwards)
    notes = footage.notes + bands.notes + (() if bands.frames > 1 else ("one picture tells no direction and less than a clip",))
    how = _how(bands, counted(bands.frames, "frame"))
    return of_footage(footage, bands.readout, bands.std, bands.direction, how=how, notes=notes, details=_details(bands, bands.frames))


def _from_photographs(folder: Path, hertz: float, downwards: tuple[Direction, Direction]) -> ReadoutMeasurement:
    """Each photograph by itself, and what all say together."""
    files = photographs([folder])
    if not files:
        raise UnreadableError(f"{folder} holds no photograph; is it the right folder?")
    used, bands, notes = list[Footage](), list[Bands](), list[str]()
    for path in files:
        footage = open_footage(path, None)
        try:
            of_photograph = [
                measure([row_profile(downwards[0].scanlines(light))], [0.0], hertz, downwards=downwards) for _, light in frames(footage, 1)
            ]
        except CannotTellError as error:
            notes.append(f"not used: {path.name}: {error}")
            continue
        if used and (footage.rows, footage.cols) != (used[0].rows, used[0].cols):
            raise ValueError(
                f"photographs must be of one size, {path.name} is {footage.cols} x {footage.rows}, {used[0].files[0].name} is not"
            )
        used.append(footage)
        bands += of_photograph
    if not bands:
        raise CannotTellError(f"none of {counted(len(files), 'photograph')} shows bands: {notes[0].split(': ', 2)[2]}")
    together = combined(bands)
    no_direction = "photographs tell no direction; for a clip's frames, which do, give --rate"
    measured = of_footage(
        used[0],
        together.readout,
        together.std,
        None,
        how=_how(together, counted(len(bands), "photograph")),
        notes=(*notes, *together.notes, no_direction),
        details=_details(together, len(bands)),
    )
    return replace(measured, files=tuple(path for footage in used for path in footage.files))


def _how(bands: Bands, pictures: str) -> str:
    return f"bands of a light that flickers at {bands.light:g} Hz, {bands.period:.5g} rows apart, in {pictures}"


def _details(bands: Bands, frames: int) -> Mapping[str, object]:
    return {"row_time_s": bands.row_time, "period_rows": bands.period, "light_hz": bands.light, "frames": frames}
