"""Standard input and output as pipes of pictures, for INPUT and OUTPUT that are `-`."""

import contextlib
import os
import sys
from collections.abc import Iterator
from io import FileIO
from typing import TYPE_CHECKING

from rsvideo.config import media

if TYPE_CHECKING:
    from rsvideo.config.request import Request
    from rsvideo.video.stream import Stream


@contextlib.contextmanager
def piped(request: "Request") -> "Iterator[Stream | None]":
    """The clip that standard input brings, if that is the source; ValueError or UnreadableError."""
    if not media.is_pipe(request.source):
        yield None
        return
    if sys.stdin is None or os.isatty(0):
        raise ValueError("INPUT - reads a clip from standard input, which is no pipe here; ffmpeg -i CLIP -f yuv4mpegpipe - writes one")
    from rsvideo.cli import quiet
    from rsvideo.pipeline import piping, prepare

    prepare.check(request)  # before all that the pipe holds is read
    with contextlib.ExitStack() as stack:
        with quiet.c_libraries():
            stream = stack.enter_context(piping.kept(request, open(0, "rb", closefd=False)))  # noqa: SIM115 - a descriptor
        yield stream


def standard_output() -> FileIO:
    """Where pictures go, unbuffered; ValueError where nobody could take them."""
    if os.isatty(1):
        raise ValueError("OUTPUT - writes pictures to standard output, which is a terminal; pipe it into a program such as ffmpeg -i -")
    return FileIO(1, "wb", closefd=False)
