"""Clips read strictly: what a file holds, and its pictures in order, none lost and none damaged unnoticed."""

import contextlib
import re
import struct
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

from rsvideo.config.files import UnreadableError
from rsvideo.physics.tone import Transfer
from rsvideo.video import container, sequence
from rsvideo.video.clip import Colour, Matrix, Picture, Stream, Track, planar
from rsvideo.video.codes import MOST_PIXELS, check_pixels
from rsvideo.video.ffmpeg import arrays, watched

OnDamage = Literal["fail", "passthrough", "skip"]

MOST_FRAMES = 20_000_000  # 92 hours at 60 a second
_STRICT = "explode+crccheck+bitstream"

_MATRIX = {0: Matrix.RGB, 1: Matrix.BT709, 5: Matrix.BT601, 6: Matrix.BT601, 9: Matrix.BT2020}
_TRANSFER = {
    **dict.fromkeys((1, 6, 11, 14, 15), Transfer.BT709),
    4: Transfer.GAMMA22,
    5: Transfer.GAMMA28,
    8: Transfer.LINEAR,
    13: Transfer.SRGB,
    16: Transfer.PQ,
    18: Transfer.HLG,
}
_PRIMARIES = {
    1: "bt709",
    4: "bt470m",
    5: "bt470bg",
    6: "smpte170m",
    7: "smpte240m",
    8: "film",
    9: "bt2020",
    10: "smpte428",
    11: "smpte431",
    12: "smpte432",
    22: "ebu3213",
}
_UNSAID = {2}
_CARRIED = {"gpmd"}  # data that writers of MP4 know: GoPro's sensors
_FULL = 2  # FFmpeg's AVCOL_RANGE_JPEG

_LAYOUT_OF = (  # layouts that are handed over as planes of the same codes
    (re.compile(r"(rgb24|bgr24|0rgb|rgb0|0bgr|bgr0|argb|rgba|abgr|bgra|pal8)"), "gbrp"),
    (re.compile(r"(rgb48|bgr48|rgba64|bgra64)[lb]e"), "gbrp16le"),
    (re.compile(r"(nv12|nv21)"), "yuv420p"),
    (re.compile(r"nv16"), "yuv422p"),
    (re.compile(r"(yuyv422|uyvy422|yvyu422)"), "yuv422p"),
    (re.compile(r"p010[lb]e"), "yuv420p10le"),
    (re.compile(r"p210[lb]e"), "yuv422p10le"),
    (re.compile(r"(mono[wb]|ya8)"), "gray"),
)


def probe(path: Path, rate: Fraction | None = None, *, on_damage: OnDamage = "fail") -> Stream:
    """What a file, a folder or a pattern such as `shot_####.dng` holds. `rate` is for sequences, which do not know theirs.

    A container that is damaged or cut short raises UnreadableError, unless `on_damage` takes what can be found.
    """
    strict = on_damage == "fail"
    if sequence.is_sequence(path):
        return sequence.probe(path, rate)
    family = container.family(path, strict=strict)
    try:
        with _opened(path, family) as file:
            return _probed(path, family, file, strict=strict)
    except av.error.FFmpegError as error:
        raise UnreadableError(f"{path} cannot be read: {_said(error)}; is it damaged or cut short?") from error
    except (ValueError, OverflowError) as error:
        raise error if isinstance(error, UnreadableError) else UnreadableError(f"{path} {error}") from error


def pictures(stream: Stream, first: int = 0, last: int | None = None, *, on_damage: OnDamage = "fail") -> Iterator[Picture]:
    """The pictures first, ..., last - 1, exactly as decoding from the start gives them.

    What is damaged or missing raises UnreadableError; or is handed over as decoded, or as the picture before, marked as
    damaged ("passthrough"); or is left out ("skip"). Damage reaches to the next picture that depends on no other.
    """
    last = stream.frames if last is None else last
    if not 0 <= first < last <= stream.frames:
        raise ValueError(f"the range must lie within the clip's {stream.frames} pictures, got {first} to {last}")
    if stream.files:
        yield from sequence.pictures(stream, first, last)
        return
    try:
        yield from _strict(stream, first, last) if on_damage == "fail" else _lenient(stream, first, last, on_damage)
    except av.error.FFmpegError as error:
        raise UnreadableError(f"{stream.path} cannot be read: {_said(error)}") from error


