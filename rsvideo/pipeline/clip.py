"""One clip, from file to file: its chunks restored, and all of them encoded as the original was."""

import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, replace
from importlib.metadata import version
from itertools import chain
from pathlib import Path

import numpy as np

from rsvideo.config import sidecar
from rsvideo.config.files import sha256, write_whole
from rsvideo.config.method import Method
from rsvideo.config.sidecar import FrameRecord
from rsvideo.frame import Verdict
from rsvideo.pipeline import motion_log, stabilisation
from rsvideo.pipeline.chunk import ChunkRecord, chunks, told, work
from rsvideo.pipeline.clip_job import ClipTask
from rsvideo.shooting import gcsv
from rsvideo.video import colour, planes
from rsvideo.video.stream import Picture
from rsvideo.video.writer import Writer


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a clip."""

    notes: tuple[str, ...]
    restored: int
    left: int
    failed: int  # frames that could not be decoded as they were meant
    seconds: float

    @property
    def told(self) -> str:
        """In words."""
        return f"{self.restored} frames restored, {self.left} left as they were, {self.failed} failed, {self.seconds:.0f} s"


def finish(task: ClipTask, records: list[ChunkRecord], folder: Path) -> Outcome:
    """Encode the restored frames as the original was; then the sidecar and the gyroscope's log."""
    stream, camera = task.stream, task.camera.intrinsics
    kept, steps, verdicts, seconds = _gist(told(records, folder))
    pictures = chain.from_iterable(
        planes.read(folder / record.pictures, stream, (frame.index for frame in told([record], folder))) for record in records
    )
    enlargement = 1.0
    if task.job.path == "smooth":
        turns, enlargement = stabilisation.corrections(steps, float(stream.rate), camera)
        pictures = (_turned(task, p, turn, enlargement) for p, turn in zip(pictures, turns, strict=True))
    if task.job.side_by_side:
        even = stream.cols - stream.cols % 2  # so that chroma samples stay with their pixels
        pictures = (_beside(before, after, even) for before, after in zip(task.pictures(), pictures, strict=True))
        stream = replace(stream, cols=even + stream.cols)
    last = task.last
    if len(kept) < task.frames:  # damaged ones were left out
        stream = replace(stream, times=np.concatenate([stream.times[: task.first], stream.times[kept], stream.times[last:]]))
        last = task.first + len(kept)
    with Writer(task.job.output, stream, task.encoding, first=task.first, last=last) as writer:
        for picture in pictures:
            writer.write(picture)
    notes = writer.notes
    files = {task.job.record: sidecar.encoded(str(task.job.source), _settings(task), told(records, folder))}
    parts = motion_log.parts(told(records, folder), float(stream.rate), task.timing, camera)
    if task.job.method is not Method.NONE and (first := next(parts, None)):
        files[task.job.log] = gcsv.encoded(chain([first], parts), timing=task.timing, video=task.job.output.name, model="rsvideo")
    write_whole(files)
    if task.job.path == "smooth":
        notes += (f"smoothed: the picture is enlarged by {100 * (enlargement - 1):.1f} % to hide its moving borders",)
    return Outcome(
        notes=notes,
        restored=verdicts[Verdict.RESTORED],
        left=verdicts.total() - verdicts[Verdict.RESTORED] - verdicts[Verdict.DAMAGED],
        failed=verdicts[Verdict.DAMAGED],
        seconds=seconds,
    )


def _gist(frames: Iterable[FrameRecord]) -> tuple[list[int], list[list[float] | None], Counter[str], float]:
    """Of all frames: their indices, the steps from each to the next, how many met which verdict, and the seconds of work."""
    kept, steps, verdicts, seconds = [], [], Counter[str](), 0.0
    for frame in frames:
        kept.append(frame.index)
        steps.append(frame.to_next)
        verdicts[frame.verdict] += 1
        seconds += frame.seconds
    return kept, steps, verdicts, seconds


def carry_out(task: ClipTask, observe: Callable[[str, float], None]) -> Outcome:
    """The whole clip in this process, chunk after chunk; `observe` is told the stage, and how much of the whole is done."""
    with tempfile.TemporaryDirectory(prefix=".rsvideo-", dir=task.job.output.parent) as name:
        folder, done, records = Path(name), 0, []
        observe("looking for cuts", 0.0)
        for chunk in chunks(task):

            def heard(index: int, stage: str, fraction: float, chunk=chunk, done=done) -> None:
                observe(f"frame {index}: {stage}", (done + max(0.0, index - chunk.first + fraction)) / task.frames)

            records.append(work(task, chunk, folder, heard))
            done += chunk.last - chunk.first + 1
        observe("encoding", 1.0)
        return finish(task, records, folder)


def _turned(task: ClipTask, picture: Picture, turn: np.ndarray, enlargement: float) -> Picture:
    pixels = colour.light(picture, task.stream.colour)[0]
    return colour.codes(stabilisation.shown(pixels, turn, enlargement, task.camera.intrinsics), picture, task.stream.colour)


def _beside(before: Picture, after: Picture, cols: int) -> Picture:
    """`cols` columns of the source, then the result."""
    width = after.planes[0].shape[1]
    left = [plane[:, : cols // round(width / plane.shape[1])] for plane in before.planes]
    return replace(after, planes=tuple(np.hstack(pair) for pair in zip(left, after.planes, strict=True)))


def _settings(task: ClipTask) -> sidecar.Settings:
    return sidecar.Settings(
        rsvideo=version("rsvideo"),
        camera=task.camera,
        direction=task.timing.direction,
        transfer=task.stream.colour.transfer.value,
        trajectory_from=None if task.job.trajectory is None else str(task.job.trajectory),
        restoration=json.loads(json.dumps(asdict(task.settings))),
        input_sha256=sha256(*(task.stream.files or (task.stream.path,))),
        encoding=json.loads(json.dumps(asdict(task.encoding))),
    )
