"""Clips read strictly: their pictures in order, none lost and none damaged unnoticed."""

import re
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Literal

import av
import av.error
import av.stream
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from rsvideo.config.files import UnreadableError, reading
from rsvideo.config.quantity import MOST_PIXELS
from rsvideo.stills.ffmpeg import arrays, watched
from rsvideo.video import container, pipe, probing, sample_tables, sequence, tags
from rsvideo.video.stream import Picture, Stream

OnDamage = Literal["fail", "passthrough", "skip"]

_STRICT = "explode+crccheck+bitstream"
_MOST_TRACKS = 100  # a camera writes fewer than ten


def probe(path: Path, rate: Fraction | None = None, *, on_damage: OnDamage = "fail") -> Stream:
    """What a file, a folder or a pattern such as `shot_####.dng` holds. `rate` is for sequences, which do not know theirs.

    A container that is damaged or cut short raises UnreadableError, unless `on_damage` takes what can be found.
    """
    strict = on_damage == "fail"
    if sequence.is_sequence(path):
        return sequence.probe(path, rate)
    family = container.family(path, strict=strict)
    with reading(path):
        if family == "mov":
            sample_tables.check(path)
        with opened(path, family) as file:
            return probing.probed(path, family, file, strict=strict)


def pictures(stream: Stream, first: int = 0, last: int | None = None, *, on_damage: OnDamage = "fail") -> Iterator[Picture]:
    """The pictures first, ..., last - 1, exactly as decoding from the start gives them.

    What is damaged or missing raises UnreadableError; or is handed over as decoded, or as the picture before, marked as
    damaged ("passthrough"); or is left out ("skip"). Damage reaches to the next picture that depends on no other.
    """
    last = stream.frames if last is None else last
    if not 0 <= first < last <= stream.frames:
        raise ValueError(f"the range must lie within the clip's {stream.frames} pictures, got {first} to {last}")
    with reading(stream.path):
        if stream.files:
            yield from sequence.pictures(stream, first, last)
        elif stream.bare:
            yield from pipe.pictures(stream, first, last)
        else:
            yield from _strict(stream, first, last) if on_damage == "fail" else _lenient(stream, first, last, on_damage)


def opened(path: Path, family: str) -> InputContainer:
    """A clip's file and nothing else: no name is taken for an address or a list, and no other file that it refers to is opened."""
    options = {"protocol_whitelist": "file", "max_streams": str(_MOST_TRACKS)}
    if family == "mov":
        options["enable_drefs"] = "0"
    limits = [{"max_pixels": str(MOST_PIXELS)}] * _MOST_TRACKS
    return av.open(
        f"file:{path}",
        "r",
        format=family,
        metadata_errors="replace",
        container_options=options,
        stream_options=limits,  # pyright: ignore[reportArgumentType, reportCallIssue] # its stub names the keys' type
    )


def _reason(error: av.error.FFmpegError) -> str:
    """What FFmpeg says of an error, without the path that it adds."""
    return (error.strerror or type(error).__name__).lower()


def _planes(frame: VideoFrame, layout: str) -> tuple[np.ndarray, ...]:
    plain = re.sub(r"^yuva", "yuv", re.sub(r"^gbra", "gbr", frame.format.name))
    source = frame if plain == layout else frame.reformat(format=layout)
    kind = np.dtype("<f4") if "f32" in layout else np.dtype("<u2" if source.format.components[0].bits > 8 else "u1")
    count = 1 if layout.startswith("gray") else 3
    planes = arrays(source, kind, count)
    return (planes[2], planes[0], planes[1]) if layout.startswith("gbr") else planes


def _picture(stream: Stream, frame: VideoFrame, index: int, *, damaged: bool = False) -> Picture:
    if (frame.height, frame.width) != (stream.rows, stream.cols):
        raise UnreadableError(
            f"{stream.path} must keep one size, it begins with {stream.cols} x {stream.rows} and picture {index}"
            f" is {frame.width} x {frame.height}; was it joined from several clips?"
        )
    if tags.layout(frame.format.name) != stream.colour.pixel_format:
        raise UnreadableError(
            f"{stream.path} must keep one pixel format, it begins with {stream.colour.pixel_format} and picture {index}"
            f" is {frame.format.name}; was it joined from several clips?"
        )
    return Picture(
        planes=_planes(frame, stream.colour.pixel_format),
        index=index,
        pts=int(stream.times[index]),
        duration=stream.spacing(index),
        time=stream.seconds(index),
        damaged=damaged,
    )


class _Broken(Exception):  # noqa: N818 - not an error yet: decoding from an earlier key picture may do better
    """Why a picture could not be decoded."""


def _strict(stream: Stream, first: int, last: int) -> Iterator[Picture]:
    """Raises on the first sign of damage; starts at an earlier key picture where the nearest does not lead to `first`."""
    starts = [int(key) for key in stream.keys[stream.keys <= stream.times[first]][:-3:-1] if key > stream.times[0]] if first else []
    for start in (*starts, None):
        wanted = first
        try:
            for index, frame in _decoded(stream, start, last):
                if index < first:
                    continue
                if index != wanted:
                    raise _Broken(f"picture {wanted} is missing")
                yield _picture(stream, frame, index)
                wanted += 1
                if wanted == last:
                    return
            raise _Broken(f"picture {wanted} is missing")
        except _Broken as reason:
            if wanted > first or start is None:
                raise UnreadableError(f"{stream.path} is damaged: {reason}; --on-damage passthrough or skip goes on without") from reason


