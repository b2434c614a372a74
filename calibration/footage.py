"""What a readout is measured on: a photograph, a clip or a sequence, as frames of light and the times at which they begin."""

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import numpy as np
from jaxtyping import Float32

from calibration.views import is_clip
from rsvideo.stills import still
from rsvideo.stills.still import Still
from rsvideo.video import colour, decode, metadata, sequence
from rsvideo.video.stream import Stream


@dataclass(frozen=True, kw_only=True, eq=False)
class Footage:
    """A photograph or a clip that was looked at."""

    rows: int  # as stored
    cols: int
    frames: int
    fps: float | None  # at which the camera recorded; None: a photograph
    camera: str | None
    files: tuple[Path, ...]
    notes: tuple[str, ...]
    material: Still | Stream

    @property
    def period(self) -> float | None:
        """Seconds from one frame to the next."""
        return 1 / self.fps if self.fps else None


def look(path: Path, rate: Fraction | None) -> Footage:
    """A file or a folder. `rate` is that of the recording, where the file does not say it or says another."""
    if not is_clip(path) and not sequence.is_sequence(path):
        photo = still.read(path)
        rows, cols = photo.pixels.shape[:2]
        fps = float(rate) if rate else None
        return Footage(rows=rows, cols=cols, frames=1, fps=fps, camera=photo.shot.camera, files=(path,), notes=photo.notes, material=photo)
    stream = decode.probe(path, rate)
    facts = metadata.shot(stream)
    played, recorded = 1 / stream.interval_s, float(rate) if rate else facts.frame_rate.value if facts.frame_rate else None
    slow = recorded is not None and abs(recorded / played - 1) > 0.01
    return Footage(
        rows=stream.rows,
        cols=stream.cols,
        frames=stream.frames,
        fps=recorded if recorded and slow else played,
        camera=facts.camera,
        files=stream.files or (path,),
        notes=(f"taken to be recorded at {recorded:.5g} frames a second and shown at {played:.5g}",) if slow else (),
        material=stream,
    )


def frames(footage: Footage, most: int) -> Iterator[tuple[float, Float32[np.ndarray, "rows cols channels"]]]:
    """When each of the first frames began to be recorded, in seconds from the first, and its light."""
    match footage.material:
        case Still() as photo:
            yield 0.0, photo.pixels
        case Stream() as stream:
            pace = stream.interval_s * (footage.fps or 0.0)  # more than 1: shown in slow motion
            for picture in decode.pictures(stream, 0, min(most, stream.frames)):
                yield picture.time / pace, colour.light(picture, stream.colour)[0]
