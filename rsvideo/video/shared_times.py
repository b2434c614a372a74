"""Pictures to which a container gives one time: their order and times of their own, found by decoding all of them."""

import contextlib
from collections.abc import Iterator, Sequence
from pathlib import Path

import av.error
import numpy as np
from av.container import InputContainer
from av.video.stream import VideoStream

from rsvideo.config.files import UnreadableError

_FARTHEST = 3  # usual steps from one picture to the next by which the time of a picture may be moved


def parted(path: Path, file: InputContainer, video: VideoStream, pts: Sequence[int]) -> list[int]:
    """A time for each picture, given and returned in the order of the packets, so that each is shown after the one before.

    Recorders and converters stumble while they begin: they give a time twice, and to pictures next to each other in the wrong order. The
    coded stream has an order of its own, in which players show it. The pictures get the same times in that order; those of one time
    share the time until the next. A clip whose pictures are not intact, or would be moved far, is damaged: UnreadableError.
    """
    rising = np.sort(np.array(pts, np.int64))
    shared = int(rising[np.argmax(np.diff(rising) == 0)])
    refusal = f"{path} must show one picture at a time, two are at pts {shared}"
    shown = np.array([*_shown(file, video)])
    if sorted(shown) != list(range(len(pts))):
        raise UnreadableError(f"{refusal}, and not all of its pictures can be decoded; is it damaged?")
    step = int(np.median(np.diff(rising)))
    times = np.empty(len(pts), np.int64)
    times[shown] = _spread(rising, step)
    if (np.diff(times[shown]) <= 0).any() or np.abs(times - pts).max() > _FARTHEST * step:
        raise UnreadableError(f"{refusal}, and others are not in order; is it damaged?")
    return times.tolist()


def _spread(rising: np.ndarray, step: int) -> np.ndarray:
    """Equal times spread over what is left until the next, or over a usual step."""
    distinct, first, count = np.unique(rising, return_index=True, return_counts=True)
    room = np.append(np.diff(distinct), step)
    place = np.arange(len(rising)) - np.repeat(first, count)
    return rising + place * np.repeat(room, count) // np.repeat(count, count)


def _shown(file: InputContainer, video: VideoStream) -> Iterator[int]:
    """The pictures' numbers among the packets, in the order in which a decoder shows them; ends where it fails."""
    video.codec_context.flush_buffers()
    file.seek(0)
    number = 0
    with contextlib.suppress(av.error.FFmpegError):
        for packet in file.demux(video):
            wanted = packet.size and not packet.is_discard
            packet.pts, packet.dts = number if wanted else None, None
            number += bool(wanted)
            yield from (frame.pts for frame in packet.decode() if frame.pts is not None)
