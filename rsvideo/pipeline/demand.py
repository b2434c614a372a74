"""What a task demands of the machine: memory by the size of its pictures and by how many are held at a time."""

from rsvideo.config import memory
from rsvideo.config.method import Method
from rsvideo.config.request import Request
from rsvideo.pipeline.chunk import AHEAD, WARM_UP, longest
from rsvideo.pipeline.prepare import Task

_BYTES_A_PIXEL = {"photograph": 600, "given": 300, "clip": 900, "none": 40}  # as measured from 0.08 to 2.8 Mpx


def check(task: Task) -> None:
    """Refuse a task for which there is no memory; UnreadableError."""
    kind = _kind(task.request)
    at_a_time = longest(task.picture_bytes) + WARM_UP + AHEAD if task.request.is_clip else 1
    needed = _BYTES_A_PIXEL[kind] * task.rows * task.cols + min(at_a_time, task.frames) * task.picture_bytes
    memory.check(task.request.source, f"its pictures are {task.cols} x {task.rows}", needed)


def _kind(request: Request) -> str:
    if request.deblur.method is Method.NONE:
        return "none"
    if request.is_clip:
        return "clip"
    return "given" if request.motion.trajectory else "photograph"
