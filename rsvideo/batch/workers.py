"""Worker processes: each takes one order at a time, and one that dies takes nothing with it but that order."""

import contextlib
import errno
import logging
import multiprocessing
import os
import signal
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path

from rsvideo.config.files import UnreadableError
from rsvideo.pipeline import clip as pipeline
from rsvideo.pipeline.clip import Chunk, ClipJob, ClipTask

_EVERY = 0.1  # seconds between two words about one frame
_DISK = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS, errno.EIO)  # no other clip would fare better
_SIGNALS = (signal.SIGINT, signal.SIGTERM)


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
        worker = self._idle.pop() if self._idle else _started(self._threads, quiet=self._quiet)
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
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    if (wanted := os.environ.get("NUMBA_NUM_THREADS", "")).isdecimal():
        cores = min(cores, most * int(wanted))
    crew = Crew(most=most, threads=max(1, cores // most), quiet=quiet)
    try:
        yield crew
    finally:
        crew.dismiss()


def _started(threads: int, *, quiet: bool) -> _Worker:
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=_serve, args=(theirs, quiet), daemon=True)
    signal.pthread_sigmask(signal.SIG_BLOCK, _SIGNALS)  # a worker is born deaf to them, and opens its ears when it can obey
    one_each = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
    patience = os.environ.get("OMP_WAIT_POLICY", "passive")  # threads that spin while they wait starve each other
    try:
        with _environment(NUMBA_NUM_THREADS=str(threads), OMP_WAIT_POLICY=patience, **one_each):
            process.start()  # these are read once, when the libraries are first imported
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    theirs.close()
    return _Worker(process=process, connection=ours)  # pyright: ignore[reportArgumentType] # Windows has another kind


@contextlib.contextmanager
def _environment(**values: str) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _death(worker: _Worker) -> Failed:
    worker.connection.close()
    worker.process.kill()
    worker.process.join()
    code = worker.process.exitcode or 0
    how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
    return Failed(words=f"a worker process ended ({how}{'; did memory run out?' if code == -signal.SIGKILL else ''})", again=True)


def _serve(orders: Connection, quiet: bool) -> None:
    """What a worker does all its life."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal sends it to everyone; the parent decides
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, _SIGNALS)
    threading.Thread(target=_follow_parent, daemon=True).start()
    if quiet:
        warnings.simplefilter("ignore")
        logging.getLogger().addHandler(logging.NullHandler())
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 # what C libraries remark about a damaged file
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
    task: ClipTask | None = None
    job: ClipJob | None = None
    with contextlib.suppress(EOFError, OSError):
        while True:
            order: Order = orders.recv()
            try:
                if task is None or job != order.job:
                    job, task = order.job, pipeline.prepare(order.job)
                said = _carried_out(order, task, _seldom(orders.send))
            except Exception as error:
                said = _told(error)
            orders.send(said)


def _follow_parent() -> None:
    """Nobody is left to hear the answer: end, rather than work on beside the run that takes over."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)


def _carried_out(order: Order, task: ClipTask, observe: Callable[[int, str, float], None]) -> Done:
    match order:
        case Cut():
            return tuple(pipeline.chunks(task))
        case Restore():
            order.folder.mkdir(parents=True, exist_ok=True)
            return pipeline.work(task, order.chunk, order.folder, observe).model_dump_json()
        case Finish():
            records = [pipeline.ChunkRecord.model_validate_json(record) for record in order.records]
            outcome = pipeline.finish(task, records, order.folder)
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
