"""A photograph or a clip that was opened, and what is stated of its shutter and lens before any of it is restored."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from rsvideo.config.request import Request
from rsvideo.shooting import profiles, timing
from rsvideo.shooting.fact import Fact
from rsvideo.stills import still
from rsvideo.stills.still import Still

if TYPE_CHECKING:
    from rsvideo.video.metadata import ClipFacts
    from rsvideo.video.stream import Stream


@dataclass(frozen=True, kw_only=True, eq=False)
class Take:
    """What all sources but the request state, each with who stated it."""

    source: "Still | Stream"
    shutter: timing.Sources
    profile: profiles.Facts | None  # of the camera, in the picture's pixels
    focal: Fact[float] | None  # px
    focal_notes: tuple[str, ...] = ()  # what the user should know where that focal length is used
    facts: "ClipFacts | None" = None  # by the clip itself
    notes: tuple[str, ...]


def of_photograph(request: Request) -> Take:
    """Read a photograph; ask its EXIF and the camera's profile."""
    found = None if request.camera.profile is None else profiles.find(request.camera.profile)
    tone, clip = (request.camera.transfer, None) if request.camera.transfer or not found else profiles.response(found)
    photograph = still.read(request.source, tone, clip)
    rows, cols = photograph.pixels.shape[:2]
    profile, notes = profiles.for_clip(found, rows, cols, None) if found else (None, ())
    capture = photograph.capture
    focal, focal_notes = None, ()
    if profile and profile.intrinsics:
        focal = Fact(value=profile.intrinsics.fx, source=profile.profile)
    elif (pixels := capture.focal_px(rows, cols)) is not None:
        focal = Fact(value=pixels, source="EXIF")
        focal_notes = (f"focal length {pixels:.0f} px from EXIF's 35 mm equivalent of {capture.focal_35mm:g} mm, for an uncropped picture",)
    return Take(
        source=photograph,
        shutter=timing.Sources(
            rows=rows,
            cols=cols,
            exposure=Fact(value=capture.exposure, source="EXIF") if capture.exposure else None,
            profile_readout=profile.readout if profile else None,
            profile_direction=profile.direction if profile else None,
        ),
        profile=profile,
        focal=focal,
        focal_notes=focal_notes,
        notes=photograph.notes + notes,
    )
