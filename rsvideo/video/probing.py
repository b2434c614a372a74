"""What a clip's file holds, by its packets and its first picture; what its header promises must be there."""

import contextlib
import math
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import av
import av.error
import av.stream
import numpy as np
from av.container import InputContainer
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from jaxtyping import Int

from rsvideo.config.files import UnreadableError
from rsvideo.config.quantity import FASTEST_RATE, MOST_PIXELS
from rsvideo.stills.codes import check_pixels
from rsvideo.stills.ffmpeg import watched
from rsvideo.video import container, shared_times, tags
from rsvideo.video.sample_tables import MOST_SAMPLES
from rsvideo.video.stream import Stream, Track

_MOST_PIXELS_A_BYTE, _FREE_PIXELS = 10_000, 2_000_000_000  # cameras show 500 at most; the latter are decoded in a minute in any case
_SLACK, _SLACK_OF_FILE = 0.1, 0.5  # seconds by which a header may promise more than is there: of a track, and of all tracks together
_LONGEST_S = 10_000_000  # seconds, 115 days
_MOST_BEFORE_0 = 60  # seconds; sound may begin later than the picture, and a buffer be filled before
_SLOWEST_RATE = Fraction(1, 100_000)  # pictures a second: one a day
_CARRIED = {"gpmd"}  # data that writers of MP4 know: GoPro's sensors


def probed(path: Path, family: str, file: InputContainer, *, strict: bool) -> Stream:
    """What an open file holds; raises UnreadableError."""
    videos = [stream for stream in file.streams.video if not stream.disposition & av.stream.Disposition.attached_pic]
    if not videos:
        held = sorted({stream.type for stream in file.streams})
        raise UnreadableError(f"{path} must hold video, it holds {' and '.join(held) or 'no track'}; is it the right file?")
    video = videos[0]
    if video.codec_context is None:  # FFmpeg has no decoder, and PyAV then no size
        raise UnreadableError(f"{path} stores its pictures in a way that is not read; is its header damaged?")
    check_pixels(video.height, video.width, most=MOST_PIXELS)
    scanned = _scan(path, video, file, strict=strict)
    times, end, shown = scanned.times, scanned.end, scanned.shown
    if strict:
        _check_lengths(path, family, video, file, times, end)
    if shown is None:
        raise UnreadableError(f"{path} holds no picture that can be decoded; is it damaged?")
    colour, notes = tags.colour(path, video, shown)
    if scanned.mended:
        notes += (f"two pictures share one time; {len(scanned.mended)} are given others, in the order that the coded stream states",)
    kinds: dict[int, str] = {}
    if family == "mov":
        with contextlib.nullcontext() if strict else contextlib.suppress(UnreadableError):
            kinds = container.header(path).kinds
    matrix = tags.display_matrix(shown)
    own, metadata = dict(video.metadata), dict(file.metadata)
    by_name = {key.lower(): value for key, value in (metadata | own).items()}  # Matroska's are in capitals
    assert video.time_base is not None  # every stream of these containers has one
    return Stream(
        path=path,
        codec=video.codec_context.name,
        rows=shown.height,
        cols=shown.width,
        rate=_rate(path, video, times, end),
        time_base=video.time_base,
        times=times,
        end=end,
        colour=colour,
        index=video.index,
        keys=scanned.keys,
        bits=_bits(video, scanned),
        mended=scanned.mended,
        rotation=shown.rotation,
        display_matrix=matrix,
        sample_aspect_ratio=video.sample_aspect_ratio or Fraction(1),
        tracks=tuple(_track(stream, kinds.get(stream.id, "")) for stream in file.streams if stream.index != video.index),
        metadata=metadata,
        tags=own,
        timecode=by_name.get("timecode"),
        created=metadata.get("creation_time") or by_name.get("creation_time"),
        mastering=tags.mastering(shown),
        notes=notes,
    )


def _rate(path: Path, video: VideoStream, times: np.ndarray, end: int) -> Fraction:
    """Pictures a second, as stated or on average; UnreadableError where no clip can have it, or such times."""
    begin, base = int(times[0]), video.time_base or Fraction(0)
    if max(abs(begin), abs(end)) * base > _LONGEST_S:
        shown = f"from {float(begin * base):.4g} to {float(end * base):.4g} s"
        raise UnreadableError(f"{path} must be shown within {_LONGEST_S} s of its time 0, it says {shown}; is its header damaged?")
    rate = (
        video.average_rate or video.guessed_rate or (Fraction(len(times)) / ((end - begin) * base) if end > begin and base else Fraction(0))
    )
    if not _SLOWEST_RATE <= rate <= FASTEST_RATE:
        raise UnreadableError(
            f"{path} must show {_SLOWEST_RATE} to {FASTEST_RATE} pictures a second, it says {float(rate):.5g}; is its header damaged?"
        )
    return rate


