"""A photograph or a clip, whichever was asked for; what is slow to load is loaded when it is needed."""

from collections.abc import Callable
from typing import TYPE_CHECKING

from rsvideo.pipeline import job as photograph
from rsvideo.pipeline.job import Job, Task

if TYPE_CHECKING:
    from rsvideo.pipeline import clip, still
    from rsvideo.pipeline.clip_job import ClipJob, ClipTask


def prepare(job: "Job | ClipJob") -> "Task | ClipTask":
    """Answer every question that a job leaves; raises ValueError, UnreadableError or FileExistsError."""
    if isinstance(job, Job):
        return photograph.prepare(job)
    from rsvideo.pipeline import clip_job

    return clip_job.prepare(job)


def carry_out(task: "Task | ClipTask", observe: Callable[[str, float], None]) -> "still.Outcome | clip.Outcome":
    """Restore and write; `observe` is told the stage, and how much of the whole is done."""
    if isinstance(task, Task):
        from rsvideo.pipeline import still

        return still.carry_out(task, observe)
    from rsvideo.pipeline import clip

    return clip.carry_out(task, observe)
