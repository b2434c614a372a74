"""Processes of the page's own that open clips and preview them: each takes one order at a time, and can be replaced at any time.

The server waits for them without using the processor, and so do they for it. A process that takes too long, or dies of what it was
given, is replaced by another; the order gets one sentence.
"""

import threading
import time
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

from rsvideo.pipeline import processes
from rsvideo.progress import Observer, Progress, seldom

GRACE = 1.5  # seconds in which a process may end an order by itself that is not wanted any more
_LOOK = 0.05  # seconds between two glances at what is wanted
_WORDS = 2000  # characters of an error's sentence at most

Work = Callable[[Any, Observer], Iterator[Any]]
"""What a process does with an order: yields answers, tells how far it is."""


class FailedError(Exception):
    """An order came to nothing; the sentence says why."""


class ReplacedError(Exception):
    """An order is not wanted any more."""


class Child:
    """One process, started when there is something to do; `work` is called in it with each order."""

    def __init__(self, work: Work, *, threads: int, quiet: bool = True) -> None:
        self._work, self._threads, self._quiet = work, threads, quiet
        self._process: BaseProcess | None = None
        self._connection: Connection | None = None
        self._lock = threading.Lock()  # one order at a time

    def warm(self) -> None:
        """Start the process, so that the first order need not wait for it."""
        with self._lock:
            self._ready()

    def answers(self, order: Any, *, seconds: float, wanted: Callable[[], bool] = lambda: True) -> Iterator[Any]:
        """Carry an order out: yields `Progress` and answers. Raises FailedError; ReplacedError once it is not `wanted` any more."""
        with self._lock:
            connection, process = self._ready()
            try:
                connection.send(order)
                yield from self._received(connection, time.monotonic() + seconds, seconds, wanted)
            except (EOFError, OSError) as error:
                self._drop()
                raise FailedError(f"the process for this {processes.death(process)}; try a smaller picture or another frame") from error
            except GeneratorExit:
                self._drop()
                raise

    def one(self, order: Any, *, seconds: float) -> Any:
        """The only answer to an order."""
        found = None
        for answer in self.answers(order, seconds=seconds):
            if not isinstance(answer, Progress):
                found = answer
        return found

    def close(self) -> None:
        """End the process."""
        self._drop()

    def _received(self, connection: Connection, until: float, seconds: float, wanted: Callable[[], bool]) -> Iterator[Any]:
        stopped: float | None = None
        while True:
            if connection.poll(_LOOK):
                kind, value = connection.recv()
                if kind == "answer" and stopped is None:
                    yield value
                elif kind == "done":
                    if stopped is not None:
                        raise ReplacedError
                    return
                elif kind == "failed":
                    raise ReplacedError if stopped is not None else FailedError(value)
                continue
            now = time.monotonic()
            if stopped is None and not wanted():
                stopped = now
                connection.send(None)
            if stopped is not None and now - stopped > GRACE:
                self._drop()
                raise ReplacedError
            if now > until:
                self._drop()
                raise FailedError(f"this takes longer than {seconds:g} s and was ended; try a smaller picture or another frame")

    def _ready(self) -> tuple[Connection, BaseProcess]:
        if self._connection is None or self._process is None or not self._process.is_alive():
            self._drop()
            self._connection, self._process = processes.started(_serve, self._work, threads=self._threads, quiet=self._quiet)
        return self._connection, self._process

    def _drop(self) -> None:
        if self._process is not None:
            self._process.kill()
            self._process.join()
        if self._connection is not None:
            self._connection.close()
        self._process = self._connection = None


def _serve(orders: Connection, work: Work) -> None:
    """What such a process does all its life; None among the orders says that the current one is not wanted any more."""

    def check() -> None:
        if orders.poll():
            raise ReplacedError

    while True:
        try:
            order = orders.recv()
        except (EOFError, OSError):
            return
        if order is None:  # it came when all was done
            continue
        try:
            for answer in work(order, _checking(orders, check)):
                check()
                orders.send(("answer", answer))
            orders.send(("done", None))
        except ReplacedError:
            orders.send(("done", None))
        except MemoryError:
            orders.send(("failed", "memory ran out; choose a smaller picture, or close other programs"))
        except Exception as error:
            own = isinstance(error, ValueError | ArithmeticError | OSError) or type(error).__name__.endswith("Error")
            words = " ".join(str(error).split())[:_WORDS] or type(error).__name__
            orders.send(("failed", words if own else f"failed while working: {type(error).__name__}: {words}"))


def _checking(orders: Connection, check: Callable[[], None]) -> Observer:
    """Sends reports now and then, and checks at each whether the work is still wanted."""
    send = seldom(lambda progress: orders.send(("answer", progress)))

    def observe(progress: Progress) -> None:
        check()
        send(progress)

    return observe
