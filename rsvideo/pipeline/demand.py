"""What a task demands of the machine: memory by the size of its pictures and by how many are held at a time."""

from rsvideo.config import memory
from rsvideo.config.method import Method
from rsvideo.config.request import Request
from rsvideo.pipeline.chunk import AHEAD, WARM_UP, longest, passed_on
from rsvideo.pipeline.prepare import Task
from rsvideo.video import encoder
from rsvideo.video.output_format import chosen

_BYTES_A_PIXEL = {"photograph": 600, "given": 300, "clip": 900, "none": 40}  # as measured from 0.08 to 2.8 Mpx
_LARGE, _BYTES_BEYOND = 2.8e6, 300  # pixels of a photograph, and bytes of each beyond: 12 Mpx took 3.4 GB, 24 Mpx 6.2 GB


def check(task: Task) -> None:
    """Refuse a task for which there is no memory; UnreadableError."""
    memory.check(task.request.source, f"its pictures are {task.cols} x {task.rows}", _needed(task))


def _needed(task: Task) -> float:
    """Bytes at a time."""
    if task.request.is_clip and passed_on(task):
        assert task.encoding is not None
        codec, _, _ = chosen(task.request.output, task.stream, task.encoding)
        return encoder.bytes_held(codec, task.rows, task.cols) + task.picture_bytes
    at_a_time = longest(task.picture_bytes) + WARM_UP + AHEAD if task.request.is_clip else 1
    return _of_pixels(_kind(task.request), task.rows * task.cols) + min(at_a_time, task.frames) * task.picture_bytes


def _of_pixels(kind: str, count: int) -> float:
    """Bytes for pictures of so many pixels; the search of a larger photograph does not grow with it."""
    beyond = max(0.0, count - _LARGE) if kind == "photograph" else 0.0
    return _BYTES_A_PIXEL[kind] * (count - beyond) + _BYTES_BEYOND * beyond


def _kind(request: Request) -> str:
    if request.is_clip:
        return "clip"
    if request.deblur.method is Method.NONE:
        return "none"
    return "given" if request.motion.trajectory else "photograph"
