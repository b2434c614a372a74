"""The command as tests of batches start it: with a core that costs nothing (`stand_in.py`), to its end or in the background."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.cli import forked

STAND_IN = Path(__file__).with_name("stand_in.py")


def environment(mishaps: dict[str, object]) -> dict[str, str]:
    """Of a run with these mishaps, as `stand_in.py` describes them."""
    return os.environ | {"PYTHONDONTWRITEBYTECODE": "1"} | {name: str(value) for name, value in mishaps.items()}


def call(*words: object, how: Callable[[], None] | None = None, **mishaps: object) -> subprocess.CompletedProcess[str]:
    """A call to its end; `how` is called in its process before it begins."""
    if how is None:
        return forked.call(*words, program=STAND_IN, timeout=120, env=environment(mishaps))
    program = [sys.executable, str(STAND_IN), *map(str, words)]
    return subprocess.run(
        program, capture_output=True, encoding="utf-8", timeout=120, env=environment(mishaps), check=False, preexec_fn=how
    )


def begun(tally: Path, chunks: int) -> None:
    """Wait until so many chunks have been begun."""
    while not tally.exists() or tally.read_text().count("\n") < chunks:
        time.sleep(0.01)


@contextlib.contextmanager
def under_way(*words: object, program: Path = STAND_IN, **mishaps: object) -> Iterator[subprocess.Popen[str]]:
    """A call in the background, in a group of its own, of which nothing is left at the end."""
    line = [sys.executable, str(program), *map(str, words)]
    pipe = subprocess.PIPE
    with subprocess.Popen(line, stdout=pipe, stderr=pipe, text=True, env=environment(mishaps), start_new_session=True) as working:
        try:
            yield working
        finally:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(working.pid, signal.SIGKILL)
