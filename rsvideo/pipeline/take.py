"""A photograph or a clip that was opened, and what is stated of its shutter and lens before any of it is restored."""

from dataclasses import dataclass, fields, replace
from typing import TYPE_CHECKING, TypeVar

from rsvideo.config.request import Request
from rsvideo.shooting import profiles, timing
from rsvideo.shooting.camera_profile import CameraProfile
from rsvideo.shooting.fact import Fact
from rsvideo.stills import still
from rsvideo.stills.still import Still

if TYPE_CHECKING:
    from rsvideo.video.metadata import ClipFacts
    from rsvideo.video.stream import Stream


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """What all sources but the request state, each with who stated it."""

    shutter: timing.Sources
    profile: profiles.Facts | None  # of the camera, in the picture's pixels
    focal: Fact[float] | None  # px
    focal_notes: tuple[str, ...] = ()  # what the user should know where that focal length is used
    facts: "ClipFacts | None" = None  # by the clip itself
    notes: tuple[str, ...]

    @property
    def of_clip(self) -> bool:
        """Whether it is of a clip, which has a rate of frames."""
        return self.shutter.fps is not None

    def of(self, source: "Still | Stream") -> "Opened":
        """The same of a photograph or a clip that was opened."""
        return Opened(source=source, **{each.name: getattr(self, each.name) for each in fields(self)})


@dataclass(frozen=True, kw_only=True, eq=False)
class Opened(Take):
    """A photograph or a clip, and what is stated of it."""

    source: "Still | Stream"


Taken = TypeVar("Taken", bound=Take)


def of_pictures(
    profile: CameraProfile | None,
    rows: int,
    cols: int,
    *,
    fps: float | None = None,
    exposure: float | None = None,
    focal: float | None = None,
    focal_mm: float | None = None,
) -> Take:
    """What a camera's profile and the EXIF record of pictures state.

    The record states the exposure in s and the 35 mm equivalent: `focal_mm`, or `focal` px in an uncropped picture.
    """
    facts, notes = profiles.for_clip(profile, rows, cols, fps) if profile else (None, ())
    length, focal_notes = None, ()
    if facts and facts.intrinsics:
        length = Fact(value=facts.intrinsics.fx, source=facts.profile)
    elif focal is not None:
        length = Fact(value=focal, source="EXIF")
        millimetres = f" of {focal_mm:g} mm" if focal_mm else ""
        focal_notes = (f"focal length {focal:.0f} px from EXIF's 35 mm equivalent{millimetres}, for an uncropped picture",)
    return Take(
        shutter=timing.Sources(
            rows=rows,
            cols=cols,
            fps=fps,
            exposure=Fact(value=exposure, source="EXIF") if exposure else None,
            profile_readout=facts.readout if facts else None,
            profile_direction=facts.direction if facts else None,
        ),
        profile=facts,
        focal=length,
        focal_notes=focal_notes,
        notes=notes,
    )


def of_photograph(request: Request) -> Opened:
    """Read a photograph; ask its EXIF and the camera's profile."""
    found = None if request.camera.profile is None else profiles.find(request.camera.profile)
    tone, clip = (request.camera.transfer, None) if request.camera.transfer or not found else profiles.response(found)
    photograph = still.read(request.source, tone, clip)
    rows, cols = photograph.pixels.shape[:2]
    capture = photograph.capture
    stated = of_pictures(found, rows, cols, exposure=capture.exposure, focal=capture.focal_px(rows, cols), focal_mm=capture.focal_35mm)
    return replace(stated.of(photograph), notes=photograph.notes + stated.notes)
