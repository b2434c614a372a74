"""The motion of a clip, found and written as a sidecar by which it can be restored later, or elsewhere; nothing is restored here."""

import time
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from rsvideo.config import sidecar
from rsvideo.config.files import made_within, sha256
from rsvideo.config.placing import aside, place
from rsvideo.config.sidecar import FrameRecord
from rsvideo.frame import Verdict
from rsvideo.pipeline import clip_frames, given_movement, methods, output, overlaid
from rsvideo.pipeline.chunk import chunks, in_view, movement, own
from rsvideo.pipeline.pieces import Chunk
from rsvideo.pipeline.prepare import Task
from rsvideo.progress import Observer, Progress
from rsvideo.restoration import multi_frame
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.overlay import Overlay
from rsvideo.video.stream import Picture

ALONE = "restored by itself, which then shows its verdict: no point of it could be followed"


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What will become of a clip's frames."""

    restored: int
    straightened: int
    left: int
    alone: int  # judged by their restoration, as no point of them could be followed

    @property
    def summary(self) -> str:
        """In words."""
        straight = f"{self.straightened} only to be straightened, " if self.straightened else ""
        alone = f", {self.alone} restored by themselves" if self.alone else ""
        return f"{self.restored} frames to be restored, {straight}{self.left} left as they are{alone}"


def carry_out(task: Task, observe: Observer) -> Outcome:
    """Write the sidecar frame by frame: memory does not grow with the clip's length."""
    stream, path, verdicts = task.stream, task.request.output, Counter[str]()

    def counted() -> Iterator[FrameRecord]:
        for frame in _frames(task, observe):
            verdicts[frame.verdict] += 1
            yield frame

    digest = sha256(*(stream.files or (stream.path,)))
    settings = output.settings_record(task, stream.colour.transfer.value, input_sha256=digest)
    with aside(path.parent) as folder:
        place([made_within(folder, path, sidecar.encoded(task.request.named, settings, counted()))])
    straightened = sum(verdicts[verdict] for verdict in Verdict if verdict.straightened)
    restored, alone = verdicts[Verdict.RESTORED], verdicts[ALONE]
    return Outcome(restored=restored, straightened=straightened, alone=alone, left=verdicts.total() - restored - straightened - alone)


def _frames(task: Task, observe: Observer) -> Iterator[FrameRecord]:
    done = 0
    observe(Progress(stage="looking for cuts", fraction=0.0))
    for chunk in chunks(task):

        def tell(at: Progress, done=done) -> None:
            observe(Progress(stage=f"frame {at.frame}: {at.stage}", fraction=done / task.frames))

        pictures = list(clip_frames.pictures(task, *in_view(chunk, task.last)))
        yield from _records(task, chunk, pictures, tell)
        done += chunk.frames


def _records(task: Task, chunk: Chunk, pictures: Sequence[Picture], observe: Observer) -> Iterator[FrameRecord]:
    """What was found of a chunk's own frames, and what will become of them."""
    started, treatment, meaning = time.monotonic(), task.treatment, task.stream.colour
    overlay = overlaid.found(treatment, pictures, meaning)
    moving = movement(treatment, pictures, meaning, overlay, None, observe)
    mine, moving = own(chunk, pictures, moving)
    verdicts = list(_verdicts(task, mine, moving, overlay))
    seconds = (time.monotonic() - started) / max(len(mine), 1)
    cameras = moving.cameras(treatment.camera)
    for k, (picture, verdict, camera) in enumerate(zip(mine, verdicts, cameras, strict=True)):
        frame = clip_frames.frame(meaning, picture)
        result = methods.untouched(treatment, frame, verdict or Verdict.UNTOUCHED, moving.within[k], camera=camera, seconds=seconds)
        line = output.frame_record(result, moving.steps[k] if moving.tied[k] else None)
        found = given_movement.record(moving.within[k], moving.beside[k])
        yield line.model_copy(update={"found": found, "verdict": verdict or ALONE})


def _verdicts(task: Task, pictures: Sequence[Picture], moving: Movement, overlay: Overlay | None) -> Iterator[Verdict | None]:
    camera, settings, meaning = task.treatment.camera, task.settings, task.stream.colour
    frames = overlaid.cleared((clip_frames.frame(meaning, picture) for picture in pictures), overlay)
    for picture, verdict in zip(pictures, multi_frame.verdicts(frames, moving, camera, settings), strict=True):
        yield Verdict.DAMAGED if picture.damaged else verdict
