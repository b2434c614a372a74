"""A clip that a pipe brings: what has to be stated of it, and a temporary file, since its pictures are gone through several times."""

import contextlib
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from io import BufferedIOBase
from pathlib import Path
from typing import TYPE_CHECKING

from rsvideo.config import media
from rsvideo.config.placing import aside
from rsvideo.config.request import Request

if TYPE_CHECKING:
    from rsvideo.video.stream import Stream


def check(request: Request) -> None:
    """Refuse what cannot be meant of pipes, or lacks what they do not state; ValueError."""
    source, output = media.is_pipe(request.source), media.is_pipe(request.output)
    if not (source or output):
        if stated := next((each for each in request.of_clips() if each.section == "pipe" and request.is_clip), None):
            raise ValueError(f"{stated.flag} concerns pipes, neither INPUT nor OUTPUT is -")
        if request.motion_only and request.encoding.pixel_format != "same":
            raise ValueError(f"--pixel-format concerns a pipe of bare pixels, {request.source} states its own")
        return
    if source:
        _check_source(request)
    elif request.pipe.size or request.pipe.matrix:
        raise ValueError(f"{'--size' if request.pipe.size else '--matrix'} concerns a pipe as INPUT, {request.source} states it itself")
    if output:
        _check_output(request)


def _check_source(request: Request) -> None:
    pipe, bare = request.pipe, request.pipe.format == "rawvideo"
    if request.deblur.method.steadied:
        raise ValueError(f"the method {request.deblur.method} needs a clip in a file, FFmpeg reads it anew")
    if not bare and pipe.size:
        raise ValueError("--size concerns --format rawvideo, y4m states its own")
    if not bare:
        return
    layout = request.encoding.pixel_format
    stated = {"--size": pipe.size, "--rate": request.input.rate, "--pixel-format": None if layout == "same" else layout}
    if missing := [flag for flag, value in stated.items() if value is None]:
        raise ValueError(f"{' and '.join(missing)} must be given with --format rawvideo, bare pixels do not state it; y4m does")
    from rsvideo.video.pipe import raw_layout

    if raw_layout(layout) is None:
        raise ValueError(
            f"--pixel-format of bare pixels must be planar, as yuv420p, or rgb24 or rgb48le, got {layout[:40]}; ffmpeg converts it"
        )


def _check_output(request: Request) -> None:
    encoding = request.encoding
    if not request.is_clip or request.motion_only:
        what = "a sidecar is" if request.motion_only else f"{request.source} is taken for a photograph, which is"
        raise ValueError(f"OUTPUT - is a pipe of a clip's pictures, {what} written to a file")
    if encoding.codec != "same" or encoding.crf is not None:
        raise ValueError(f"{'--codec' if encoding.codec != 'same' else '--crf'} concerns files, OUTPUT - carries {request.pipe.format}")
    if request.motion.path == "smooth":
        raise ValueError("--path smooth must be written to a file, the path is smoothed when all of it is found; OUTPUT is -")


@contextlib.contextmanager
def kept(request: Request, pipe: BufferedIOBase) -> "Iterator[Stream]":
    """The clip that a pipe brings, as long as the context lasts; ValueError or UnreadableError."""
    from rsvideo.video.pipe import Stated
    from rsvideo.video.pipe import kept as kept_in
    from rsvideo.video.stream import Matrix

    stated = Stated(
        format=request.pipe.format,
        size=request.pipe.size,
        rate=request.input.frame_rate,
        layout=request.encoding.pixel_format,
        matrix=Matrix(request.pipe.matrix) if request.pipe.matrix else None,
    )
    with aside(Path(tempfile.gettempdir())) as folder:
        stream = kept_in(pipe, stated, folder / "pictures", whole=request.input.on_damage == "fail")
        yield replace(stream, notes=(*stream.notes, *_assumed(request, stream)))


def _assumed(request: Request, stream: "Stream") -> Iterator[str]:
    taken = []
    if "matrix" in stream.colour.assumed:
        taken.append(f"the matrix {stream.colour.matrix.value} (--matrix states it)")
    if request.camera.transfer is None:
        taken.append(f"the curve {stream.colour.transfer.value} (--transfer states it)")
    if taken:
        yield f"a pipe does not state all of its colour; assumed is {' and '.join(taken)}"
