"""One clip restored into a pipe: each frame as soon as it is done, and nothing else."""

import tempfile
from collections.abc import Iterator
from io import RawIOBase
from pathlib import Path

from rsvideo.config.placing import aside
from rsvideo.pipeline.chunk import chunks, shown
from rsvideo.pipeline.clip import Tally, outcome, side_by_side
from rsvideo.pipeline.pieces import Outcome
from rsvideo.pipeline.prepare import Task
from rsvideo.progress import Observer, Progress
from rsvideo.video import colour as tint
from rsvideo.video import pipe
from rsvideo.video.output_format import chosen
from rsvideo.video.stream import Picture


def carry_out(task: Task, out: RawIOBase, observe: Observer) -> Outcome:
    """Restore the clip; BrokenPipeError where the reader has gone."""
    assert task.encoding is not None
    codec, layout, _ = chosen(task.request.output, task.stream, task.encoding)
    bare, tally, written = codec == "rawvideo", Tally(), 0
    name = task.encoding.pixel_format if bare and task.encoding.pixel_format in pipe.PACKED else layout.pixel_format
    observe(Progress(stage="looking for cuts", fraction=0.0))

    def restored() -> Iterator[Picture]:
        for chunk in chunks(task):

            def tell(at: Progress, done=chunk.first - task.first, chunk=chunk) -> None:
                observe(Progress(stage=f"frame {at.frame}: {at.stage}", fraction=(done + chunk.done(at)) / task.frames))

            for picture, frame in shown(task, chunk, folder, tell):
                tally.add(frame)
                yield picture

    with aside(Path(tempfile.gettempdir())) as folder:
        stream, pictures = side_by_side(task, restored()) if task.request.encoding.side_by_side else (task.stream, restored())
        try:
            if not bare:
                _write(out, pipe.header(stream, layout))
            for picture in pictures:
                same = layout == task.stream.colour
                _write(out, pipe.encoded(picture if same else tint.relaid(picture, task.stream.colour, layout), name, bare=bare))
                written += 1
        except BrokenPipeError as error:
            raise BrokenPipeError(error.errno, f"{written} of {task.frames} frames were written", str(pipe.STDOUT)) from error
        except OSError as error:
            raise OSError(error.errno, error.strerror, error.filename or str(pipe.STDOUT)) from error
    return outcome(task, tally, ())


def _write(out: RawIOBase, data: bytes) -> None:
    left = memoryview(data)
    while left:
        left = left[out.write(left) or 0 :]
