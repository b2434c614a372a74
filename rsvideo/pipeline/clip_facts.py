"""What is known of a clip's shutter and lens before any of it is restored, and who said so."""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

from rsvideo.config.yaml import ConfigError, meant
from rsvideo.shooting import profiles, readout_table
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.readout_table import Readout
from rsvideo.shooting.timing import Known
from rsvideo.video import decode, metadata
from rsvideo.video.metadata import ClipFacts
from rsvideo.video.stream import Stream


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownClip:
    """A clip that was probed, and what all sources say of it."""

    stream: Stream
    facts: ClipFacts  # by the clip itself
    profile: profiles.Facts | None  # by the camera's profile, in the clip's pixels
    shutter: Known
    focal: Fact[float] | None  # px
    notes: tuple[str, ...]


def gather(path: Path, *, camera: str | None = None, rate: Fraction | None = None, on_damage: decode.OnDamage = "fail") -> KnownClip:
    """Ask the clip, the camera's profile and the public table.

    `camera` names a profile, a profile's file, or a camera of the public table. `rate` is for sequences, which do not know theirs.
    """
    stream = decode.probe(path, rate, on_damage=on_damage)
    facts = metadata.read(stream)
    fps = float(stream.rate)
    said, table, notes = _camera(camera, facts, stream.rows, stream.cols, fps)
    focal = Fact(value=said.intrinsics.fx, source=said.profile) if said and said.intrinsics else None
    if focal is None and facts.focal_35mm and (pixels := facts.focal_px(stream.rows, stream.cols)):
        focal = Fact(
            value=pixels, source=f"{facts.focal_35mm.source}, {facts.focal_35mm.value:g} mm on 36 x 24 mm, for an uncropped picture"
        )
    return KnownClip(
        stream=stream,
        facts=facts,
        profile=said,
        shutter=Known(
            rows=stream.rows,
            cols=stream.cols,
            fps=fps,
            exposure=facts.exposure,
            readout=facts.readout,
            profile_readout=said.readout if said else None,
            profile_direction=said.direction if said else None,
            table=table,
        ),
        focal=focal,
        notes=stream.notes + facts.notes + notes,
    )


def _camera(
    camera: str | None, facts: ClipFacts, rows: int, cols: int, fps: float
) -> tuple[profiles.Facts | None, Readout | None, tuple[str, ...]]:
    """What the profile and the public table say, and what to know of that."""
    if camera is None:
        table = readout_table.typical(facts.camera, rows=rows, cols=cols, fps=fps) if facts.camera else None
        return None, table, () if table or not facts.camera else _unknown(facts.camera)
    if profiles.is_file(camera) or camera in profiles.names():
        found = profiles.find(camera)
        said, notes = profiles.for_clip(found, rows, cols, fps)
        return said, readout_table.typical(facts.camera or found.camera, rows=rows, cols=cols, fps=fps), notes
    table = readout_table.typical(camera, rows=rows, cols=cols, fps=fps)
    if table is None:
        words = f"camera must be a profile ({', '.join(profiles.names())}), its file, or a camera of the public table"
        raise ConfigError(f"{words}, got {camera[:100]!r}" + meant(camera, [*profiles.names(), *readout_table.similar(camera)]))
    return None, table, ()


def _unknown(camera: str) -> tuple[str, ...]:
    near = readout_table.similar(camera)
    return (f"the public table of readout times does not know {camera}" + (f"; it knows {', '.join(near)}" if near else ""),)
