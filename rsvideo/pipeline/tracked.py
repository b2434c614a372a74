"""With which shutter and lens the motion in a file was found by `rsvideo track`: a restoration along it has the same."""

import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from rsvideo.config import sidecar
from rsvideo.config.files import UnreadableError
from rsvideo.config.request import Camera
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.timing import Resolved, Sources, resolve

_EQUAL = 1e-6  # relative; what differs less was rounded


@dataclass(frozen=True, kw_only=True)
class Tracked:
    """What a motion that was found before states of all its frames."""

    path: Path
    timing: ShutterTiming
    timing_source: str
    camera: sidecar.Camera

    def check_timing(self, timing: ShutterTiming) -> None:
        """Refuse frames that were exposed otherwise; ValueError."""
        if not _same(self.timing, timing):
            raise ValueError(f"{self.path} holds the motion of frames with {_words(self.timing)}, these have {_words(timing)}")

    def taken_by(self, stated: Camera, sources: Sources, source: Path) -> Resolved:
        """Its shutter; options that state another are named in the notes. UnreadableError where `source` is a clip of another size."""
        if (self.camera.rows, self.camera.cols) != (sources.rows, sources.cols):
            raise UnreadableError(
                f"{self.path} holds the motion of pictures of {self.camera.cols} x {self.camera.rows} px, those of {source}"
                f" are {sources.cols} x {sources.rows}; is it another clip's?"
            )
        found = self.timing
        exposure, readout = (Fact(value=value, source=self.timing_source) for value in (found.exposure, found.readout))
        direction = Fact(value=found.direction, source=self.timing_source)
        only = Sources(rows=sources.rows, cols=sources.cols, fps=sources.fps, exposure=exposure, readout=readout, direction=direction)
        given = resolve(stated.model_copy(update={"force": True}), only).timing
        notes: tuple[str, ...] = ()
        if not _same(found, given):
            notes += (f"the motion in {self.path} was found with {_words(found)}; that is taken, and not {_words(given)}",)
        focal = stated.focal_px
        if focal is not None and not math.isclose(focal, self.camera.fx, rel_tol=_EQUAL):
            notes += (
                f"the motion in {self.path} was found with a focal length of {self.camera.fx:g} px; that is taken, and not {focal:g} px",
            )
        return Resolved(timing=found, exposure=exposure, readout=readout, direction=direction, notes=notes)


def tracked(path: Path | None) -> Tracked | None:
    """What a file states that `rsvideo track` wrote; None of other motions. UnreadableError where it is damaged."""
    if path is None or path.suffix.lower() != ".json":
        return None
    held = sidecar.read(path, most_frames=1)
    first = held.frames[0]
    if first.found is None:
        return None
    return Tracked(path=path, timing=held.timing(first), timing_source=first.timing.source, camera=held.settings.camera)


def _same(one: ShutterTiming, other: ShutterTiming) -> bool:
    """Whether two timings are equal but for rounding."""
    times = [(timing.exposure, timing.readout) for timing in (one, other)]
    return one.direction is other.direction and bool(np.allclose(*times, rtol=_EQUAL, atol=0))


def _words(timing: ShutterTiming) -> str:
    return f"exposure {1e3 * timing.exposure:.4g} ms, readout {1e3 * timing.readout:.4g} ms, {timing.direction.value}"
