"""How `rsvideo deblur` carries out one photograph or clip: in this process. Batches and resuming are `rsvideo run`."""

import shutil
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from rsvideo.pipeline.clip_job import ClipJob
    from rsvideo.pipeline.job import Job


def deblur(job: "Job | ClipJob", *, json: bool) -> None:
    """Restore, write, and say what was done."""
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import bar
    from rsvideo.pipeline.deblur import carry_out, prepare

    with quiet.c_libraries():
        task = prepare(job)
    _note(task.notes)
    with bar() as show:
        outcome = carry_out(task, show)
    _note(note for note in outcome.notes if note not in task.notes)
    if json:
        with job.record.open(encoding="utf-8") as record:
            shutil.copyfileobj(record, sys.stdout)
    else:
        print(f"rsvideo: {outcome.told}: {job.output}", file=sys.stderr)


def _note(notes: Iterable[str]) -> None:
    for note in notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
