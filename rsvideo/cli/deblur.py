"""rsvideo deblur: one blurred photograph or clip in, a sharp one out, in this process. Batches and resuming are `rsvideo run`."""

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from rsvideo.cli import options, pipes
from rsvideo.cli.exit_codes import GoneError, note, refusing
from rsvideo.cli.terminal import say
from rsvideo.config import media

if TYPE_CHECKING:
    from io import RawIOBase

    from rsvideo.config.request import Request
    from rsvideo.pipeline.pieces import Outcome
    from rsvideo.pipeline.prepare import Task
    from rsvideo.progress import Observer
    from rsvideo.video.stream import Stream


@options.offers("camera", "motion", "deblur", "input", "encoding", "pipe")
def deblur(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="INPUT", help="A photograph (PNG, TIFF, JPEG, raw), a clip (MP4, MOV, MKV, - for a pipe), or a folder of pictures."
        ),
    ],
    output: Annotated[Path, Option("-o", "--output", metavar="OUTPUT", help="Where to write; the ending names the format. - is a pipe.")],
    given: options.Given,
    threads: options.Threads = None,
    preview: Annotated[
        bool, Option("--preview", help="A quick draft: of a clip, the middle frame; of large pictures, at half size. OUTPUT is a picture.")
    ] = False,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace OUTPUT and its sidecar.")] = False,
    json: Annotated[bool, Option("--json", help="Print the sidecar on standard output.")] = False,
) -> None:
    """Remove motion blur and rolling-shutter distortion from one photograph or clip.

    Beside OUTPUT a sidecar <stem>.rsvideo.json records the timing, the motion that was found and the verdict of each frame;
    of a clip, <stem>.gcsv the motion as a gyroscope's log.
    """
    options.use_threads(threads)
    with refusing():
        request = options.request(source, output, given, overwrite=overwrite).replaced(preview=preview)
        if json and preview:
            raise ValueError("--json prints the sidecar, a preview has none; leave one of them out")
        if json and media.is_pipe(output):
            raise ValueError("--json prints on standard output, OUTPUT - writes pictures there; give one of them")
        with pipes.piped(request) as piped:
            _carry_out(request, piped, json=json)


def _carry_out(request: "Request", piped: "Stream | None", *, json: bool) -> None:
    """Restore, write, and report what was done."""
    from rsvideo.allocation import nothing_collected
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import progress_bar

    with nothing_collected():
        from rsvideo.pipeline import demand
        from rsvideo.pipeline.prepare import prepare

    out = pipes.standard_output() if media.is_pipe(request.output) else None
    with quiet.c_libraries():
        task = prepare(request, piped)
        demand.check(task)
    note(task.notes)
    with progress_bar() as observe:
        outcome = _restored(task, out, observe)
    note(each for each in outcome.notes if each not in task.notes)
    if json:
        with request.record.open(encoding="utf-8") as record:
            shutil.copyfileobj(record, sys.stdout)
    else:
        say(f"{outcome.summary}: {'standard output' if out else request.output}")


def _restored(task: "Task", out: "RawIOBase | None", observe: "Observer") -> "Outcome":
    if out is None:
        from rsvideo.pipeline import deblur

        return deblur.carry_out(task, observe)
    from rsvideo.pipeline import piped

    try:
        return piped.carry_out(task, out, observe)
    except BrokenPipeError as error:
        raise GoneError(f"the reader of {error.filename} has gone: {error.strerror}") from error