def _opened(path: Path, family: str) -> InputContainer:
    return av.open(str(path), "r", format=family, metadata_errors="replace")


def _said(error: av.error.FFmpegError) -> str:
    """What FFmpeg says of an error, without the path that it adds."""
    return (error.strerror or type(error).__name__).lower()


def _probed(path: Path, family: str, file: InputContainer, *, strict: bool) -> Stream:
    videos = [stream for stream in file.streams.video if not stream.disposition & av.stream.Disposition.attached_pic]
    if not videos:
        held = sorted({stream.type for stream in file.streams})
        raise UnreadableError(f"{path} must hold video, it holds {' and '.join(held) or 'no track'}; is it the right file?")
    video = videos[0]
    check_pixels(video.height, video.width)
    times, keys, end, shown = _scan(path, video, file, strict=strict)
    if strict:
        _check_lengths(path, family, video, file, times, end)
    if shown is None:
        raise UnreadableError(f"{path} holds no picture that can be decoded; is it damaged?")
    colour, notes = _colour(path, video, shown)
    kinds: dict[int, str] = {}
    if family == "mov":
        with contextlib.nullcontext() if strict else contextlib.suppress(UnreadableError):
            kinds = container.header(path).kinds
    matrix = _display_matrix(shown)
    tags, metadata = dict(video.metadata), dict(file.metadata)
    told = {key.lower(): value for key, value in (metadata | tags).items()}  # Matroska's are in capitals
    assert video.time_base is not None  # every stream of these containers has one
    return Stream(
        path=path,
        codec=video.codec_context.name,
        rows=shown.height,
        cols=shown.width,
        rate=video.average_rate or video.guessed_rate or Fraction(len(times)) / (Fraction(end - int(times[0])) * video.time_base),
        time_base=video.time_base,
        times=times,
        end=end,
        colour=colour,
        index=video.index,
        keys=keys,
        rotation=shown.rotation,
        display_matrix=matrix,
        sample_aspect_ratio=video.sample_aspect_ratio or Fraction(1),
        tracks=tuple(_track(stream, kinds.get(stream.id, "")) for stream in file.streams if stream.index != video.index),
        metadata=metadata,
        tags=tags,
        timecode=told.get("timecode"),
        created=metadata.get("creation_time") or told.get("creation_time"),
        mastering=_mastering(shown),
        notes=notes,
    )


def _scan(path: Path, video: VideoStream, file: InputContainer, *, strict: bool) -> tuple[np.ndarray, np.ndarray, int, VideoFrame | None]:
    """The pts of all pictures and of the key pictures, when the last ends, and the first picture that can be decoded."""
    video.codec_context.thread_count = 1
    video.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
    for other in file.streams:
        if other.index != video.index:
            other.discard = av.stream.Discard.all
    times: list[int] = []
    keys: list[int] = []
    durations: list[int] = []
    shown = None
    for packet in _intact(path, file.demux(video)) if strict else file.demux(video):
        if shown is None:
            with contextlib.suppress(av.error.FFmpegError):
                shown = next(iter(packet.decode()), None)
        if not packet.size or packet.is_discard:
            continue
        if packet.pts is None:
            raise UnreadableError(f"{path} must say when each picture is shown, picture {len(times)} has no time; is it damaged?")
        times.append(packet.pts)
        durations.append(packet.duration or 0)
        if packet.is_keyframe:
            keys.append(packet.pts)
        if len(times) > MOST_FRAMES:
            raise UnreadableError(f"{path} must hold at most {MOST_FRAMES} pictures")
    if not times:
        raise UnreadableError(f"{path} holds no picture; is it cut short?")
    order = np.argsort(times, kind="stable")
    rising = np.array(times, np.int64)[order]
    if len(rising) > 1 and (twice := np.diff(rising) <= 0).any():
        raise UnreadableError(f"{path} must show one picture at a time, two are at pts {rising[np.argmax(twice)]}; is it damaged?")
    spacing = int(np.median(np.diff(rising))) if len(rising) > 1 else 1
    return rising, np.sort(np.array(keys, np.int64)), int(rising[-1]) + (durations[order[-1]] or spacing), shown


