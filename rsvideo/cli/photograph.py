"""How `rsvideo deblur` carries out one photograph."""

import sys

from rsvideo.pipeline.job import Job


def deblur(job: Job, *, json: bool) -> None:
    """Restore, write, and say what was done."""
    from rsvideo.cli import quiet
    from rsvideo.cli.progress import bar
    from rsvideo.config.files import write_whole
    from rsvideo.pipeline.job import prepare

    with quiet.c_libraries():
        task = prepare(job)

    from rsvideo.config import motion  # with what follows, the slow ones: mistakes so far are told at once
    from rsvideo.pipeline import still
    from rsvideo.restoration.blind import Settings

    settings = Settings(**job.steering)
    path = None if job.trajectory is None else motion.read(job.trajectory, task.timing, task.camera.intrinsics)
    for note in task.notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
    with bar() as show:
        outcome = still.carry_out(task, settings, path, lambda iterate: show(iterate.stage, iterate.fraction))
    write_whole(outcome.files)
    for note in outcome.notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
    if json:
        print(outcome.sidecar.encode().decode(), end="")
    else:
        record = outcome.sidecar.frames[0]
        print(f"rsvideo: {record.verdict}, {record.seconds:.1f} s: {job.output}", file=sys.stderr)
