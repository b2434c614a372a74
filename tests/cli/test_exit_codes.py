"""Signals: obeyed wherever they come, once."""

import os
import signal
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import FrameType

import pytest

from rsvideo.cli import exit_codes
from rsvideo.video.decode import pictures, probe
from tests.video.clips import make


@pytest.fixture(autouse=True)
def _signals() -> Iterator[None]:
    before = {number: signal.getsignal(number) for number in (*exit_codes.SIGNALS, signal.SIGALRM)}
    yield
    for number, how in before.items():
        signal.signal(number, how)


def test_a_hang_up_that_is_ignored_stays_ignored() -> None:
    signal.signal(signal.SIGHUP, signal.SIG_IGN)
    exit_codes.listen()
    os.kill(os.getpid(), signal.SIGHUP)
    with pytest.raises(exit_codes.Stopped):
        os.kill(os.getpid(), signal.SIGTERM)


def test_a_signal_is_obeyed_after_a_frame_that_forgets_what_is_raised_in_it() -> None:
    exit_codes.listen()
    exec("kill(pid, number)", {"kill": os.kill, "pid": os.getpid(), "number": signal.SIGINT})  # as compiled modules do
    with pytest.raises(exit_codes.Stopped, match=str(int(signal.SIGINT))):
        time.sleep(20)


def test_frames_that_pyav_makes_up_are_such(tmp_path: Path) -> None:
    made_up = list[bool]()

    def watch(frame: FrameType, *_: object) -> None:
        if frame.f_code.co_filename.startswith("av/"):
            made_up.append(exit_codes._is_made_up(frame))

    stream = probe(make(tmp_path / "in.mp4"))
    before = sys.gettrace()
    sys.settrace(watch)
    try:
        assert list(pictures(stream))
    finally:
        sys.settrace(before)
    if not made_up:
        pytest.skip("this build of PyAV makes up no frames")
    assert all(made_up)
