"""Commands of rsvideo that a page starts and waits for: each a process of its own with a list of arguments and a limit of time."""

import os
import secrets
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

COMMAND = (sys.executable, "-c", "from rsvideo.cli import main; main()")
MOST_KEPT = 24
_MOST_OUTPUT = 4_000_000  # bytes of what a command prints
_MOST_WORDS = 3000  # characters
_UNIT = {"PYTHONSAFEPATH": "1", "OMP_WAIT_POLICY": "passive"}


@dataclass(kw_only=True, eq=False)
class Errand:
    """A command that works, or what it came to."""

    id: str
    what: str  # such as lens
    process: subprocess.Popen[bytes] | None = None
    state: Literal["working", "done", "failed", "cancelled"] = "working"
    code: int | None = None
    output: str = ""
    words: str = ""  # its last words, line by line
    begun: float = field(default_factory=time.monotonic)
    version: int = 0

    def values(self) -> dict[str, Any]:
        """For the page."""
        words = [line.removeprefix("rsvideo: ") for line in self.words.splitlines()]
        seconds = round(time.monotonic() - self.begun, 1)
        return {"id": self.id, "what": self.what, "state": self.state, "words": words, "seconds": seconds, "version": self.version}


class Errands:
    """Starts commands; `command` is how rsvideo is called."""

    def __init__(self, command: Sequence[str] = COMMAND) -> None:
        self.command = tuple(command)
        self._kept: dict[str, Errand] = {}
        self._changed = threading.Condition()

    def start(self, what: str, *words: object, seconds: float) -> Errand:
        """Start a command; one of the same kind that still works is ended first."""
        with self._changed:
            for other in self._kept.values():
                if other.what == what and other.state == "working":
                    self._cancel(other)
            errand = Errand(id=secrets.token_hex(8), what=what)
            self._kept[errand.id] = errand
            for id in list(self._kept)[:-MOST_KEPT]:
                if self._kept[id].state != "working":
                    del self._kept[id]
        threading.Thread(target=self._carry_out, args=(errand, [str(word) for word in words], seconds), daemon=True).start()
        return errand

    def run(self, *words: object, seconds: float) -> tuple[int, str, str]:
        """A command to its end: its exit code, what it printed and its last words."""
        line = [*self.command, *map(str, words)]
        try:
            done = subprocess.run(line, capture_output=True, stdin=subprocess.DEVNULL, timeout=seconds, env=os.environ | _UNIT, check=False)
        except subprocess.TimeoutExpired:
            return 1, "", f"this takes longer than {seconds:g} s and was ended"
        return done.returncode, done.stdout[:_MOST_OUTPUT].decode("utf-8", "replace"), last_words(done.stderr)

    def get(self, id: str) -> Errand:
        """One that is kept; KeyError."""
        return self._kept[id]

    def wait(self, errand: Errand, version: int, seconds: float) -> dict[str, Any]:
        """Its values once they are newer than a version, or as they are after a while."""
        with self._changed:
            self._changed.wait_for(lambda: errand.version > version, timeout=seconds)
            return errand.values()

    def cancel(self, errand: Errand) -> None:
        """End a command."""
        with self._changed:
            self._cancel(errand)

    def close(self) -> None:
        """End all commands."""
        with self._changed:
            for errand in self._kept.values():
                self._cancel(errand)

    def _cancel(self, errand: Errand) -> None:
        if errand.state == "working":
            errand.state = "cancelled"
            errand.version += 1
            if errand.process is not None:
                with suppress(OSError):
                    errand.process.kill()
            self._changed.notify_all()

    def _carry_out(self, errand: Errand, words: list[str], seconds: float) -> None:
        with tempfile.TemporaryFile() as out, tempfile.TemporaryFile() as err:
            with self._changed:
                if errand.state != "working":
                    return
                errand.process = subprocess.Popen(
                    [*self.command, *words], stdin=subprocess.DEVNULL, stdout=out, stderr=err, env=os.environ | _UNIT
                )
            late = ""
            try:
                code = errand.process.wait(timeout=seconds)
            except subprocess.TimeoutExpired:
                errand.process.kill()
                code, late = errand.process.wait(), f"this takes longer than {seconds:g} s and was ended\n"
            out.seek(0)
            err.seek(0)
            with self._changed:
                errand.code, errand.output = code, out.read(_MOST_OUTPUT).decode("utf-8", "replace")
                errand.words = late + last_words(err.read(_MOST_OUTPUT))
                if errand.state == "working":
                    errand.state = "done" if code == 0 else "failed"
                errand.version += 1
                self._changed.notify_all()


def last_words(stderr: bytes) -> str:
    """The end of what a command wrote to standard error, as much as a page can show."""
    return stderr.decode("utf-8", "replace")[-_MOST_WORDS:].strip()


def state_folder() -> Path:
    """Where the page keeps what outlives it and belongs to no folder of clips: logs of runs, motions that it had found."""
    home = os.environ.get("XDG_STATE_HOME") or os.environ.get("LOCALAPPDATA") or str(Path.home() / ".local" / "state")
    folder = Path(home) / "rsvideo" / "view"
    try:
        folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        folder = Path(tempfile.mkdtemp(prefix="rsvideo-view-"))
    return folder
