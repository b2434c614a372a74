"""A clip cut into chunks, each restored by itself.

A chunk is restored from its own frames, `warm_up` frames before and two behind them, so that the result does not depend on
who restores which chunk.
"""

import hashlib
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import groupby, pairwise
from pathlib import Path

import numpy as np

from rsvideo.config.files import write_whole
from rsvideo.config.method import Method
from rsvideo.config.sidecar import FrameRecord
from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.pipeline import clip_frames, given_movement, methods, output, overlaid
from rsvideo.pipeline.methods import Treatment
from rsvideo.pipeline.pieces import Chunk, ChunkRecord
from rsvideo.pipeline.prepare import Task
from rsvideo.progress import Observer, Progress
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.overlay import Overlay
from rsvideo.video import colour, cuts, decode, planes, vidstab
from rsvideo.video.stream import Colour, Picture

LONGEST = 32  # frames of a chunk, and fewer of large pictures:
MOST_BYTES = 256 << 20  # of a chunk's pictures as decoded
SHORTEST = 8  # frames of a chunk at least, however large its pictures: fewer tell too little of the motion; origin: by trial
WARM_UP, AHEAD = 4, 2  # frames before and behind a chunk that its motion is found with
_NO_LIGHT = np.zeros((0, 0, 3), np.float32)  # of a picture that is passed on


def chunks(task: Task) -> list[Chunk]:
    """The clip cut at its changes of scene, and long scenes into equal parts; depends on the clip alone."""
    scenes = () if task.request.deblur.method is Method.NONE else cuts.cuts(clip_frames.pictures(task), task.stream.colour)
    return planned(task.first, task.last, scenes, task.picture_bytes)


