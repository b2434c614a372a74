"""A task carried out, of a photograph or of a clip: at once, or in pieces that may be done by several processes.

What is slow to load is loaded when it is needed.
"""

from dataclasses import replace
from pathlib import Path
from types import ModuleType

from rsvideo.config.method import Method
from rsvideo.config.sidecar import Mark
from rsvideo.pipeline.pieces import Chunk, ChunkRecord, Finished, Outcome
from rsvideo.pipeline.prepare import Task
from rsvideo.progress import Observer


def carry_out(task: Task, observe: Observer) -> Outcome:
    """Restore and write, in this process; all of it on the processor where a GPU's memory does not do."""
    if task.request.deblur.method is not Method.NONE and task.settings.splittings and task.settings.device == "cpu":
        from rsvideo.solvers import ahead

        ahead.begin()
    try:
        return _kind(task).carry_out(task, observe)
    except MemoryError as error:
        if task.settings.device == "cpu":
            raise
        note = f"the GPU's memory did not do, all was computed on the processor ({error})"
    outcome = _kind(task).carry_out(replace(task, settings=replace(task.settings, device="cpu")), observe)
    return replace(outcome, notes=(*outcome.notes, note))


def chunks(task: Task) -> list[Chunk]:
    """The pieces that are restored one by one; depend on the source and the request alone."""
    return _kind(task).chunks(task)


def work(task: Task, chunk: Chunk, folder: Path, observe: Observer) -> ChunkRecord:
    """Restore a piece into files of `folder`; `observe` gets how much of each frame is done."""
    return _kind(task).work(task, chunk, folder, observe)


def finish(task: Task, records: list[ChunkRecord], folder: Path, mark: Mark | None = None) -> Finished:
    """The result from its pieces, and what goes beside it, within `folder`; `mark` says in the sidecar which job it is of."""
    return _kind(task).finish(task, records, folder, mark)


def _kind(task: Task) -> ModuleType:
    """The module that reads and writes a source of this kind."""
    if task.request.preview:
        from rsvideo.pipeline import preview

        return preview
    if task.request.is_clip:
        from rsvideo.pipeline import clip

        return clip
    from rsvideo.pipeline import photograph

    return photograph
