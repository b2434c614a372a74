"""How a run is doing, in a small file beside its ledger: whoever watches a run reads this, since the ledger has one reader.

The file is replaced as a whole, a few times a second at most. It goes with the ledger when all is done: what is finished then is
stated by the sidecars of the results. Nothing depends on it, so that a disk that is full does not end a run here.
"""

import contextlib
import os
import socket
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from rsvideo.batch import control
from rsvideo.batch.plan import Batch, Planned, Unreadable
from rsvideo.batch.run import Event
from rsvideo.config.files import UnreadableError, read_whole
from rsvideo.config.printable import in_unicode
from rsvideo.pipeline import processes

NAME = "ledger.status.json"  # goes with the ledger
MOST_CLIPS = 1000  # that are listed; the others are counted
_MOST_BYTES = 4_000_000
_EVERY = 0.5  # seconds from one writing to the next
_LONGEST = 2000  # characters of words
_BORN = 19  # of the fields of /proc/PID/stat behind the command's name: when the process began, in ticks

State = Literal["preparing", "running", "paused", "ended"]
Words = Annotated[str, Field(max_length=5000)]


class ClipStatus(BaseModel):
    """How far one clip or photograph is."""

    model_config = ConfigDict(extra="forbid")

    source: Words
    output: Words
    state: Literal["waiting", "working", "finished", "failed"] = "waiting"
    words: Words = ""  # the stage; why it failed
    fraction: Annotated[float, Field(ge=0, le=1)] = 0.0
    frames: int = 0
    chunks: int = 0  # 0 until it is cut
    chunks_done: int = 0


class Status(BaseModel):
    """How far a run is."""

    model_config = ConfigDict(extra="forbid")

    version: Literal[1] = 1
    job: Words  # the job's file
    pid: int
    born: int | None  # by which the process is distinguished from a later one of the same number
    host: Words
    scheduler: Words | None  # whose workers restore
    workers: int
    began: float  # seconds since 1970
    written: float
    state: State = "preparing"
    words: Words = ""  # how it ended
    code: int | None = None  # with which it ended
    done: float = 0.0  # frames
    frames: int = 0
    seconds_left: float | None = None
    clips: list[ClipStatus] = []
    more: int = 0  # clips that are not listed

    @property
    def here(self) -> bool:
        """Whether the run is, or was, one of this machine."""
        return self.host == socket.gethostname()

    @property
    def alive(self) -> bool | None:
        """Whether the process of the run is there; None where nothing shows this, as on another machine."""
        if self.state == "ended":
            return False
        if not self.here or not Path("/proc/self/stat").exists():
            return None
        return born(self.pid) is not None and born(self.pid) == self.born


def born(pid: int) -> int | None:
    """When a process began, in the system's ticks; None where there is none, or where the system does not say."""
    fields = processes.stat(pid)
    return int(fields[_BORN]) if len(fields) > _BORN and fields[0] not in "ZX" else None


def read(working: Path) -> Status | None:
    """The status of the latest run that worked in a folder; None where there is none that can be understood."""
    try:
        return Status.model_validate_json(read_whole(working / NAME, most=_MOST_BYTES))
    except (UnreadableError, ValidationError):
        return None


class Recorder:
    """Keeps the status of the run of this process."""

    def __init__(self, working: Path, status: Status) -> None:
        self._working, self._status, self._last = working, status, 0.0
        self._clips: dict[str, ClipStatus] = {}

    def planned(self, plans: Sequence[Planned | Unreadable]) -> None:
        """All is settled, and the work begins."""
        for plan in plans:
            if isinstance(plan, Planned):
                clip = ClipStatus(source=_words(plan.source), output=_words(plan.output), frames=plan.frames)
            else:
                clip = ClipStatus(source=_words(plan.source), output=_words(plan.output), state="failed", words=_words(plan.fault))
            self._clips[clip.output] = clip
        listed = list(self._clips.values())
        self._status.clips, self._status.more = listed[:MOST_CLIPS], max(0, len(listed) - MOST_CLIPS)
        self._status.state, self._status.frames = "running", sum(clip.frames for clip in listed)
        self._write()

    def take(self, event: Event) -> None:
        """Something happened in the run."""
        status, clip = self._status, self._clips.get(_words(event.output))
        status.done, status.frames, status.seconds_left = event.done, event.frames, event.seconds_left
        status.state = "paused" if event.event == "paused" else "running"
        if clip is not None:
            clip.chunks, clip.chunks_done = event.chunks, event.chunks_done
            clip.fraction = min(1.0, max(0.0, event.fraction or 0.0))
            if event.event in ("finished", "failed"):
                clip.state = event.event
            elif clip.state in ("waiting", "working"):
                clip.state = "finished" if event.event == "resumed" and event.finished else "working"
            clip.words = "" if clip.state == "finished" else _words(event.words)
        if event.event not in ("frame", "stage") or time.monotonic() - self._last >= _EVERY:
            self._write()

    def ended(self, code: int, words: str = "") -> None:
        """The run ends with an exit code."""
        self._status.state, self._status.code, self._status.words = "ended", code, _words(words)
        self._write()

    def _write(self) -> None:
        self._last, self._status.written = time.monotonic(), time.time()
        path = self._working / NAME
        part = path.with_name(f"{NAME}.part")
        with contextlib.suppress(OSError):
            part.write_bytes(self._status.model_dump_json().encode())
            part.replace(path)


@contextlib.contextmanager
def noted(batch: Batch, job: Path, *, workers: int, scheduler: str | None) -> Iterator[Recorder]:
    """The status of a run of a batch whose ledger is open; what ends the run by raising is its last word."""
    control.clear(batch.working)
    now = time.time()
    status = Status(
        job=_words(job.absolute()),
        pid=os.getpid(),
        born=born(os.getpid()),
        host=socket.gethostname(),
        scheduler=scheduler and _words(scheduler),
        workers=workers,
        began=now,
        written=now,
    )
    recorder = Recorder(batch.working, status)
    recorder._write()
    try:
        yield recorder
    except BaseException as error:
        recorder.ended(1, " ".join(str(error).split()) if isinstance(error, Exception) else "stopped")
        raise


def _words(words: object) -> str:
    return in_unicode(str(words))[:_LONGEST]
