"""How `rsvideo deblur` carries out one clip in this process; batches and resuming are `rsvideo run`."""

import shutil
import sys

from rsvideo.pipeline.clip import ClipJob, carry_out, prepare


def deblur(job: ClipJob, *, json: bool) -> None:
    """Restore, write, and say what was done."""
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import bar

    with quiet.c_libraries():
        task = prepare(job)
    for note in task.notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
    with bar() as show:
        outcome = carry_out(task, show)
    for note in outcome.notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
    if json:
        with task.record.open(encoding="utf-8") as record:
            shutil.copyfileobj(record, sys.stdout)
    else:
        told = f"{outcome.restored} frames restored, {outcome.left} left as they were, {outcome.failed} failed, {outcome.seconds:.0f} s"
        print(f"rsvideo: {told}: {job.output}", file=sys.stderr)
