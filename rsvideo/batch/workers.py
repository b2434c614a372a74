"""Worker processes: each takes one order at a time, and one that dies takes nothing with it but that order."""

import contextlib
import errno
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from rsvideo.config.files import UnreadableError
from rsvideo.pipeline import chunk, clip, clip_job, processes
from rsvideo.pipeline.chunk import Chunk, ChunkRecord
from rsvideo.pipeline.clip_job import ClipJob, ClipTask

_EVERY = 0.1  # seconds between two words about one frame
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)  # no other clip would fare better


@dataclass(frozen=True, kw_only=True)
class Cut:
    """Find where a clip is cut into chunks."""

    job: ClipJob


@dataclass(frozen=True, kw_only=True)
class Restore:
    """Restore one chunk into a folder."""

    job: ClipJob
    chunk: Chunk
    folder: Path


@dataclass(frozen=True, kw_only=True)
class Finish:
    """Encode a clip from its chunks, whose records are given as JSON."""

    job: ClipJob
    records: tuple[str, ...]
    folder: Path


Order = Cut | Restore | Finish


@dataclass(frozen=True, kw_only=True)
class Finished:
    """What became of a clip's frames."""

    restored: int
    left: int
    failed: int
    seconds: float
    notes: tuple[str, ...]


@dataclass(frozen=True, kw_only=True)
class Heard:
    """An order's frame is at this stage."""

    frame: int
    stage: str
    fraction: float


@dataclass(frozen=True, kw_only=True)
class Failed:
    """An order came to nothing."""

    words: str
    unreadable: bool = False  # the input is at fault
    disk: tuple[int, str, str] | None = None  # errno, its words, and the file, if the disk is full or may not be written
    again: bool = False  # another try may do


Done = tuple[Chunk, ...] | str | Finished  # of Cut; of Restore, its record as JSON; of Finish


@dataclass(frozen=True, kw_only=True, eq=False)
class _Worker:
    process: BaseProcess
    connection: Connection


class Crew:
    """At most `most` workers, started when there is something for them to do."""

    def __init__(self, *, most: int, threads: int, quiet: bool) -> None:
        self._most, self._threads, self._quiet = most, threads, quiet
        self._idle: list[_Worker] = []
        self._busy: dict[_Worker, Order] = {}

    def _hired(self) -> _Worker:
        connection, born = processes.started(_serve, threads=self._threads, quiet=self._quiet)
        return _Worker(process=born, connection=connection)

    @property
    def free(self) -> int:
        """How many more orders can be given."""
        return self._most - len(self._busy)

    @property
    def busy(self) -> bool:
        """Whether an answer is still to come."""
        return bool(self._busy)

    def give(self, order: Order) -> None:
        """Hand an order to a worker."""
        worker = self._idle.pop() if self._idle else self._hired()
        self._busy[worker] = order
        with contextlib.suppress(OSError):  # a worker that has died meanwhile is heard of below
            worker.connection.send(order)

    def heard(self) -> Iterator[tuple[Order, Heard | Failed | Done]]:
        """Wait until a worker says something, and all that is said now."""
        ready = wait([worker.connection for worker in self._busy])
        for worker in [worker for worker in self._busy if worker.connection in ready]:
            order = self._busy[worker]
            try:
                said = worker.connection.recv()
            except (EOFError, OSError):
                said = _death(worker)
                del self._busy[worker]
            else:
                if not isinstance(said, Heard):
                    self._idle.append(worker)
                    del self._busy[worker]
            yield order, said

    def dismiss(self) -> None:
        """End all workers at once; what they have not finished is lost."""
        everyone = [*self._idle, *self._busy]
        for worker in everyone:
            worker.process.kill()
        for worker in everyone:
            worker.process.join()
            worker.connection.close()


@contextlib.contextmanager
def crew(*, most: int, quiet: bool) -> Iterator[Crew]:
    """A crew that is dismissed at the end; the cores are shared out among its workers."""
    crew = Crew(most=most, threads=processes.threads(most), quiet=quiet)
    try:
        yield crew
    finally:
        crew.dismiss()


def _death(worker: _Worker) -> Failed:
    worker.connection.close()
    return Failed(words=f"a worker process {processes.death(worker.process)}", again=True)


def _serve(orders: Connection) -> None:
    """What a worker does all its life."""
    task: ClipTask | None = None
    job: ClipJob | None = None
    with contextlib.suppress(EOFError, OSError):
        while True:
            order: Order = orders.recv()
            try:
                if task is None or job != order.job:
                    job, task = order.job, clip_job.prepare(order.job)
                said = _carried_out(order, task, _seldom(orders.send))
            except Exception as error:
                said = _told(error)
            orders.send(said)


def _carried_out(order: Order, task: ClipTask, observe: Callable[[int, str, float], None]) -> Done:
    match order:
        case Cut():
            return tuple(chunk.chunks(task))
        case Restore():
            order.folder.mkdir(parents=True, exist_ok=True)
            return chunk.work(task, order.chunk, order.folder, observe).model_dump_json()
        case Finish():
            records = [ChunkRecord.model_validate_json(record) for record in order.records]
            outcome = clip.finish(task, records, order.folder)
            return Finished(
                restored=outcome.restored, left=outcome.left, failed=outcome.failed, seconds=outcome.seconds, notes=tuple(outcome.notes)
            )


def _seldom(send: Callable[[Heard], None]) -> Callable[[int, str, float], None]:
    last = (-1, -_EVERY)

    def observe(frame: int, stage: str, fraction: float) -> None:
        nonlocal last
        now = time.monotonic()
        if frame != last[0] or now - last[1] >= _EVERY:
            last = frame, now
            send(Heard(frame=frame, stage=stage, fraction=fraction))

    return observe


def _told(error: Exception) -> Failed:
    words = " ".join(str(error).split())
    match error:
        case UnreadableError():
            return Failed(words=words, unreadable=True)
        case MemoryError():
            return Failed(words="memory ran out; fewer workers (-j) need less", again=True)
        case OSError() if error.errno in _DISK:
            return Failed(words=words, disk=(error.errno, error.strerror or words, str(error.filename or "a file")))
        case ValueError() | ArithmeticError() | OSError():
            return Failed(words=words)
        case _:
            return Failed(words=f"failed while working: {type(error).__name__}: {words}")