def _intact(path: Path, packets: Iterator[av.Packet]) -> Iterator[av.Packet]:
    """Packets, as long as the container that they come from is whole."""
    while True:
        with watched() as said:
            packet = next(packets, None)
        if said:
            raise UnreadableError(f"{path} is damaged: {said[0]}")
        if packet is None:
            return
        yield packet


def _check_lengths(path: Path, family: str, video: VideoStream, file: InputContainer, times: np.ndarray, end: int) -> None:
    """What the header promises must be there."""
    if family == "mov" and (promised := sum(entry.size > 0 for entry in video.index_entries)) > len(times):
        discarded = sum(entry.is_discard for entry in video.index_entries)
        if promised - discarded > len(times):
            raise UnreadableError(f"{path} is cut short: its index promises {promised - discarded} pictures, {len(times)} are there")
    base = float(video.time_base or 1)
    held = (end - int(times[0])) * base
    slack = max(0.1, 2 * float(np.diff(times).max(initial=0)) * base)
    others = [float(s.duration * s.time_base) for s in file.streams if s.duration and s.time_base and s.index != video.index]
    longest = max(end * base, held, *others, *_ends(file, family, others))
    if family == "mov":
        said = container.header(path)
        timed = said.timed_s.get(video.id, 0.0)
        promises = [(said.media_s.get(video.id, 0.0), max(timed, end * base, held) + slack)]
        if not said.fragmented:
            promises.append((said.shown_s, max([longest, *said.timed_s.values()]) + max(0.5, slack)))
    else:
        promises = [((file.duration or 0) / 1e6, longest + max(0.5, slack))]
    for promised, there in promises:
        if promised > there:
            raise UnreadableError(f"{path} is cut short: its header promises {promised:.2f} s, {max(held, longest):.2f} s are there")


def _ends(file: InputContainer, family: str, others: list[float]) -> list[float]:
    """When tracks end that do not say so themselves: Matroska's only last packets tell."""
    if family == "mov" or len(others) == len(file.streams) - 1:
        return []
    for stream in file.streams:
        stream.discard = av.stream.Discard.default
    file.seek(0)
    ends = [0.0]
    for packet in file.demux():
        if packet.pts is not None and packet.time_base:
            ends.append(float((packet.pts + (packet.duration or 0)) * packet.time_base))
    return [max(ends)]


def _track(stream: av.stream.Stream, four_letters: str) -> Track:
    kind, name = stream.type, stream.metadata.get("handler_name") or stream.metadata.get("title") or ""
    codec = stream.codec_context.name if stream.codec_context else four_letters
    return Track(index=stream.index, kind=kind, codec=codec, copied=kind in ("audio", "subtitle") or codec in _CARRIED, name=name.strip())


def _display_matrix(frame: VideoFrame) -> tuple[int, ...] | None:
    data = frame.side_data.get("DISPLAYMATRIX")
    return None if data is None else struct.unpack("=9i", bytes(data)[:36])


def _mastering(frame: VideoFrame) -> tuple[str, ...]:
    """What HDR10 says of the display that the clip was graded on and of its brightest light, as parameters of x265."""
    found = []
    if data := frame.side_data.get("MASTERING_DISPLAY_METADATA"):
        *ratios, has_primaries, has_luminance = struct.unpack("=20i2i", bytes(data)[:88])
        values = [number / divisor if divisor else 0.0 for number, divisor in zip(ratios[::2], ratios[1::2], strict=True)]
        red_x, red_y, green_x, green_y, blue_x, blue_y, white_x, white_y = (round(50_000 * value) for value in values[:8])
        least, most = (round(10_000 * value) for value in values[8:])
        if has_primaries and has_luminance:
            points = f"G({green_x},{green_y})B({blue_x},{blue_y})R({red_x},{red_y})WP({white_x},{white_y})"
            found.append(f"master-display={points}L({most},{least})")
    if data := frame.side_data.get("CONTENT_LIGHT_LEVEL"):
        found.append("max-cll={},{}".format(*struct.unpack("=2I", bytes(data)[:8])))
    return tuple(found)


