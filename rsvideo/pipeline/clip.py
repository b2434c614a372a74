"""One clip, from file to file: its chunks restored, and all of them encoded as the original was."""

import json
import math
import tempfile
from collections import Counter
from collections.abc import Iterable, Iterator
from dataclasses import asdict, dataclass, field, replace
from itertools import chain
from pathlib import Path

import numpy as np

from rsvideo.config import sidecar
from rsvideo.config.files import UnreadableError, made_within, sha256
from rsvideo.config.method import Method
from rsvideo.config.placing import aside, place
from rsvideo.config.sidecar import FrameRecord, Mark
from rsvideo.frame import Verdict
from rsvideo.pipeline import clip_frames, motion_log, output, stabilisation
from rsvideo.pipeline.chunk import chunks, work
from rsvideo.pipeline.pieces import ChunkRecord, Finished, Outcome, check_cover, frame_records, stated
from rsvideo.pipeline.prepare import Task
from rsvideo.progress import Observer, Progress
from rsvideo.shooting import gcsv
from rsvideo.shooting.timing import ms
from rsvideo.video import colour, planes
from rsvideo.video.stream import Picture, Stream
from rsvideo.video.writer import Writer

_SAME = 1e-3  # part by which exposures differ that are the same in the record


def finish(task: Task, records: list[ChunkRecord], folder: Path, mark: Mark | None = None) -> Finished:
    """Encode the restored frames as the original was, in a folder of its own within `folder`; then the gyroscope's log and the sidecar."""
    assert task.encoding is not None
    stream, camera = task.stream, task.treatment.camera
    kept, steps, tally = _gist(frame_records(records, folder))
    left_out = [index for record in records for index in record.left_out]
    check_cover([*kept, *left_out], task.first, task.last, task.request.source)
    pictures = chain.from_iterable(
        planes.read(folder / record.pictures, task.stream, (frame.index for frame in frame_records([record], folder))) for record in records
    )
    if not kept:
        raise UnreadableError(f"{task.request.source} holds no picture that could be decoded as it was meant")
    enlargement = 1.0
    if task.request.motion.path == "smooth":
        turns, enlargement = stabilisation.corrections(steps, float(stream.rate), camera.intrinsics)
        pictures = (_turned(task, p, turn, enlargement) for p, turn in zip(pictures, turns, strict=True))
    if task.request.encoding.side_by_side:
        stream, pictures = side_by_side(task, pictures)
    last = task.last
    if len(kept) < task.frames:  # damaged ones were left out
        stream = replace(stream, times=np.concatenate([stream.times[: task.first], stream.times[kept], stream.times[last:]]))
        last = task.first + len(kept)
    within = Path(tempfile.mkdtemp(prefix="run-", dir=folder))
    with Writer(task.request.output, stream, task.encoding, first=task.first, last=last, within=within) as writer:
        for picture in pictures:
            writer.write(picture)
    made = [writer.made]
    parts = motion_log.parts(frame_records(records, folder), float(stream.rate), camera)
    if task.request.deblur.method is not Method.NONE and (first := next(parts, None)):
        log = gcsv.encoded(chain([first], parts), timing=task.timing, video=task.request.output.name, model="rsvideo")
        made.append(made_within(within, task.request.log, log))
    notes = writer.notes
    if task.request.motion.path == "smooth":
        notes += (f"smoothed: the picture is enlarged by {100 * (enlargement - 1):.1f} % to hide its moving borders",)
    ended = outcome(task, tally, notes)
    record = sidecar.encoded(task.request.named, _settings(task), frame_records(records, folder), stated(ended, made, mark))
    return Finished(outcome=ended, made=(*made, made_within(within, task.request.record, record)))


@dataclass
class Tally:
    """What became of the frames so far."""

    verdicts: Counter[str] = field(default_factory=Counter)
    exposures: list[float] = field(default_factory=list)  # s, each frame's
    overlaid: list[float] = field(default_factory=list)  # of each frame with graphics over it, the share that these cover
    seconds: float = 0.0  # of work

    def add(self, frame: FrameRecord) -> None:
        """One frame more."""
        self.verdicts[frame.verdict] += 1
        self.exposures.append(frame.timing.exposure_s)
        self.overlaid += [frame.overlaid] if frame.overlaid else []
        self.seconds += frame.seconds


