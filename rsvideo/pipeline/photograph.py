"""One photograph, from file to file."""

import hashlib
import tempfile
from pathlib import Path

import numpy as np

from rsvideo.config import sidecar
from rsvideo.config.files import made_within, write_whole
from rsvideo.config.placing import aside, place
from rsvideo.config.sidecar import FrameRecord, Mark
from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.pipeline import given_blur, methods, output
from rsvideo.pipeline.pieces import Chunk, ChunkRecord, Finished, Outcome, frame_records, stated
from rsvideo.pipeline.prepare import Task
from rsvideo.progress import Observer
from rsvideo.shooting import given_motion
from rsvideo.stills import still
from rsvideo.stills.still import Format


def carry_out(task: Task, observe: Observer) -> Outcome:
    """Restore the photograph, with a motion that is given or without, and write it with its sidecar."""
    result = _restored(task, observe)
    data, notes = _encoded(task, result)
    with aside(task.request.output.parent) as folder:
        finished = _made(task, data, output.frame_record(result), notes, folder)
        place(finished.made)
    return finished.outcome


def chunks(task: Task) -> list[Chunk]:  # noqa: ARG001 # as of a clip
    """The one frame."""
    return [Chunk(index=0, first=0, last=0, warm_up=0)]


def work(task: Task, chunk: Chunk, folder: Path, observe: Observer) -> ChunkRecord:
    """Restore the photograph into a file of `folder`."""
    result = _restored(task, observe)
    data, notes = _encoded(task, result)
    line = output.frame_record(result).encode() + b"\n"
    held = {f"{chunk.index:06}{task.request.output.suffix}": data, f"{chunk.index:06}.jsonl": line}
    write_whole({folder / name: content for name, content in held.items()})
    pictures, frames = held
    return ChunkRecord(
        pictures=pictures, frames=frames, sha256={name: hashlib.sha256(content).hexdigest() for name, content in held.items()}, notes=notes
    )


def finish(task: Task, records: list[ChunkRecord], folder: Path, mark: Mark | None = None) -> Finished:
    """The restored photograph with its sidecar, in a folder of their own within `folder`."""
    (record,) = records
    (frame,) = frame_records(records, folder)
    within = Path(tempfile.mkdtemp(prefix="run-", dir=folder))
    return _made(task, (folder / record.pictures).read_bytes(), frame, record.notes, within, mark)


def _restored(task: Task, observe: Observer) -> FrameResult:
    given, treatment = task.request.motion.trajectory, task.treatment
    trajectory = None
    if given is not None:
        trajectory = given_motion.read(given, treatment.camera)
        given_blur.check(given, trajectory, treatment.camera)
    frame = Frame(pixels=task.still.pixels, clipped=task.still.clipped)
    return methods.photograph(treatment, frame, trajectory, observe)


def _encoded(task: Task, result: FrameResult) -> tuple[bytes, tuple[str, ...]]:
    """The picture's file, and what its format could not keep."""
    kind = Format.of_output(task.request.output)
    if not result.verdict.deblurred:
        return still.unchanged(task.still, kind)
    if not np.isfinite(result.latent).all():
        raise ArithmeticError("the restored picture holds numbers that are not finite")
    return still.encode(task.still, result.latent.astype(np.float32), kind)


def _made(task: Task, data: bytes, frame: FrameRecord, notes: tuple[str, ...], folder: Path, mark: Mark | None = None) -> Finished:
    verdict = Verdict(frame.verdict)
    restored = verdict.deblurred
    outcome = Outcome(notes=notes, restored=int(restored), left=int(not restored), seconds=frame.seconds, verdict=verdict)
    picture = made_within(folder, task.request.output, data)
    settings, written = output.settings_record(task, task.still.transfer.value), stated(outcome, [picture], mark)
    record = sidecar.Sidecar(input=task.request.named, settings=settings, written=written, frames=[frame]).encode()
    return Finished(outcome=outcome, made=(picture, made_within(folder, task.request.record, record)))