def _layout(name: str) -> str | None:
    """The planes in which a format is handed over: its own without alpha, or those that hold the same codes."""
    plain = re.sub(r"^yuva", "yuv", re.sub(r"^gbra", "gbr", name.replace("be", "le")))
    return plain if planar(plain) else next((to for pattern, to in _LAYOUT_OF if pattern.fullmatch(name)), None)


def _colour(path: Path, video: VideoStream, frame: VideoFrame) -> tuple[Colour, tuple[str, ...]]:
    stored, layout = frame.format.name, _layout(frame.format.name)
    if layout is None or (facts := planar(layout)) is None:
        raise UnreadableError(f"{path} stores its pixels as {stored}, which is not read; convert it to yuv422p10le first")
    depth, subsampling, shift = facts
    context = video.codec_context
    h273 = (int(context.color_primaries), int(context.color_trc), int(context.colorspace), int(context.color_range))
    rgb, assumed = layout.startswith("gbr"), set[str]()
    matrix = Matrix.RGB if rgb else _MATRIX.get(h273[2])
    if h273[2] in _UNSAID and not rgb:
        assumed.add("matrix")
        matrix = Matrix.BT709 if frame.height >= 720 else Matrix.BT601
    if matrix is None or (matrix is Matrix.RGB) != rgb:
        raise UnreadableError(f"{path} mixes its colours by matrix {h273[2]} of H.273, which is not read; convert it to BT.709 first")
    transfer = _TRANSFER.get(h273[1])
    if transfer is None:
        assumed.add("transfer")
    if h273[0] not in _PRIMARIES:
        assumed.add("primaries")
    by_format = rgb or layout.startswith("yuvj")
    if not h273[3] and not by_format:
        assumed.add("full_range")
    notes: tuple[str, ...] = ()
    if any(frame.side_data.get(kind) for kind in ("DOVI_METADATA", "DOVI_RPU_BUFFER", "DYNAMIC_HDR_PLUS")):
        notes += ("its metadata for each picture (Dolby Vision or HDR10+) is not carried over",)
    if any(part.is_alpha for part in frame.format.components):
        notes += ("its transparency is not carried over",)
    if frame.interlaced_frame:
        notes += ("it is tagged as interlaced; its two fields are taken as one exposure",)
    return (
        Colour(
            matrix=matrix,
            transfer=transfer or Transfer.BT709,
            primaries=_PRIMARIES.get(h273[0], "bt709"),
            full_range=by_format or h273[3] == _FULL,
            depth=depth,
            subsampling=subsampling,
            pixel_format=layout,
            chroma_shift=shift,
            assumed=frozenset(assumed),
            h273=h273,
        ),
        notes,
    )


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
    if _layout(frame.format.name) != stream.colour.pixel_format:
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
    with _opened(stream.path, container.family(stream.path, strict=False)) as file:
        video = _ready(file, stream, {"err_detect": _STRICT})
        for packet in _packets(file, video, start):
            near = stream.times.searchsorted(packet.pts) if packet.pts is not None else last
            if packet.is_corrupt:
                raise _Broken(f"the packet of picture {near} is incomplete")
            with watched() as log:
                try:
                    frames = packet.decode()
                except av.error.FFmpegError as error:
                    said = log[0] if log else _said(error)
                    raise _Broken(f"picture {near} cannot be decoded ({said})") from error
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
    context.thread_count = 1  # what is said of a packet is then said while it is decoded
    context.options = options | {"max_pixels": str(MOST_PIXELS)}
    return video


def _packets(file: InputContainer, video: VideoStream, start: int | None) -> Iterator[av.Packet]:
    """Packets from the key picture `start` on, without those shown before it, which may depend on what came earlier."""
    if start is not None:
        file.seek(start, stream=video)
    reached = start is None
    for packet in file.demux(video):
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
    with _opened(stream.path, container.family(stream.path, strict=False)) as file:
        video = _ready(file, stream, {"err_detect": "crccheck+bitstream", "flags": "output_corrupt"})
        try:
            for packet in _packets(file, video, start):
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
