"""What is stated of a clip's shutter and lens before any of it is restored, and by whom."""

from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from rsvideo.config.request import Request
from rsvideo.config.yaml import ConfigError, meant
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline.take import Opened
from rsvideo.shooting import profiles, readout_table, timing
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.readout_table import Readout
from rsvideo.video import decode, metadata
from rsvideo.video.metadata import ClipFacts
from rsvideo.video.stream import Stream

_TICK = 0.6  # of the clip's unit of time, to which times are rounded: a little over the half by which rounding may be off


def opened(request: Request, piped: Stream | None = None) -> Opened:
    """The clip of a request, which a pipe may have brought, with the curve that its codes stand for."""
    given = request.camera
    stream = piped or decode.probe(request.source, request.input.frame_rate, on_damage=request.input.on_damage)
    clip = _of_stream(stream, given.profile)
    assert isinstance(clip.source, Stream)
    return replace(clip, source=_in_light(clip.source, given.transfer, clip.profile))


def gather(path: Path, *, camera: str | None = None, rate: Fraction | None = None, on_damage: decode.OnDamage = "fail") -> Opened:
    """Ask the clip, the camera's profile and the public table.

    `camera` names a profile, a profile's file, or a camera of the public table. `rate` is for sequences, which do not state theirs.
    """
    return _of_stream(decode.probe(path, rate, on_damage=on_damage), camera)


def _of_stream(stream: Stream, camera: str | None) -> Opened:
    facts = metadata.read(stream)
    fps = float(stream.rate)
    profile, table, notes = _camera(camera, facts, stream.rows, stream.cols, fps)
    focal = Fact(value=profile.intrinsics.fx, source=profile.profile) if profile and profile.intrinsics else None
    if focal is None and facts.focal_35mm and (pixels := facts.focal_px(stream.rows, stream.cols)):
        focal = Fact(
            value=pixels, source=f"{facts.focal_35mm.source}, {facts.focal_35mm.value:g} mm on 36 x 24 mm, for an uncropped picture"
        )
    return Opened(
        source=stream,
        facts=facts,
        profile=profile,
        shutter=timing.Sources(
            rows=stream.rows,
            cols=stream.cols,
            fps=fps,
            bits=stream.bits,
            exposure=facts.exposure,
            readout=facts.readout,
            profile_readout=profile.readout if profile else None,
            profile_direction=profile.direction if profile else None,
            table=table,
        ),
        focal=focal,
        notes=stream.notes + facts.notes + notes,
    )


def _in_light(stream: Stream, transfer: Transfer | None, profile: profiles.Facts | None) -> Stream:
    """The stream with the curve that its codes stand for: the one that is given, or else the profile's, or its own."""
    if transfer:
        return replace(stream, colour=replace(stream.colour, transfer=transfer))
    if profile and profile.tone and not stream.colour.floating:
        return replace(stream, colour=replace(stream.colour, transfer=profile.tone, saturation=profile.saturation))
    return stream


def frame_range(stream: Stream, seconds: tuple[float, float] | None) -> tuple[int, int]:
    """Frames [first, last) that are shown from one time to another, or all; ValueError where there is none."""
    if seconds is None:
        return 0, stream.frames
    shown, tick = (stream.times - stream.times[0]) * float(stream.time_base), _TICK * float(stream.time_base)
    first, last = (int(np.searchsorted(shown, t - tick)) for t in seconds)
    if first >= last:
        raise ValueError(
            f"range must hold at least one frame of the clip's {stream.duration_s:.3f} s, got {seconds[0]:g} s to {seconds[1]:g} s;"
            " is it in minutes:seconds?"
        )
    return first, last


def _camera(
    camera: str | None, facts: ClipFacts, rows: int, cols: int, fps: float
) -> tuple[profiles.Facts | None, Readout | None, tuple[str, ...]]:
    """What the profile and the public table state, and what to know of that."""
    if camera is None:
        table = readout_table.typical(facts.camera, rows=rows, cols=cols, fps=fps) if facts.camera else None
        return None, table, () if table or not facts.camera else _unknown(facts.camera)
    if profiles.is_file(camera) or camera in profiles.names():
        found = profiles.find(camera)
        profile, notes = profiles.for_clip(found, rows, cols, fps)
        return profile, readout_table.typical(facts.camera or found.camera, rows=rows, cols=cols, fps=fps), notes
    table = readout_table.typical(camera, rows=rows, cols=cols, fps=fps)
    if table is None:
        words = f"camera must be a profile ({', '.join(profiles.names())}), its file, or a camera of the public table"
        raise ConfigError(f"{words}, got {camera[:100]!r}" + meant(camera, [*profiles.names(), *readout_table.similar(camera)]))
    return None, table, ()


def _unknown(camera: str) -> tuple[str, ...]:
    near = readout_table.similar(camera)
    return (f"the public table of readout times does not know {camera}" + (f"; it knows {', '.join(near)}" if near else ""),)
