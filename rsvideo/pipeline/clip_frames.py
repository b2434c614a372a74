"""A clip's frames as they are decoded, and in linear light."""

from collections.abc import Iterator

from rsvideo.frame import Frame
from rsvideo.pipeline.prepare import Task
from rsvideo.video import colour, decode
from rsvideo.video.stream import Colour, Picture, Stream


def pictures(task: Task, first: int | None = None, last: int | None = None) -> Iterator[Picture]:
    """Those from first to last - 1, or all that are restored."""
    first, last = task.first if first is None else first, task.last if last is None else last
    return decode.pictures(task.stream, first, last, on_damage=task.request.input.on_damage)


def decoded(stream: Stream, first: int, last: int, *, on_damage: decode.OnDamage = "fail") -> Iterator[Frame]:
    """Frames first to last - 1 in linear light."""
    return (frame(stream.colour, picture) for picture in decode.pictures(stream, first, last, on_damage=on_damage))


def frame(meaning: Colour, picture: Picture) -> Frame:
    """A picture in linear light."""
    pixels, clipped = colour.light(picture, meaning)
    return Frame(pixels=pixels, clipped=clipped, time=picture.time, index=picture.index)


def picture_bytes(stream: Stream) -> int:
    """Of a picture as decoded."""
    c = stream.colour
    chroma = 0 if c.subsampling == "4:0:0" else 2 / (1 << sum(c.chroma_shift))
    return round(stream.rows * stream.cols * (1 + chroma) * (4 if c.floating else 1 if c.depth == 8 else 2))