def _decoded(stream: Stream, start: int | None, last: int) -> Iterator[tuple[int, VideoFrame]]:
    """Index and frame from the key picture `start` on, or from the beginning; raises _Broken at any sign of damage."""
    with opened(stream.path, container.family(stream.path, strict=False)) as file:
        video = _ready(file, stream, {"err_detect": _STRICT})
        for packet in _packets(file, video, stream, start):
            near = stream.times.searchsorted(packet.pts) if packet.pts is not None else last
            if packet.is_corrupt:
                raise _Broken(f"the packet of picture {near} is incomplete")
            with watched() as log:
                try:
                    frames = packet.decode()
                except av.error.FFmpegError as error:
                    reason = log[0] if log else _reason(error)
                    raise _Broken(f"picture {near} cannot be decoded ({reason})") from error
            if log:
                raise _Broken(f"picture {near} is not intact ({log[0]})")
            for frame in frames:
                index = _index(stream, frame)
                if frame.is_corrupt:
                    raise _Broken(f"picture {index} is not intact")
                if index is not None:
                    yield index, frame


def _ready(file: InputContainer, stream: Stream, options: dict[str, str]) -> VideoStream:
    video = file.streams[stream.index]
    if not isinstance(video, VideoStream):
        raise UnreadableError(f"{stream.path} has changed since it was looked at")
    for other in file.streams:
        if other.index != video.index:
            other.discard = av.stream.Discard.all
    context = video.codec_context
    context.thread_count = 1  # what is reported of a packet is then reported while it is decoded
    context.options = options | {"max_pixels": str(MOST_PIXELS)}
    return video


def _packets(file: InputContainer, video: VideoStream, stream: Stream, start: int | None) -> Iterator[av.Packet]:
    """Packets from the key picture `start` on, without those shown before it, which may depend on what came earlier; at mended times."""
    if start is not None:
        file.seek(start, stream=video)
    reached = start is None
    for packet in file.demux(video):
        if packet.pos is not None:
            packet.pts = stream.mended.get(packet.pos, packet.pts)
        if start is not None and packet.size:
            if not reached and packet.pts is not None and packet.pts > start and packet.is_keyframe:
                raise _Broken(f"the key picture at pts {start} is not found")
            reached = reached or packet.pts == start
            if not reached or (packet.pts is not None and packet.pts < start):
                continue
        yield packet


def _index(stream: Stream, frame: VideoFrame) -> int | None:
    """Which picture a frame is, by its time; None where it is not to be shown."""
    if frame.pts is None:
        return None
    index = int(stream.times.searchsorted(frame.pts))
    return index if index < stream.frames and stream.times[index] == frame.pts else None


def _lenient(stream: Stream, first: int, last: int, on_damage: OnDamage) -> Iterator[Picture]:
    """Goes on after damage; whatever is not certain to be intact is marked, or left out."""
    wanted, before = first, None
    for picture in _concealed(stream, first, last):
        if picture.index < wanted:
            continue
        if on_damage == "passthrough":
            for index in range(wanted, picture.index):
                yield _held(stream, before or picture, index)
            yield picture
        elif not picture.damaged:
            yield picture
        wanted, before = picture.index + 1, picture
    if on_damage == "passthrough" and wanted < last:
        if before is None:
            raise UnreadableError(f"{stream.path} holds no picture from {first} to {last} that can be decoded")
        for index in range(wanted, last):
            yield _held(stream, before, index)


def _held(stream: Stream, picture: Picture, index: int) -> Picture:
    return replace(
        picture, index=index, pts=int(stream.times[index]), duration=stream.spacing(index), time=stream.seconds(index), damaged=True
    )


def _concealed(stream: Stream, first: int, last: int) -> Iterator[Picture]:
    """All pictures that come out, in order, from the key picture before `first` on."""
    suspect, damaged = set[int](), False
    starts = stream.keys[stream.keys <= stream.times[first]]
    start = int(starts[-1]) if len(starts) and first else None
    with opened(stream.path, container.family(stream.path, strict=False)) as file:
        video = _ready(file, stream, {"err_detect": "crccheck+bitstream", "flags": "output_corrupt"})
        try:
            for packet in _packets(file, video, stream, start):
                with watched() as log:
                    try:
                        frames = packet.decode()
                    except av.error.FFmpegError:
                        frames, damaged = [], True
                damaged = bool(log) or packet.is_corrupt or (damaged and not packet.is_keyframe)
                if damaged and packet.pts is not None:
                    suspect.add(packet.pts)
                for frame in frames:
                    index = _index(stream, frame)
                    if index is not None and first <= index < last:
                        yield _picture(stream, frame, index, damaged=frame.is_corrupt or frame.pts in suspect)
                    suspect.discard(frame.pts or 0)
        except _Broken as reason:
            raise UnreadableError(f"{stream.path} is damaged: {reason}") from reason
