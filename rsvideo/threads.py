"""Threads: loops of compiled code, and calls, shared out among as many as the caller chose; never threads within threads."""

import math
import os
import threading
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future
from functools import cache, partial
from queue import SimpleQueue
from typing import Any, TypeVar

from numba import njit
from numba.core.compiler import CompilerBase, DefaultPassBuilder

VARIABLE = "RSVIDEO_THREADS"  # of the environment: how many, read when threads are first needed
_PARTS = 4  # of a loop for each thread: the last ones go to whoever is first done
_LEAST_SIZE = 1e6  # bytes; such a loop takes 0.2 ms, and waking a thread half as long

_here = threading.local()
_Item = TypeVar("_Item")
_Result = TypeVar("_Result")


def cores() -> int:
    """How many the system lets us use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


@cache
def most() -> int:
    """How many threads a loop is shared out among: `RSVIDEO_THREADS`, or all cores."""
    chosen = os.environ.get(VARIABLE, "")
    return max(1, int(chosen)) if chosen.isdecimal() else cores()


class _Apart(CompilerBase):
    """Compiles as usual, but for arrays that do not overlap, as the compiler of parallel loops does."""

    def define_pipelines(self) -> list[Any]:
        self.state.flags.noalias = True
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


def loop(fastmath: bool | set[str] = True) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Compile a loop that `spread` shares out: loop(first, last, *arrays), of which those it writes into overlap no others.

    Numba's own parallel loops take four times as long to compile, and their threads do not survive a fork.
    """
    return njit(cache=True, nogil=True, fastmath=fastmath, pipeline_class=_Apart)


def spread(loop: Callable[..., None], count: int, *arguments: Any, size: float = math.inf) -> None:
    """Call loop(first, last, *arguments) for consecutive parts of range(count), side by side; they write into different places.

    `size` is how many bytes a loop goes through that does little with each: a few are not worth a second thread.
    """
    threads = _free(count) if size > _LEAST_SIZE else 1
    if threads == 1:
        loop(0, count, *arguments)
        return
    parts = min(count, threads * _PARTS)
    bounds = iter([(count * k // parts, count * (k + 1) // parts) for k in range(parts)])
    helpers = [begun(partial(_work, loop, bounds, arguments)) for _ in range(threads - 1)]
    _work(loop, bounds, arguments)
    for helper in helpers:
        helper.result()


def begun(call: Callable[[], _Result]) -> "Future[_Result]":
    """What a call will have answered that goes on beside its caller."""
    return _crew().submit(call)


def each(call: Callable[[_Item], _Result], items: Iterable[_Item]) -> list[_Result]:
    """What a call answers to each item, side by side; loops that it spreads stay in its thread."""
    wanted = list(items)
    if _free(len(wanted)) == 1:
        return [call(item) for item in wanted]
    return [answer.result() for answer in [begun(partial(call, item)) for item in wanted]]


def _work(loop: Callable[..., None], bounds: Iterator[tuple[int, int]], arguments: tuple[Any, ...]) -> None:
    """Parts of a loop until none is left: each goes to one thread, since a list's iterator serves them in turn."""
    for first, last in bounds:
        loop(first, last, *arguments)


def _free(count: int) -> int:
    """How many threads may share `count` parts."""
    return 1 if getattr(_here, "shared", False) else max(1, min(most(), count))


class _Crew:
    """Threads that take one call after another, and that Python does not wait for at its end.

    For a ThreadPoolExecutor's it does: a signal that raises while one is started would leave Python waiting for ever.
    """

    def __init__(self, count: int) -> None:
        self._calls = SimpleQueue[tuple[Future[Any], Callable[[], Any]]]()
        for _ in range(count):
            threading.Thread(target=self._serve, daemon=True).start()

    def submit(self, call: Callable[[], _Result]) -> "Future[_Result]":
        """What the call will have answered."""
        answer = Future[_Result]()
        self._calls.put((answer, call))
        return answer

    def _serve(self) -> None:
        _here.shared = True
        while True:
            answer, call = self._calls.get()
            try:
                answer.set_result(call())
            except BaseException as error:
                answer.set_exception(error)
            del answer, call  # while it waits for the next


@cache
def _crew() -> _Crew:
    return _Crew(most())


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_crew.cache_clear)  # threads do not survive it
