"""Worker processes: each takes one order at a time, and one that dies takes nothing with it but that order."""

import contextlib
import errno
from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Protocol, runtime_checkable

from rsvideo.batch.control import Patience
from rsvideo.batch.plan import Found
from rsvideo.batch.store import Store
from rsvideo.config.files import UnreadableError
from rsvideo.config.request import Request
from rsvideo.config.sidecar import Mark
from rsvideo.pipeline import deblur, processes
from rsvideo.pipeline.pieces import Chunk, ChunkRecord, Finished
from rsvideo.pipeline.prepare import Task, prepare
from rsvideo.progress import Observer, Progress, ignore, seldom

_LONGEST_WAIT = 1.0  # seconds for a report; then others may be listened to
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)  # no other clip would fare better


@dataclass(frozen=True, kw_only=True)
class Look:
    """Find in a source what its plan needs to know."""

    request: Request


@dataclass(frozen=True, kw_only=True)
class Cut:
    """Find where a source is cut into chunks."""

    request: Request


@dataclass(frozen=True, kw_only=True)
class Restore:
    """Restore one chunk into a folder."""

    request: Request
    chunk: Chunk
    folder: Path
    store: Store  # where machines leave it that do not write into that folder


@dataclass(frozen=True, kw_only=True)
class Finish:
    """Make the result from its chunks, whose records are given as JSON; the run gives it its names."""

    request: Request
    records: tuple[str, ...]
    folder: Path
    mark: Mark


Order = Look | Cut | Restore | Finish


@dataclass(frozen=True, kw_only=True)
class Failed:
    """An order came to nothing."""

    words: str
    unreadable: bool = False  # the input is at fault
    disk: tuple[int, str, str] | None = None  # errno, its words, and the file, if the disk is full or may not be written
    again: bool = False  # another try may do


Done = Found | tuple[Chunk, ...] | str | Finished  # of Look; of Cut; of Restore, its record as JSON; of Finish
Answer = Progress | Failed | Done


class ClusterError(Exception):
    """Hands on other machines are gone."""


@runtime_checkable
class Hands(Protocol):
    """Who carries orders out, one after the other or several at a time."""

    @property
    def tries(self) -> int:
        """How often an order may cost a worker its life."""
        ...

    @property
    def busy(self) -> bool:
        """Whether an answer is still to come."""
        ...

    def free(self, kind: type[Order]) -> bool:
        """Whether one more order of this kind can be given."""
        ...

    def give(self, order: Order) -> None:
        """Hand over an order."""
        ...

    def answers(self) -> Iterator[tuple[Order, Answer]]:
        """Wait until something is reported; all that is reported now."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class _Worker:
    process: BaseProcess
    connection: Connection


class Crew:
    """At most `most` workers on this machine, started when there is something for them to do."""

    tries = 2

    def __init__(self, *, most: int, threads: int, quiet: bool) -> None:
        self._most, self._threads, self._quiet = most, threads, quiet
        self._idle: list[_Worker] = []
        self._busy: dict[_Worker, Order] = {}

    def _hired(self) -> _Worker:
        connection, born = processes.started(_serve, threads=self._threads, quiet=self._quiet)
        return _Worker(process=born, connection=connection)

    @property
    def busy(self) -> bool:
        """Whether an answer is still to come."""
        return bool(self._busy)

    @property
    def connections(self) -> list[Connection]:
        """By which workers report."""
        return [worker.connection for worker in self._busy]

    def free(self, kind: type[Order]) -> bool:  # noqa: ARG002 # each worker does all
        """Whether one more order can be given."""
        return len(self._busy) < self._most

    def give(self, order: Order) -> None:
        """Hand an order to a worker."""
        worker = self._idle.pop() if self._idle else self._hired()
        self._busy[worker] = order
        with contextlib.suppress(OSError):  # a worker that has died meanwhile is found below
            worker.connection.send(order)

    def answers(self) -> Iterator[tuple[Order, Answer]]:
        """Wait until a worker reports something, for a while; all that is reported now."""
        ready = wait(self.connections, timeout=_LONGEST_WAIT)
        for worker in [worker for worker in self._busy if worker.connection in ready]:
            order = self._busy[worker]
            try:
                answer = worker.connection.recv()
            except (EOFError, OSError):
                answer = _death(worker)
                del self._busy[worker]
            else:
                if not isinstance(answer, Progress):
                    self._idle.append(worker)
                    del self._busy[worker]
            yield order, answer

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


def found(requests: Sequence[Request], hands: Hands, observe: Observer = ignore) -> dict[str, Found]:
    """What workers find in sources, by the names of the outputs: to measure a clip takes seconds.

    Of a source that they cannot read, or whose request is wrong, they find nothing: whoever plans it comes upon the same. After a wrong
    request no more are looked at.
    """
    waiting, out, ended = deque[Order](Look(request=request) for request in requests), dict[str, Found](), 0
    for order, answer in answers_to(waiting, hands):
        ended += not isinstance(answer, Progress)
        observe(Progress(stage=f"looking into {order.request.named}", fraction=ended / len(requests)))
        if isinstance(answer, Found):
            out[order.request.output.name] = answer
        elif isinstance(answer, Failed) and not (answer.unreadable or answer.again):
            waiting.clear()
    return out


def answers_to(waiting: deque[Order], hands: Hands) -> Iterator[tuple[Order, Answer]]:
    """All that is reported of orders, which are given as hands are free; none that the caller takes out of those that wait."""
    while waiting or hands.busy:
        while waiting and hands.free(type(waiting[0])):
            hands.give(waiting.popleft())
        yield from hands.answers()


def _death(worker: _Worker) -> Failed:
    worker.connection.close()
    return Failed(words=f"a worker process {processes.death(worker.process)}", again=True)


def _serve(orders: Connection) -> None:
    """What a worker does all its life."""
    task: Task | None = None
    request: Request | None = None
    with contextlib.suppress(EOFError, OSError):
        while True:
            order: Order = orders.recv()
            try:
                if task is None or request != order.request:
                    request, task = order.request, prepare(order.request)
                answer = _carried_out(order, task, seldom(orders.send))
            except Exception as error:
                answer = failed(error)
            orders.send(answer)


def _carried_out(order: Order, task: Task, observe: Observer) -> Done:
    match order:
        case Look():
            return Found.of(task.request)
        case Cut():
            return tuple(deblur.chunks(task))
        case Restore():
            order.folder.mkdir(parents=True, exist_ok=True)
            return deblur.work(task, order.chunk, order.folder, _patient(order, observe)).model_dump_json()
        case Finish():
            records = [ChunkRecord.model_validate_json(record) for record in order.records]
            return deblur.finish(task, records, order.folder, order.mark)


def _patient(order: Restore, observe: Observer) -> Observer:
    """Passes all on, and holds the work up as long as its run is to pause."""
    if order.store.working is None:  # it pauses when this order is done
        return observe
    patience = Patience(order.store.working)

    def waiting(progress: Progress) -> None:
        patience.wait()
        observe(progress)

    return waiting


def failed(error: Exception) -> Failed:
    """What an order came to that raised this."""
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