@dataclass(frozen=True, kw_only=True, eq=False)
class _Scanned:
    """What the packets of a video say."""

    times: Int[np.ndarray, " frames"]  # pts of all pictures, rising
    keys: Int[np.ndarray, " keys"]  # of the key pictures
    end: int  # when the last picture ends
    predicted: Int[np.ndarray, " others"]  # bytes, of each picture that is no key picture
    mended: dict[int, int]  # as of Stream
    shown: VideoFrame | None  # the first picture that can be decoded


def _bits(video: VideoStream, scanned: _Scanned) -> float:
    """A stream's `bits`."""
    sizes = scanned.predicted
    return 8 * float(np.average(sizes, weights=sizes)) / math.sqrt(video.height * video.width) if len(sizes) else math.inf


def _scan(path: Path, video: VideoStream, file: InputContainer, *, strict: bool) -> _Scanned:
    video.codec_context.thread_count = 1
    video.codec_context.options = {"max_pixels": str(MOST_PIXELS)}
    for other in file.streams:
        if other.index != video.index:
            other.discard = av.stream.Discard.all
    times: list[int] = []
    at: list[int | None] = []
    keys: list[int] = []
    durations: list[int] = []
    predicted: list[int] = []
    shown, held = None, 0
    for packet in _intact(path, file.demux(video)) if strict else file.demux(video):
        if shown is None:
            with contextlib.suppress(av.error.FFmpegError):
                shown = next(iter(packet.decode()), None)
        if not packet.size or packet.is_discard:
            continue
        if packet.pts is None:
            raise UnreadableError(f"{path} must say when each picture is shown, picture {len(times)} has no time; is it damaged?")
        if packet.is_keyframe:
            keys.append(len(times))
        else:
            predicted.append(packet.size)
        held += packet.size
        times.append(packet.pts)
        at.append(packet.pos)
        durations.append(packet.duration or 0)
        if len(times) > MOST_SAMPLES:
            raise UnreadableError(f"{path} must hold at most {MOST_SAMPLES} pictures")
    if (pixels := len(times) * video.height * video.width) > max(_FREE_PIXELS, _MOST_PIXELS_A_BYTE * held):
        raise UnreadableError(
            f"{path} must hold a byte for every {_MOST_PIXELS_A_BYTE} pixels that it shows, it shows {pixels / 1e6:.4g} Mpx and holds"
            f" {held} bytes of them; is it one picture that stands still for long?"
        )
    if not times:
        raise UnreadableError(f"{path} holds no picture; is it cut short?")
    mended: dict[int, int] = {}
    if len(set(times)) < len(times):
        own = shared_times.parted(path, file, video, times)
        mended = {place: new for place, new, stated in zip(at, own, times, strict=True) if place is not None and new != stated}
        times = own
    order = np.argsort(times)
    rising = np.array(times, np.int64)[order]
    if (begins := float(rising[0] * (video.time_base or 0))) < -_MOST_BEFORE_0:
        raise UnreadableError(
            f"{path} must show its first picture {_MOST_BEFORE_0} s before time 0 at most, it does at {begins:g} s; is its header damaged?"
        )
    spacing = int(np.median(np.diff(rising))) if len(rising) > 1 else 1
    end = int(rising[-1]) + (durations[order[-1]] or spacing)
    return _Scanned(
        times=rising,
        keys=np.sort(np.array(times, np.int64)[keys]),
        end=end,
        predicted=np.array(predicted, np.int64),
        mended=mended,
        shown=shown,
    )


def _intact(path: Path, packets: Iterator[av.Packet]) -> Iterator[av.Packet]:
    """Packets, as long as the container that they come from is whole."""
    while True:
        with watched() as errors:
            packet = next(packets, None)
        if errors:
            raise UnreadableError(f"{path} is damaged: {errors[0]}")
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
    slack = max(_SLACK, 2 * float(np.diff(times).max(initial=0)) * base)
    others = [float(s.duration * s.time_base) for s in file.streams if s.duration and s.time_base and s.index != video.index]
    longest = max(end * base, held, *others, *_ends(file, family, others))
    if family == "mov":
        header = container.header(path)
        timed = header.timed_s.get(video.id, 0.0)
        promises = [(header.media_s.get(video.id, 0.0), max(timed, end * base, held) + slack)]
        if not header.fragmented:
            promises.append((header.shown_s, max([longest, *header.timed_s.values()]) + max(_SLACK_OF_FILE, slack)))
    else:
        promises = [((file.duration or 0) / 1e6, longest + max(_SLACK_OF_FILE, slack))]
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
