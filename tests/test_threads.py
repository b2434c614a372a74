"""Loops and calls that threads share."""

import os
import subprocess
import sys
import threading
from collections.abc import Iterator

import numpy as np
import pytest
from numba import njit

from rsvideo import threads


@njit(nogil=True)
def squares(first, last, values, out):
    """As a compiled loop of the project takes its part."""
    for i in range(first, last):
        out[i] += values[i] ** 2


@pytest.fixture(params=[1, 2, 7])
def count(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[int]:
    """How many threads there are."""
    monkeypatch.setenv(threads.VARIABLE, str(request.param))
    for cached in (threads.most, threads._crew):
        cached.cache_clear()
    yield request.param
    for cached in (threads.most, threads._crew):
        cached.cache_clear()


@pytest.mark.parametrize("size", [0, 1, 2, 9, 1000])
def test_each_part_of_a_loop_is_done_once(count: int, size: int) -> None:
    values, out = np.arange(float(size)), np.zeros(size)
    threads.spread(squares, size, values, out)
    np.testing.assert_array_equal(out, values**2)


def test_a_loop_goes_to_as_many_threads_as_there_are(count: int) -> None:
    meeting = threading.Barrier(count)
    seen = set[int]()

    def loop(first: int, last: int) -> None:
        if threading.get_ident() not in seen:
            seen.add(threading.get_ident())
            meeting.wait(timeout=20)

    threads.spread(loop, 100)
    assert len(seen) == count


def test_calls_answer_in_order(count: int) -> None:
    assert threads.each(lambda k: k * k, range(20)) == [k * k for k in range(20)]


def test_a_call_goes_on_beside_its_caller(count: int) -> None:
    here, there = threading.Event(), threading.Event()
    answer = threads.begun(lambda: there.set() or here.wait(10))
    assert there.wait(10)
    here.set()
    assert answer.result()


def test_a_loop_within_a_call_stays_in_its_thread(count: int) -> None:
    def idents(_: int) -> tuple[int, set[int]]:
        inner = set[int]()
        threads.spread(lambda *_: inner.add(threading.get_ident()), 50)
        return threading.get_ident(), inner

    answers = threads.each(idents, range(20))
    if count > 1:
        assert all(inner == {outer} for outer, inner in answers)


def test_what_a_part_raises_is_raised(count: int) -> None:
    def loop(first: int, last: int) -> None:
        if last == 100:
            raise ArithmeticError("the last part")

    with pytest.raises(ArithmeticError, match="the last part"):
        threads.spread(loop, 100)


INTERRUPTED = """
import threading
from rsvideo import threads

start = threading.Thread.start
def interrupted(thread):
    start(thread)
    raise KeyboardInterrupt

threading.Thread.start = interrupted
threads.each(str, range(9))
"""


def test_a_signal_while_threads_are_started_does_not_keep_python_from_ending() -> None:
    line, stated = [sys.executable, "-c", INTERRUPTED], {threads.VARIABLE: "3"}
    done = subprocess.run(line, capture_output=True, text=True, env=os.environ | stated, timeout=30, check=False)
    assert done.stderr.endswith("KeyboardInterrupt\n")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="this system does not fork")
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_a_forked_process_has_threads_of_its_own(count: int) -> None:
    values, out = np.arange(9.0), np.zeros(9)
    threads.spread(squares, 9, values, out)
    child = os.fork()
    if child == 0:
        threads.spread(squares, 9, values, out)
        os._exit(0 if (out == 2 * values**2).all() else 1)
    for _ in range(200):
        done, status = os.waitpid(child, os.WNOHANG)
        if done:
            break
        threading.Event().wait(0.1)
    else:
        os.kill(child, 9)
        os.waitpid(child, 0)
        pytest.fail("the child waits for threads that it does not have")
    assert os.waitstatus_to_exitcode(status) == 0
