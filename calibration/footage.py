"""What a readout is measured on: a photograph, a clip or a sequence, as frames of light and the times at which they begin."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from calibration.sources import is_clip
from rsvideo.stills import still
from rsvideo.stills.still import Still
from rsvideo.video import colour, decode, metadata, sequence
from rsvideo.video.stream import Stream

_SLOW_MOTION = 0.01  # by which the rates of recording and of playing must differ for a clip to count as slowed or sped up


@dataclass(frozen=True, kw_only=True, eq=False)
class Footage:
    """A photograph or a clip that was opened."""

    rows: int  # as stored
    cols: int
    frames: int
    fps: float | None  # at which the camera took frames; None: a photograph
    camera: str | None
    files: tuple[Path, ...]
    notes: tuple[str, ...]
    material: Still | Stream

    @property
    def period(self) -> float | None:
        """Seconds from one frame to the next."""
        return 1 / self.fps if self.fps else None


def open_footage(path: Path, rate: Fraction | None) -> Footage:
    """A file or a folder. `rate` is that at which frames were taken, where the file does not say it or says another."""
    if not is_clip(path) and not sequence.is_sequence(path):
        photo = still.read(path)
        rows, cols = photo.pixels.shape[:2]
        fps = float(rate) if rate else None
        return Footage(rows=rows, cols=cols, frames=1, fps=fps, camera=photo.shot.camera, files=(path,), notes=photo.notes, material=photo)
    stream = decode.probe(path, rate)
    facts = metadata.shot(stream)
    played, taken = 1 / stream.interval_s, float(rate) if rate else facts.frame_rate.value if facts.frame_rate else None
    slow = taken is not None and abs(taken / played - 1) > _SLOW_MOTION
    return Footage(
        rows=stream.rows,
        cols=stream.cols,
        frames=stream.frames,
        fps=taken if taken and slow else played,
        camera=facts.camera,
        files=stream.files or (path,),
        notes=(f"taken to be recorded at {taken:.5g} frames a second and shown at {played:.5g}",) if slow else (),
        material=stream,
    )


def frames(footage: Footage, most: int) -> Iterator[tuple[float, Float32[np.ndarray, "rows cols channels"]]]:
    """When each of the first frames began to be taken, in seconds from the first, and its light."""
    match footage.material:
        case Still() as photo:
            yield 0.0, photo.pixels
        case Stream() as stream:
            pace = stream.interval_s * (footage.fps or 0.0)  # more than 1: shown in slow motion
            for picture in decode.pictures(stream, 0, min(most, stream.frames)):
                yield picture.time / pace, colour.light(picture, stream.colour)[0]
