"""How `rsvideo deblur` carries out one clip: chunk after chunk in this process; batches and resuming are `rsvideo run`."""

import sys
import tempfile
from pathlib import Path

from rsvideo.pipeline.clip import ClipJob, chunks, finish, prepare, work


def deblur(job: ClipJob, *, json: bool) -> None:
    """Restore, write, and say what was done."""
    from rsvideo.cli.progress import bar

    task = prepare(job)
    for note in task.notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
    with bar() as show, tempfile.TemporaryDirectory(prefix=".rsvideo-", dir=job.output.parent) as name:
        folder, done, records = Path(name), 0, []
        show("looking for cuts", 0.0)
        for chunk in chunks(task):

            def observe(index: int, stage: str, fraction: float, chunk=chunk, done=done) -> None:
                show(f"frame {index}: {stage}", (done + max(0.0, index - chunk.first + fraction)) / task.frames)

            records.append(work(task, chunk, folder, observe))
            done += chunk.last - chunk.first + 1
        show("encoding", 1.0)
        outcome = finish(task, records, folder)
    for note in outcome.notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
    if json:
        print(task.record.read_text(encoding="utf-8"), end="")
    else:
        told = f"{outcome.restored} frames restored, {outcome.left} left as they were, {outcome.failed} failed, {outcome.seconds:.0f} s"
        print(f"rsvideo: {told}: {job.output}", file=sys.stderr)
