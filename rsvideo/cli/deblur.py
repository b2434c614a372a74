"""rsvideo deblur: one blurred photograph or clip in, a sharp one out, in this process. Batches and resuming are `rsvideo run`."""

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from rsvideo.cli import options
from rsvideo.cli.exit_codes import note, refusing
from rsvideo.cli.terminal import say

if TYPE_CHECKING:
    from rsvideo.config.request import Request


@options.offers("camera", "motion", "deblur", "input", "encoding")
def deblur(
    source: Annotated[
        Path, typer.Argument(metavar="INPUT", help="A photograph (PNG, TIFF, JPEG, raw), a clip (MP4, MOV, MKV), or a folder of pictures.")
    ],
    output: Annotated[Path, Option("-o", "--output", metavar="OUTPUT", help="Where to write; the ending names the format.")],
    given: options.Given,
    threads: options.Threads = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace OUTPUT and its sidecar.")] = False,
    json: Annotated[bool, Option("--json", help="Print the sidecar on standard output.")] = False,
) -> None:
    """Remove motion blur and rolling-shutter distortion from one photograph or clip.

    Beside OUTPUT a sidecar <stem>.rsvideo.json records the timing, the motion that was found and the verdict of each frame;
    of a clip, <stem>.gcsv the motion as a gyroscope's log.
    """
    options.use_threads(threads)
    with refusing():
        _carry_out(options.request(source, output, given, overwrite=overwrite), json=json)


def _carry_out(request: "Request", *, json: bool) -> None:
    """Restore, write, and report what was done."""
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import progress_bar
    from rsvideo.pipeline import demand
    from rsvideo.pipeline.deblur import carry_out
    from rsvideo.pipeline.prepare import prepare

    with quiet.c_libraries():
        task = prepare(request)
        demand.check(task)
    note(task.notes)
    with progress_bar() as observe:
        outcome = carry_out(task, observe)
    note(each for each in outcome.notes if each not in task.notes)
    if json:
        with request.record.open(encoding="utf-8") as record:
            shutil.copyfileobj(record, sys.stdout)
    else:
        say(f"{outcome.summary}: {request.output}")
