"""What somebody who watches a run wants of it, as a word in a file beside its ledger, which the run and its workers read.

A file reaches every machine that shares the disk, and it outlives whoever wrote it. A run takes its own away when it begins.
"""

import contextlib
import time
from pathlib import Path
from typing import Literal, get_args

Wish = Literal["go", "pause", "cancel"]

_NAME = "ledger.control"  # goes with the ledger
_MOST_BYTES = 16
EVERY = 0.3  # seconds from one glance at the file to the next


class CancelledError(Exception):
    """Somebody who watches the run has ended it."""


def wish(working: Path) -> Wish:
    """What is wanted of the run that works in a folder."""
    try:
        with (working / _NAME).open("rb") as file:
            word = file.read(_MOST_BYTES).decode("ascii", "replace").strip()
    except OSError:
        return "go"
    return next((each for each in get_args(Wish) if each == word), "go")


def want(working: Path, what: Wish) -> None:
    """State what is wanted; raises OSError."""
    path = working / _NAME
    if what == "go":
        path.unlink(missing_ok=True)
        return
    part = path.with_name(f"{_NAME}.part")
    part.write_text(what, encoding="ascii")
    part.replace(path)


def clear(working: Path) -> None:
    """Forget what was wanted of an earlier run."""
    with contextlib.suppress(OSError):
        want(working, "go")


class Patience:
    """Waits in a worker as long as its run is to pause; glances at the file a few times a second at most."""

    def __init__(self, working: Path) -> None:
        self._working, self._glanced = working, -EVERY

    def wait(self) -> None:
        """Return at once, or when the run goes on."""
        if time.monotonic() - self._glanced < EVERY:
            return
        while wish(self._working) == "pause":
            time.sleep(EVERY)
        self._glanced = time.monotonic()
