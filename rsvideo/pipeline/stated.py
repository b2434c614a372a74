"""Everything that is stated of a clip or a photograph, and by whom, as plain values."""

from typing import Any

from rsvideo.config.request import Camera
from rsvideo.pipeline.take import Opened
from rsvideo.shooting.fact import Fact
from rsvideo.shooting.timing import direction_of, exposure_of, readout_of
from rsvideo.stills.still import Still
from rsvideo.video.stream import Stream


def values(clip: Opened, camera: Camera) -> dict[str, Any]:
    """All facts of a clip, under the names of the JSON that `rsvideo inspect` prints."""
    stream, facts = clip.source, clip.facts
    assert isinstance(stream, Stream)
    assert facts is not None
    exposure, notes = exposure_of(camera, clip.shutter)
    readout, more = readout_of(camera, clip.shutter)
    direction = direction_of(camera, clip.shutter)
    scanlines = stream.rows if direction.value.by_row else stream.cols
    colour = stream.colour
    missing = {
        "exposure": None if exposure else "--exposure 1/50 or --shutter-angle 180",
        "readout, but for its upper bound": None
        if readout and readout.source != "frame rate"
        else "--readout, --camera or --scanlines-total",
        "focal length": None if clip.focal else "--focal-px, or --camera with a profile that holds the lens",
    }
    return {
        "clip": str(stream.path),
        "codec": stream.codec,
        "cols": stream.cols,
        "rows": stream.rows,
        "rotation_deg": stream.rotation,
        "frame_rate": float(stream.rate),
        "variable_frame_rate": stream.variable,
        "frames": stream.frames,
        "duration_s": stream.duration_s,
        "timecode": stream.timecode,
        "created": stream.created,
        "colour": {
            "pixel_format": colour.pixel_format,
            "depth": colour.depth,
            "subsampling": colour.subsampling,
            "matrix": colour.matrix.value,
            "transfer": colour.transfer.value,
            "primaries": colour.primaries,
            "full_range": colour.full_range,
            "assumed": sorted(colour.assumed),
        },
        "tracks": [{"kind": track.kind, "codec": track.codec, "name": track.name} for track in stream.tracks],
        "make": _sourced(facts.make),
        "model": _sourced(facts.model),
        "captured": _sourced(facts.captured),
        "iso": _sourced(facts.iso),
        "recorded_frame_rate": _sourced(facts.frame_rate),
        "exposure_s": _sourced(exposure),
        "readout_s": _sourced(readout),
        "row_time_s": {"value": readout.value / scanlines, "source": f"readout / {scanlines}"} if readout else None,
        "direction": _sourced(direction),
        "focal_px": _sourced(clip.focal),
        "missing": {what: option for what, option in missing.items() if option},
        "notes": [*clip.notes, *notes, *more],
    }


def of_photograph(take: Opened, camera: Camera) -> dict[str, Any]:
    """The same of a photograph, as far as it has such facts."""
    photograph = take.source
    assert isinstance(photograph, Still)
    exposure, notes = exposure_of(camera, take.shutter)
    readout, more = readout_of(camera, take.shutter)
    direction = direction_of(camera, take.shutter)
    rows, cols = photograph.pixels.shape[:2]
    scanlines = rows if direction.value.by_row else cols
    return {
        "cols": cols,
        "rows": rows,
        "frames": 1,
        "exposure_s": _sourced(exposure),
        "readout_s": _sourced(readout),
        "row_time_s": {"value": readout.value / scanlines, "source": f"readout / {scanlines}"} if readout else None,
        "direction": _sourced(direction),
        "focal_px": _sourced(take.focal),
        "missing": {name: option for name, fact, option in _of_photographs(exposure, readout, take) if fact is None},
        "notes": [*take.notes, *take.focal_notes, *notes, *more],
    }


def _of_photographs(exposure: Fact[float] | None, readout: Fact[float] | None, take: Opened) -> list[tuple[str, object, str]]:
    return [("exposure", exposure, "--exposure 1/50"), ("readout", readout, "--readout 20ms"), ("focal length", take.focal, "--focal-px")]


def _sourced(fact: Fact[Any] | None) -> dict[str, Any] | None:
    if fact is None:
        return None
    return {"value": fact.value, "source": fact.source, **({"within": list(fact.within)} if fact.within else {})}
