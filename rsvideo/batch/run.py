"""The work itself: chunks of all clips in one queue, each kept as soon as it is done."""

import contextlib
import secrets
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from rsvideo.batch.ledger import Ledger
from rsvideo.batch.plan import Planned, Unreadable
from rsvideo.batch.workers import Crew, Cut, Failed, Finish, Order, Restore
from rsvideo.pipeline import fingerprint
from rsvideo.pipeline.pieces import Chunk, Outcome
from rsvideo.progress import Progress

Kind = Literal["resumed", "stage", "frame", "chunk", "retry", "finished", "failed"]
_TRIES = 2  # of an order whose worker dies


@dataclass(frozen=True, kw_only=True)
class Result:
    """What became of one clip."""

    source: str
    output: str
    restored: int = 0
    left: int = 0
    failed: int = 0
    seconds: float = 0.0
    notes: tuple[str, ...] = ()
    fault: str | None = None  # why there is no output
    unreadable: bool = False  # the fault is the source's


@dataclass(frozen=True, kw_only=True)
class Event:
    """Something happened in a run; machines follow a run by its events. `done` and `frames` count frames of the whole batch."""

    event: Kind
    output: str
    words: str = ""  # the stage; what was wrong
    frame: int | None = None
    fraction: float | None = None  # of the clip
    done: float = 0.0
    frames: int = 0
    seconds_left: float | None = None


@dataclass(kw_only=True, eq=False)
class _Clip:
    plan: Planned
    chunks: tuple[Chunk, ...] = ()
    records: dict[int, str] = field(default_factory=dict)
    in_progress: dict[int, float] = field(default_factory=dict)  # frames done of chunks that are not
    result: Result | None = None

    @property
    def name(self) -> str:
        return self.plan.request.output.name

    @property
    def done(self) -> float:
        """Frames, for the bar."""
        if self.result is not None:
            return self.plan.frames
        kept = sum(chunk.frames for chunk in self.chunks if chunk.index in self.records)
        return min(self.plan.frames, kept + sum(self.in_progress.values()))


def carry_out(
    clips: Sequence[Planned | Unreadable],
    ledger: Ledger,
    crew: Crew,
    observe: Callable[[Event], None],
    *,
    clock: Callable[[], float] = time.monotonic,
) -> list[Result]:
    """Restore all clips; one that cannot be restored does not hold up the others. Raises OSError if the disk is full."""
    planned = [_Clip(plan=clip) for clip in clips if isinstance(clip, Planned)]
    results = iter(_Run(planned, ledger, crew, observe, clock).results())
    return [next(results) if isinstance(clip, Planned) else Result(**vars(clip), unreadable=True) for clip in clips]


