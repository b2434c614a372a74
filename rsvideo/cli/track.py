"""rsvideo track: the motion of a clip found, and nothing restored; `rsvideo deblur --trajectory` restores along it."""

import shutil
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from rsvideo.cli import options, pipes
from rsvideo.cli.exit_codes import note, refusing
from rsvideo.cli.terminal import say

if TYPE_CHECKING:
    from rsvideo.config.request import Request
    from rsvideo.video.stream import Stream


@options.offers("camera", "motion.model", "input", "pipe", "encoding.pixel_format")
def track(
    source: Annotated[Path, typer.Argument(metavar="CLIP", help="An MP4, MOV or MKV file, - for a pipe, or a folder of pictures.")],
    output: Annotated[Path, Option("-o", "--output", metavar="OUTPUT", help="The sidecar, such as clip.rsvideo.json.")],
    given: options.Given,
    threads: options.Threads = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace OUTPUT.")] = False,
    json: Annotated[bool, Option("--json", help="Print the sidecar on standard output.")] = False,
) -> None:
    """Find the motion of a clip, its exposure and its readout, and what will become of each frame; restore nothing.

    rsvideo deblur CLIP --trajectory OUTPUT then gives the pixels that rsvideo deblur CLIP gives with the same options.
    """
    options.use_threads(threads)
    with refusing():
        request = options.request(source, output, given, overwrite=overwrite).replaced(motion_only=True)
        with pipes.piped(request) as piped:
            _carry_out(request, piped, json=json)


def _carry_out(request: "Request", piped: "Stream | None", *, json: bool) -> None:
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import progress_bar
    from rsvideo.pipeline import demand
    from rsvideo.pipeline.prepare import prepare
    from rsvideo.pipeline.track import carry_out

    with quiet.c_libraries():
        task = prepare(request, piped)
        demand.check(task)
    note(task.notes)
    with progress_bar() as observe:
        outcome = carry_out(task, observe)
    if json:
        with request.output.open(encoding="utf-8") as record:
            shutil.copyfileobj(record, sys.stdout)
        return
    exposure, readout = task.shutter.exposure, task.shutter.readout
    say(f"exposure {1e3 * exposure.value:.4g} ms ({exposure.source}), readout {1e3 * readout.value:.4g} ms ({readout.source})")
    say(f"{outcome.summary}: {request.output}")
