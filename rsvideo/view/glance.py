"""Quick things of a clip for a page, in a process of their own: a thumbnail, a frame, what is stated of it, how its frames were judged."""

from collections.abc import Iterator
from dataclasses import dataclass, field
from itertools import islice
from pathlib import Path
from typing import Any

import av
import cv2
import numpy as np

from rsvideo.config import sidecar
from rsvideo.config.files import UnreadableError, reading
from rsvideo.config.media import is_clip
from rsvideo.config.request import Request, Sections
from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.pipeline import clip_facts, measuring, stated, take
from rsvideo.progress import Observer
from rsvideo.stills import still
from rsvideo.video import colour, container, decode, sequence, tags
from rsvideo.video.stream import Stream
from rsvideo.view import drawing
from rsvideo.view.drawing import File

SECONDS = 30.0  # that one of these may take
_MOST_POINTS = 4000  # of a strip; of longer clips every second, third, ... frame is drawn, the longest blur of each group
_MOST_JUDGED = 200_000  # frames of a sidecar that are read
_STREAMS: dict[tuple[Path, int, str], Stream] = {}
_MOST_STREAMS = 4


@dataclass(frozen=True, kw_only=True)
class Thumbnail:
    """The first picture, small."""

    path: Path
    side: int


@dataclass(frozen=True, kw_only=True)
class OneFrame:
    """One frame, upright."""

    path: Path
    index: int
    side: int


@dataclass(frozen=True, kw_only=True)
class Facts:
    """What is stated of a clip or a photograph; `measure` goes into its frames too."""

    path: Path
    sections: Sections = field(default_factory=Sections)
    measure: bool = False


@dataclass(frozen=True, kw_only=True)
class Strip:
    """How the frames of a sidecar were judged."""

    path: Path


Order = Thumbnail | OneFrame | Facts | Strip


def carry_out(order: Order, _: Observer) -> Iterator[Any]:
    """The one answer."""
    match order:
        case Thumbnail():
            yield _thumbnail(order)
        case OneFrame():
            yield _frame(order)
        case Facts():
            yield _facts(order)
        case Strip():
            yield strip(order.path)


def _thumbnail(order: Thumbnail) -> File:
    """Of a clip its first key picture, as FFmpeg gives it: nothing else of the clip is read."""
    path = order.path
    if not is_clip(path) or sequence.is_sequence(path):
        return _frame(OneFrame(path=path, index=0, side=order.side))
    with reading(path), decode.opened(path, container.family(path, strict=False)) as file:
        if not file.streams.video:
            raise UnreadableError(f"{path.name} holds no pictures")
        video = file.streams.video[0]
        video.codec_context.skip_frame = "NONKEY"
        for frame in file.decode(video):
            turns = _turns(frame)
            cols, rows = frame.width, frame.height
            scale = min(1.0, order.side / max(cols, rows))
            small = frame.reformat(width=max(2, round(cols * scale)), height=max(2, round(rows * scale)), format="rgb24")
            return drawing.webp(small.to_ndarray(), turns, most=order.side)
    raise UnreadableError(f"{path.name} holds no picture that can be decoded")


def _turns(frame: av.VideoFrame) -> int:
    """Quarters by which a picture is turned to be upright."""
    return round(frame.rotation / 90) % 4 if tags.display_matrix(frame) is not None else 0


def _frame(order: OneFrame) -> File:
    if not is_clip(order.path):
        photograph = still.read(order.path)
        return _sized(photograph.pixels, photograph.transfer, 0, order.side)
    stream = _stream(order.path, Sections())
    index = min(max(order.index, 0), stream.frames - 1)
    for picture in decode.pictures(stream, index, index + 1, on_damage="passthrough"):
        pixels, _ = colour.light(picture, stream.colour)
        return _sized(pixels, stream.colour.transfer, stream.rotation // 90, order.side)
    raise UnreadableError(f"frame {index} of {order.path.name} cannot be decoded; choose another")


def _sized(pixels: np.ndarray, transfer: Any, turns: int, side: int) -> File:
    longer = max(pixels.shape[:2])
    if longer > side:
        cols, rows = (max(1, round(n * side / longer)) for n in pixels.shape[1::-1])
        pixels = cv2.resize(pixels, (cols, rows), interpolation=cv2.INTER_AREA).reshape(rows, cols, -1)
    return drawing.shown(pixels, transfer, turns)


def _stream(path: Path, sections: Sections) -> Stream:
    """A clip as it was opened the last time, unless it has changed."""
    stamp = path.stat().st_mtime_ns
    key = path, stamp, str(sections.input.rate)
    if key not in _STREAMS:
        while len(_STREAMS) >= _MOST_STREAMS:
            del _STREAMS[next(iter(_STREAMS))]
        _STREAMS[key] = decode.probe(path, sections.input.frame_rate, on_damage="passthrough")
    return _STREAMS[key]


def _facts(order: Facts) -> dict[str, Any]:
    """All that is stated, under the names of `rsvideo inspect --json`, and the keys of the settings that each fact answers."""
    camera, source = order.sections.camera, order.path
    if is_clip(source):
        clip = clip_facts.gather(source, camera=camera.profile, rate=order.sections.input.frame_rate, on_damage="passthrough")
        clip = measuring.with_measured(clip, camera) if order.measure else clip
        values = stated.values(clip, camera)
        assert isinstance(clip.source, Stream)
        values["transfer"] = {"value": clip.source.colour.transfer.value, "source": "the clip's tag"}
        if "transfer" in clip.source.colour.assumed:
            values["transfer"]["source"] = "assumed"
    else:
        values = stated.of_photograph(take.of_photograph(Request.of(source, source.with_name("x.png"), order.sections)), camera)
    return values | {"clip": source.name, "is_clip": is_clip(source)}


def strip(path: Path) -> dict[str, Any]:
    """Of each frame of a sidecar: its number, time, blur in px, verdict and, where it is stated, how far the blur bears the path out."""
    head = sidecar.read(path, most_frames=1)
    rows = [_judged(head, record) for record in islice(sidecar.one_by_one(path), _MOST_JUDGED)]
    verdicts = list(dict.fromkeys(row[3] for row in rows))
    every = -(-len(rows) // _MOST_POINTS)
    kept = [max(rows[k : k + every], key=lambda row: row[2]) for k in range(0, len(rows), every)]
    return {
        "frames": [row[0] for row in kept],
        "times": [row[1] for row in kept],
        "blur": [row[2] for row in kept],
        "verdicts": verdicts,
        "verdict": [verdicts.index(row[3]) for row in kept],
        "counts": {verdict: sum(row[3] == verdict for row in rows) for verdict in verdicts},
        "confidence": [row[4] for row in kept],
        "certainty": [row[5] for row in kept],
    }


def _judged(head: Sidecar, record: FrameRecord) -> tuple[int, float, float, str, float | None, float | None]:
    found = record.found
    blur = round(drawing.blur_length(head, record), 2)
    return record.index, record.time_s, blur, record.verdict, found and round(found.share, 3), found and round(found.certainty, 3)
