"""The work itself: chunks of all clips in one queue, each kept as soon as it is done."""

import contextlib
import secrets
import time
from bisect import insort
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Literal

from rsvideo.batch import control, recognition
from rsvideo.batch.ledger import Entry, Ledger
from rsvideo.batch.plan import Planned, Unreadable
from rsvideo.batch.workers import Cut, Failed, Finish, Hands, Order, Restore, failed
from rsvideo.config.placing import uninterrupted
from rsvideo.pipeline import fingerprint
from rsvideo.pipeline.pieces import Chunk, Finished
from rsvideo.progress import Progress

Kind = Literal["resumed", "stage", "frame", "chunk", "retry", "paused", "finished", "failed"]


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
    chunks: int = 0  # of the clip; 0 until it is cut
    chunks_done: int = 0
    finished: bool = False  # whether the clip's result is complete
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
    crew: Hands,
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
        self, clips: list[_Clip], ledger: Ledger, crew: Hands, observe: Callable[[Event], None], clock: Callable[[], float]
    ) -> None:
        self.clips, self.ledger, self.crew, self.observe, self.clock = clips, ledger, crew, observe, clock
        self.by_output = {clip.plan.request.output: clip for clip in clips}
        self.numbers = {clip.plan.request.output: number for number, clip in enumerate(clips)}
        self.queues: dict[type[Order], list[Order]] = {Cut: [], Restore: [], Finish: []}  # each in the order of its ranks
        self.tries: dict[tuple[str, str], int] = {}
        self.started, self.already = clock(), 0.0  # frames that were done before this run
        self.glanced, self.paused = -control.EVERY, False  # when the wishes of whoever watches were read, and whether the run pauses
        self.made_in = f"run-{secrets.token_hex(8)}"  # a worker that outlives an earlier run still writes into that run's own folder

    def results(self) -> list[Result]:
        for clip in self.clips:
            self.take_up(clip)
        self.started, self.already = self.clock(), sum((clip.done for clip in self.clips), 0.0)
        while any(self.queues.values()) or self.crew.busy:
            if not self.pauses():
                self.hand_out()
            elif not self.crew.busy:
                time.sleep(control.EVERY)
                continue
            for order, answer in self.crew.answers():
                self.take(self.by_output[order.request.output], order, answer)
        return [clip.result for clip in self.clips if clip.result is not None]

    def pauses(self) -> bool:
        """Whether no order is to be given for now; raises CancelledError where none is to be given any more."""
        now = self.clock()
        if now - self.glanced >= control.EVERY:
            wish, since = control.wish(self.ledger.folder), now - self.glanced
            if wish == "cancel":
                raise control.CancelledError("cancelled")
            if self.paused:
                self.started += since  # which was no work
            if (wish == "pause") != self.paused:
                self.paused = wish == "pause"
                clip = next((clip for clip in self.clips if clip.result is None), self.clips[0])
                self.tell(*(("paused", clip, "paused") if self.paused else ("stage", clip, "goes on")))
            self.glanced = now
        return self.paused

    def hand_out(self) -> None:
        """Give orders as long as somebody is free for them."""
        while first := [queue for kind, queue in self.queues.items() if queue and self.crew.free(kind)]:
            order = min(first, key=lambda queue: self.rank(queue[0])).pop(0)
            self.crew.give(order)
            if order.request.is_clip and (stage := {Cut: "looking for cuts", Finish: "encoding"}.get(type(order))):
                self.tell("stage", self.by_output[order.request.output], stage)

    def rank(self, order: Order) -> tuple[int, int, int]:
        """What is done first: what frees the disk, then clip by clip, chunk by chunk."""
        return not isinstance(order, Finish), self.numbers[order.request.output], order.chunk.index if isinstance(order, Restore) else -1

    def add(self, order: Order) -> None:
        insort(self.queues[type(order)], order, key=self.rank)

    def take_up(self, clip: _Clip) -> None:
        """Go on where an earlier run ended, as far as what it left can be trusted."""
        request, mark = clip.plan.request, clip.plan.mark
        entry, fault = recognition.owned(clip.plan.item, mark.job, self.ledger), None
        if self.take_over(clip, entry):
            return
        if entry is None or entry.settings is None:
            pass
        elif (entry.settings, entry.source) != (mark.settings, mark.source):
            fault = f"its {'source has' if entry.source != mark.source else 'settings have'} changed"
        elif entry.result is not None:
            fault = "its result is missing or was changed"
        elif entry.chunks is not None and _covers(entry.chunks, clip.plan):
            self.lay_out(clip, entry.chunks)
            self.tell("resumed", clip, f"{len(clip.records)} of {len(clip.chunks)} chunks are done already")
            return
        elif entry.chunks is not None:
            fault = "the chunks of its ledger are not those of the clip"
        if fault is not None:
            self.tell("resumed", clip, f"{fault}; it is done anew")
        ours, stamps = (entry.ours, entry.stamps) if entry else ((), {})
        self.ledger.begin(clip.name, Entry(input=mark.input, settings=mark.settings, source=mark.source, ours=ours, stamps=stamps))
        self.add(Cut(request=request))

    def take_over(self, clip: _Clip, entry: Entry | None) -> bool:
        """Whether a clip is done already, by its ledger or, where that was lost, by its sidecar."""
        request, mark, results = clip.plan.request, clip.plan.mark, clip.plan.item.results
        names = [path.name for path in request.files]
        if entry is not None and entry.result is not None and (entry.settings, entry.source) == (mark.settings, mark.source):
            held = entry.stamps.get(request.output.name)
            if held is None or held != results.stamp(request.output.name) or results.stamp(request.record.name) is None:
                return False
            clip.result = Result(**{**entry.result, "notes": tuple(entry.result["notes"])})
        elif self.ledger.recovered and not self.ledger.fresh and (written := recognition.finished(clip.plan.item, mark)):
            counts = {"restored": written.restored, "left": written.left, "failed": written.failed, "seconds": written.seconds}
            clip.result = Result(source=clip.plan.source, output=clip.plan.output, notes=written.notes, **counts)
            ours = (*written.sha256.values(), *recognition.digests(results, [request.record.name]))
            self.ledger.begin(clip.name, Entry(input=mark.input, settings=mark.settings, source=mark.source, ours=ours))
            self.ledger.done(clip.name, asdict(clip.result), recognition.stamps(results, names))
        else:
            return False
        self.tell("resumed", clip, "is done already")
        return True

    def lay_out(self, clip: _Clip, chunks: tuple[Chunk, ...]) -> None:
        records, store = self.ledger.records(clip.name), clip.plan.store
        folder = self.ledger.place(clip.name) / self.made_in
        clip.chunks = chunks
        in_store = store.there()
        for chunk in chunks:
            if chunk.index in records:
                clip.records[chunk.index] = records[chunk.index]
            elif in_store and (record := store.record(chunk)) and store.fetch(chunk, record, folder):
                self.keep(clip, chunk, record, folder)
            else:
                self.add(Restore(request=clip.plan.request, chunk=chunk, folder=folder, store=store))
        self.finish_if_complete(clip)

    def keep(self, clip: _Clip, chunk: Chunk, record: str, made_in: Path) -> None:
        self.ledger.keep(clip.name, chunk.index, record, made_in)
        clip.in_progress.pop(chunk.index, None)
        clip.records[chunk.index] = record

    def finish_if_complete(self, clip: _Clip) -> None:
        if len(clip.records) < len(clip.chunks):
            return
        request, mark = clip.plan.request, clip.plan.mark
        if self.is_taken(clip):
            return
        if _source(request.source) != mark.source:
            self.fail(clip, Failed(words=f"{clip.plan.source} changed while it was read", unreadable=True))
            return
        records = tuple(clip.records[chunk.index] for chunk in clip.chunks)
        self.add(Finish(request=request, records=records, folder=self.ledger.place(clip.name), mark=mark))

    def is_taken(self, clip: _Clip) -> bool:
        """Whether something that is not the job's own has appeared under the result's names, which then fails."""
        item = clip.plan.item
        if item.request.overwrite or recognition.may_replace(item, clip.plan.mark.job, self.ledger):
            return False
        if (there := next((item.results.at(path.name) for path in item.request.files if item.results.stamp(path.name)), None)) is None:
            return False
        self.fail(clip, Failed(words=f"{there} has appeared or changed meanwhile; give --overwrite to replace it"))
        return True

    def publish(self, clip: _Clip, order: Finish, finished: Finished) -> None:
        """Give a result its names, with the ledger knowing them before and after, whatever ends the run in between."""
        if self.is_taken(clip):
            return
        self.ledger.intend(clip.name, [made.sha256 for made in finished.made])
        results, outcome = clip.plan.item.results, finished.outcome
        result = Result(
            source=clip.plan.source,
            output=clip.plan.output,
            restored=outcome.restored,
            left=outcome.left,
            failed=outcome.failed,
            seconds=outcome.seconds,
            notes=tuple(outcome.notes),
        )
        with uninterrupted() if results.at_once else contextlib.nullcontext():
            try:
                results.publish(finished.made)
            except OSError as error:
                self.retry_or_fail(clip, order, failed(error))
                return
            self.ledger.done(clip.name, asdict(result), recognition.stamps(results, [path.name for path in clip.plan.request.files]))
            clip.result = result
        clip.plan.store.remove()
        self.tell("finished", clip)

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
                self.keep(clip, order.chunk, answer, order.folder)
                self.tell("chunk", clip)
                if clip.result is None:
                    self.finish_if_complete(clip)
            case Finish(), Finished():
                self.publish(clip, order, answer)

    def retry_or_fail(self, clip: _Clip, order: Order, failed: Failed) -> None:
        if failed.disk is not None:
            raise OSError(*failed.disk)
        what = (clip.name, f"chunk {order.chunk.index}" if isinstance(order, Restore) else type(order).__name__)
        self.tries[what] = self.tries.get(what, 0) + 1
        if failed.again and self.tries[what] < self.crew.tries and clip.result is None:
            self.tell("retry", clip, f"{failed.words}; its work is tried once more")
            self.add(order)
        else:
            self.fail(clip, failed)

    def fail(self, clip: _Clip, failed: Failed) -> None:
        if clip.result is not None:
            return
        for queue in self.queues.values():
            queue[:] = [order for order in queue if order.request.output != clip.plan.request.output]
        clip.result = Result(source=clip.plan.source, output=clip.plan.output, fault=failed.words, unreadable=failed.unreadable)
        self.tell("failed", clip, failed.words)

    def tell(self, event: Kind, clip: _Clip, words: str = "", *, frame: int | None = None) -> None:
        done, frames = sum(each.done for each in self.clips), sum(each.plan.frames for each in self.clips)
        left = None
        if event != "resumed" and done > self.already:
            left = (frames - done) * (self.clock() - self.started) / (done - self.already)
        fraction = clip.done / max(1, clip.plan.frames)
        self.observe(
            Event(
                event=event,
                output=clip.plan.output,
                words=words,
                frame=frame,
                fraction=fraction,
                chunks=len(clip.chunks),
                chunks_done=len(clip.records),
                finished=clip.result is not None and clip.result.fault is None,
                done=done,
                frames=frames,
                seconds_left=left,
            )
        )


def _source(path: Path) -> str | None:
    with contextlib.suppress(OSError):
        return fingerprint.of_source(path)
    return None


def _covers(chunks: Sequence[Chunk], plan: Planned) -> bool:
    """Whether chunks follow each other from the first frame that is restored to the last."""
    ends = [plan.first, *(chunk.last + 1 for chunk in chunks)]
    follow = all((n, end) == (chunk.index, chunk.first) for n, (end, chunk) in enumerate(zip(ends, chunks, strict=False)))
    return follow and ends[-1] == plan.first + plan.frames