def outcome(task: Task, tally: Tally, notes: tuple[str, ...]) -> Outcome:
    """What became of a clip."""
    verdicts = tally.verdicts
    restored = sum(verdicts[verdict] for verdict in Verdict if verdict.deblurred)
    return Outcome(
        notes=notes + _of_exposures(task, tally) + _of_graphics(tally),
        restored=restored,
        left=verdicts.total() - restored - verdicts[Verdict.DAMAGED],
        straightened=sum(verdicts[verdict] for verdict in Verdict if verdict.straightened),
        failed=verdicts[Verdict.DAMAGED],
        seconds=tally.seconds,
    )


def _of_exposures(task: Task, tally: Tally) -> tuple[str, ...]:
    """What to know of exposures that blur does not bear out."""
    stated, notes = task.timing.exposure, tuple[str, ...]()
    others = [] if task.shutter.exposure_open else [each for each in tally.exposures if not math.isclose(each, stated, rel_tol=_SAME)]
    if others:
        taken = f"{ms(float(np.median(others)))} is taken for {len(others)} frames"
        notes += (f"exposure: {taken}, which are in better focus with it than with {ms(stated)}; --force takes what is given",)
    if disagreeing := tally.verdicts[Verdict.DISAGREES]:
        left = f"the blur of {disagreeing} frames does not show {ms(stated)}, they were straightened only"
        notes += (f"exposure: {left}; give --exposure as it was",)
    return notes


def _of_graphics(tally: Tally) -> tuple[str, ...]:
    """What is left as it was of frames with graphics over them."""
    if not tally.overlaid:
        return ()
    frames, most = f"{len(tally.overlaid)} frames", f"{100 * max(tally.overlaid):.2g} %"
    return (
        f"captions, bars or whatever else stays in place covers up to {most} of {frames}; it is left as it was, and so is what it hides",
    )


def side_by_side(task: Task, pictures: Iterable[Picture]) -> tuple[Stream, Iterator[Picture]]:
    """The source's pictures on the left of these, and the stream that they are."""
    even = task.stream.cols - task.stream.cols % 2  # so that chroma samples stay with their pixels
    pairs = zip(clip_frames.pictures(task), pictures, strict=True)
    return replace(task.stream, cols=even + task.stream.cols), (_beside(before, after, even) for before, after in pairs)


def _gist(frames: Iterable[FrameRecord]) -> tuple[list[int], list[list[float] | None], Tally]:
    """Of all frames: their indices, the steps from each to the next, and what became of them."""
    kept, steps, tally = [], [], Tally()
    for frame in frames:
        kept.append(frame.index)
        steps.append(frame.to_next)
        tally.add(frame)
    return kept, steps, tally


def carry_out(task: Task, observe: Observer) -> Outcome:
    """The whole clip in this process, chunk after chunk."""
    with aside(task.request.output.parent) as folder:
        done, records = 0, []
        observe(Progress(stage="looking for cuts", fraction=0.0))
        for chunk in chunks(task):

            def tell(at: Progress, chunk=chunk, done=done) -> None:
                fraction = (done + chunk.done(at)) / task.frames
                observe(Progress(stage=f"frame {at.frame}: {at.stage}", fraction=fraction))

            records.append(work(task, chunk, folder, tell))
            done += chunk.frames
        observe(Progress(stage="encoding", fraction=1.0))
        finished = finish(task, records, folder)
        place(finished.made)
        return finished.outcome


def _turned(task: Task, picture: Picture, turn: np.ndarray, enlargement: float) -> Picture:
    pixels = colour.light(picture, task.stream.colour)[0]
    return colour.codes(stabilisation.shown(pixels, turn, enlargement, task.camera.intrinsics), picture, task.stream.colour)


def _beside(before: Picture, after: Picture, cols: int) -> Picture:
    """`cols` columns of the source, then the result."""
    width = after.planes[0].shape[1]
    left = [plane[:, : cols // round(width / plane.shape[1])] for plane in before.planes]
    return replace(after, planes=tuple(np.hstack(pair) for pair in zip(left, after.planes, strict=True)))


def _settings(task: Task) -> sidecar.Settings:
    assert task.encoding is not None
    encoding = json.loads(json.dumps(asdict(task.encoding)))
    digest = sha256(*(task.stream.files or (task.stream.path,)))
    return output.settings_record(task, task.stream.colour.transfer.value, input_sha256=digest, encoding=encoding)