def planned(first: int, last: int, scenes: Iterable[int], picture_bytes: int) -> list[Chunk]:
    """Frames first to last - 1, cut where another of the `scenes` begins, and long scenes into equal parts."""
    out: list[Chunk] = []
    for begin, end in pairwise([first, *scenes, last]):
        edges = np.linspace(begin, end, -(-(end - begin) // longest(picture_bytes)) + 1).round().astype(int).tolist()
        out += [Chunk(index=len(out) + n, first=a, last=b - 1, warm_up=min(WARM_UP, a - begin)) for n, (a, b) in enumerate(pairwise(edges))]
    return out


def longest(picture_bytes: int) -> int:
    """Frames of a chunk at most."""
    return max(SHORTEST, min(LONGEST, MOST_BYTES // picture_bytes))


def in_view(chunk: Chunk, last: int) -> tuple[int, int]:
    """Frames [begin, end) that a chunk's motion is found with, of a clip that ends before frame `last`."""
    return chunk.first - chunk.warm_up, min(chunk.last + 1 + AHEAD, last)


def passed_on(task: Task) -> bool:
    """Whether pictures are written as they come: nothing needs their light, or their neighbours."""
    return task.request.deblur.method is Method.NONE and task.request.motion.trajectory is None


def work(task: Task, chunk: Chunk, folder: Path, observe: Observer) -> ChunkRecord:
    """Restore a chunk into a file of `folder`; `observe` gets how much of each frame is done."""
    record = ChunkRecord(pictures=f"{chunk.index:06}.zip", frames=f"{chunk.index:06}.jsonl", sha256={})
    frames: list[FrameRecord] = []

    def pictures() -> Iterator[Picture]:
        for picture, frame in shown(task, chunk, folder, observe):
            frames.append(frame)
            yield picture

    record.sha256[record.pictures] = planes.write(folder / record.pictures, pictures())
    lines = b"".join(frame.encode() + b"\n" for frame in frames)
    write_whole({folder / record.frames: lines})
    record.sha256[record.frames] = hashlib.sha256(lines).hexdigest()
    missing = {*range(chunk.first, chunk.last + 1)} - {frame.index for frame in frames}
    return record.model_copy(update={"left_out": tuple(sorted(missing))})


def shown(task: Task, chunk: Chunk, folder: Path, observe: Observer) -> Iterator[tuple[Picture, FrameRecord]]:
    """The chunk's pictures as they are shown, and what became of each; `folder` is of our own."""
    return _as_they_came(task, chunk, observe) if passed_on(task) else _worked_on(task, chunk, folder, observe)


def _as_they_came(task: Task, chunk: Chunk, observe: Observer) -> Iterator[tuple[Picture, FrameRecord]]:
    """The chunk's pictures, one at a time, and that nothing was done with them."""
    for picture in clip_frames.pictures(task, *in_view(chunk, task.last)):
        if not chunk.first <= picture.index <= chunk.last:  # which damaged ones may need all the same
            continue
        frame = Frame(pixels=_NO_LIGHT, clipped=_NO_LIGHT > 0, time=picture.time, index=picture.index)
        result = methods.untouched(task.treatment, frame, Verdict.DAMAGED if picture.damaged else Verdict.UNTOUCHED)
        yield picture, output.frame_record(result)
        observe(Progress(stage="passed on", fraction=1.0, frame=picture.index))


def _worked_on(task: Task, chunk: Chunk, folder: Path, observe: Observer) -> Iterator[tuple[Picture, FrameRecord]]:
    """The chunk's pictures as they are shown, and what became of each."""
    view = clip_frames.pictures(task, *in_view(chunk, task.last))
    if task.request.deblur.method.steadied:
        view = iter(_steadied(task, list(view), folder))
    for picture, result, to_next in treated(task.treatment, chunk, view, task.stream.colour, task.request.motion.trajectory, observe):
        yield picture, output.frame_record(result, to_next)


def treated(
    treatment: Treatment, chunk: Chunk, pictures: Iterable[Picture], meaning: Colour, given: Path | None, observe: Observer
) -> Iterator[tuple[Picture, FrameResult, np.ndarray | None]]:
    """The chunk's own among the pictures in view as they are shown, and what `restored` answers of them."""
    held = list(pictures)
    overlay = overlaid.found(treatment, held, meaning)
    moving = movement(treatment, held, meaning, overlay, given, observe)
    answers = restored(treatment, chunk, held, meaning, overlay, moving, observe)
    del held
    for picture, result, to_next in answers:
        yield colour.codes(result.latent, picture, meaning) if result.verdict.changed else picture, result, to_next


def restored(
    treatment: Treatment,
    chunk: Chunk,
    pictures: Sequence[Picture],
    meaning: Colour,
    overlay: Overlay | None,
    moving: Movement,
    observe: Observer,
) -> Iterator[tuple[Picture, FrameResult, np.ndarray | None]]:
    """The chunk's own among the pictures in view, what becomes of each, and the step from its pose to the next one's.

    None is kept longer than it is needed: those of a chunk take as much memory as a frame's restoration.
    """
    wanted, moving = own(chunk, pictures, moving)
    del pictures
    for k, result in enumerate(_results(treatment, wanted, meaning, overlay, moving, observe)):
        picture, wanted[k] = wanted[k], replace(wanted[k], planes=())
        yield picture, result, moving.steps[k] if moving.tied[k] else None


def own(chunk: Chunk, pictures: Sequence[Picture], moving: Movement) -> tuple[list[Picture], Movement]:
    """The chunk's own among the pictures in view, with their part of the motion."""
    mine = [k for k, p in enumerate(pictures) if chunk.first <= p.index <= chunk.last]
    return [pictures[k] for k in mine], moving.part(mine[0], mine[-1] + 1) if mine else moving.part(0, 0)


def _steadied(task: Task, pictures: list[Picture], folder: Path) -> list[Picture]:
    """vid.stab's frames in place of the clip's; whoever comes first makes them, for all chunks."""
    whole = folder / "vidstab.mkv"
    if not whole.exists():
        with tempfile.TemporaryDirectory(dir=folder) as name:
            vidstab.stabilised(task.request.source, Path(name) / whole.name, Path(name)).replace(whole)
    stream = decode.probe(whole)
    steady = decode.pictures(stream, pictures[0].index, pictures[-1].index + 1)
    laid = (colour.relaid(picture, stream.colour, replace(task.stream.colour, transfer=stream.colour.transfer)) for picture in steady)
    return [replace(before, planes=after.planes) for before, after in zip(pictures, laid, strict=True)]


def _results(
    treatment: Treatment, pictures: list[Picture], meaning: Colour, overlay: Overlay | None, moving: Movement, observe: Observer
) -> Iterator[FrameResult]:
    """What becomes of each picture, in order."""
    for damaged, some in groupby(range(len(pictures)), key=lambda k: pictures[k].damaged):
        indices = list(some)
        frames = (clip_frames.frame(meaning, pictures[k]) for k in indices)
        if damaged or treatment.method is Method.NONE:
            verdict = Verdict.DAMAGED if damaged else Verdict.UNTOUCHED
            for frame in frames:
                yield methods.untouched(treatment, frame, verdict)
                observe(Progress(stage="passed on", fraction=1.0, frame=frame.index))
        else:
            part = moving.part(indices[0], indices[-1] + 1)
            yield from overlaid.treated(frames, overlay, lambda scene, part=part: methods.run(treatment, scene, part, observe))


def movement(
    treatment: Treatment, pictures: Sequence[Picture], meaning: Colour, overlay: Overlay | None, given: Path | None, observe: Observer
) -> Movement:
    """The motion within each picture, and from each to the next: as a file gives it, or found."""
    if given is not None:
        return given_movement.of_pictures(given, treatment.camera, [(p.index, p.time) for p in pictures])
    begins = np.array([p.time for p in pictures])
    frames = (clip_frames.frame(meaning, picture) for picture in pictures)
    return methods.movement(treatment, overlaid.cleared(frames, overlay), begins, observe)