class _Run:
    def __init__(
        self, clips: list[_Clip], ledger: Ledger, crew: Crew, observe: Callable[[Event], None], clock: Callable[[], float]
    ) -> None:
        self.clips, self.ledger, self.crew, self.observe, self.clock = clips, ledger, crew, observe, clock
        self.by_output = {clip.plan.request.output: clip for clip in clips}
        self.numbers = {clip.plan.request.output: number for number, clip in enumerate(clips)}
        self.queue: list[Order] = []
        self.tries: dict[tuple[str, str], int] = {}
        self.started, self.already = clock(), 0.0  # frames that were done before this run
        self.made_in = f"run-{secrets.token_hex(8)}"  # a worker that outlives an earlier run still writes into that run's own folder

    def results(self) -> list[Result]:
        for clip in self.clips:
            self.take_up(clip)
        self.started, self.already = self.clock(), sum((clip.done for clip in self.clips), 0.0)
        while self.queue or self.crew.busy:
            while self.queue and self.crew.free:
                order = min(self.queue, key=self.rank)
                self.queue.remove(order)
                self.crew.give(order)
                if order.request.is_clip and (stage := {Cut: "looking for cuts", Finish: "encoding"}.get(type(order))):
                    self.tell("stage", self.by_output[order.request.output], stage)
            for order, answer in self.crew.answers():
                self.take(self.by_output[order.request.output], order, answer)
        return [clip.result for clip in self.clips if clip.result is not None]

    def rank(self, order: Order) -> tuple[int, int, int]:
        """What is done first: what frees the disk, then clip by clip, chunk by chunk."""
        return not isinstance(order, Finish), self.numbers[order.request.output], order.chunk.index if isinstance(order, Restore) else -1

    def take_up(self, clip: _Clip) -> None:
        """Go on where an earlier run ended, as far as what it left can be trusted."""
        entry = self.ledger.entry(clip.name)
        if entry is not None and (entry.settings, entry.source) != (clip.plan.settings, clip.plan.source):
            other = "its source has" if entry.source != clip.plan.source else "its settings have"
            self.tell("resumed", clip, f"{other} changed; it is done anew")
            entry = None
        if entry is None:
            self.ledger.begin(clip.name, clip.plan.settings, clip.plan.source)
        elif entry.result is not None:
            if entry.result["stamp"] == _stamp(clip.plan.request.output) and clip.plan.request.record.is_file():
                clip.result = Result(**{**entry.result["result"], "notes": tuple(entry.result["result"]["notes"])})
                self.tell("resumed", clip, "is done already")
                return
            self.tell("resumed", clip, "its result is missing or was changed; it is done anew")
            self.ledger.begin(clip.name, clip.plan.settings, clip.plan.source)
        elif entry.chunks is not None:
            self.lay_out(clip, entry.chunks)
            self.tell("resumed", clip, f"{len(clip.records)} of {len(clip.chunks)} chunks are done already")
            return
        self.queue.append(Cut(request=clip.plan.request))

    def lay_out(self, clip: _Clip, chunks: tuple[Chunk, ...]) -> None:
        records = self.ledger.records(clip.name)
        clip.chunks = chunks
        clip.records = {chunk.index: records[chunk.index] for chunk in chunks if chunk.index in records}
        folder = self.ledger.place(clip.name) / self.made_in
        self.queue.extend(
            Restore(request=clip.plan.request, chunk=chunk, folder=folder) for chunk in chunks if chunk.index not in clip.records
        )
        self.finish_if_complete(clip)

    def finish_if_complete(self, clip: _Clip) -> None:
        if len(clip.records) < len(clip.chunks):
            return
        request = clip.plan.request
        if not request.overwrite and request.output.exists():
            self.fail(clip, Failed(words=f"{request.output} has appeared meanwhile; give --overwrite to replace it"))
            return
        if _source(request.source) != clip.plan.source:
            self.fail(clip, Failed(words=f"{request.source} changed while it was read", unreadable=True))
            return
        self.ledger.publishing(clip.name)
        records = tuple(clip.records[chunk.index] for chunk in clip.chunks)
        self.queue.append(Finish(request=clip.plan.request, records=records, folder=self.ledger.place(clip.name)))

    def take(self, clip: _Clip, order: Order, answer: object) -> None:
        match order, answer:
            case _, Failed():
                self.retry_or_fail(clip, order, answer)
            case Restore(), Progress():
                clip.in_progress[order.chunk.index] = order.chunk.done(answer)
                self.tell("frame", clip, answer.stage, frame=answer.frame)
            case Cut(), tuple():
                if clip.result is None:
                    self.ledger.cut(clip.name, answer)
                    self.lay_out(clip, answer)
            case Restore(), str():
                self.ledger.keep(clip.name, order.chunk.index, answer, order.folder)
                clip.in_progress.pop(order.chunk.index, None)
                clip.records[order.chunk.index] = answer
                self.tell("chunk", clip)
                if clip.result is None:
                    self.finish_if_complete(clip)
            case Finish(), Outcome():
                clip.result = Result(
                    source=str(clip.plan.request.source),
                    output=str(clip.plan.request.output),
                    restored=answer.restored,
                    left=answer.left,
                    failed=answer.failed,
                    seconds=answer.seconds,
                    notes=tuple(answer.notes),
                )
                self.ledger.done(clip.name, {"result": asdict(clip.result), "stamp": _stamp(clip.plan.request.output)})
                self.tell("finished", clip)

    def retry_or_fail(self, clip: _Clip, order: Order, failed: Failed) -> None:
        if failed.disk is not None:
            raise OSError(*failed.disk)
        what = (clip.name, f"chunk {order.chunk.index}" if isinstance(order, Restore) else type(order).__name__)
        self.tries[what] = self.tries.get(what, 0) + 1
        if failed.again and self.tries[what] < _TRIES and clip.result is None:
            self.tell("retry", clip, f"{failed.words}; its work is tried once more")
            self.queue.append(order)
        else:
            self.fail(clip, failed)

    def fail(self, clip: _Clip, failed: Failed) -> None:
        if clip.result is not None:
            return
        self.queue = [order for order in self.queue if order.request.output != clip.plan.request.output]
        source, output = str(clip.plan.request.source), str(clip.plan.request.output)
        clip.result = Result(source=source, output=output, fault=failed.words, unreadable=failed.unreadable)
        self.tell("failed", clip, failed.words)

    def tell(self, event: Kind, clip: _Clip, words: str = "", *, frame: int | None = None) -> None:
        done, frames = sum(each.done for each in self.clips), sum(each.plan.frames for each in self.clips)
        left = None
        if event != "resumed" and done > self.already:
            left = (frames - done) * (self.clock() - self.started) / (done - self.already)
        fraction = clip.done / max(1, clip.plan.frames)
        output = str(clip.plan.request.output)
        self.observe(
            Event(event=event, output=output, words=words, frame=frame, fraction=fraction, done=done, frames=frames, seconds_left=left)
        )


def _source(path: Path) -> str | None:
    with contextlib.suppress(OSError):
        return fingerprint.of_source(path)
    return None


def _stamp(output: Path) -> list[int] | None:
    """Tells whether the output is still the one that was written."""
    with contextlib.suppress(OSError):
        stat = output.stat()
        return [stat.st_size, stat.st_mtime_ns]
    return None
