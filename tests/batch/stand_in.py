"""The command with a core to which a clip is a file of bytes, each of them a frame: quick, but all around it is real.

A frame is restored from all that came before it in its chunk and its warm-up. The environment asks for mishaps:

PACE: seconds a frame
TALLY: a file that gets a line, `clip number`, for each chunk begun
KILLED: the `clip number` of a chunk whose workers die
KILLED_ONCE: a file, absent, that will note that a worker has died
HELD: the `clip number` of a chunk that takes a minute
FULL: the number of a chunk that finds the disk full
CHANGED: a clip that changes while it is read
ORPHANED: a clip after whose result the command is killed; TALLY then gets the number of the worker that is left
"""

import errno
import hashlib
import os
import signal
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType
from typing import Any, Literal

from pydantic import BaseModel

import rsvideo.pipeline
from rsvideo.config.files import UnreadableError, write_whole
from rsvideo.config.method import GyroFile, Method
from rsvideo.physics.shutter import Direction, ShutterTiming

CHUNK = 4


@dataclass(frozen=True, kw_only=True)
class ClipJob:
    """As in rsvideo.pipeline.clip_job."""

    source: Path
    output: Path
    exposure: float | None
    shutter_angle: float | None
    readout: float | None
    row_time: float | None
    scanlines_total: int | None
    direction: Direction | None
    camera: str | None
    focal_px: float | None
    transfer: str | None
    trajectory: Path | None
    method: Method
    block_rows: int | None
    gyro: GyroFile
    steering: Mapping[str, Any]
    encoding: Mapping[str, Any]
    path: Literal["keep", "smooth"]
    span: tuple[float, float] | None
    side_by_side: bool
    on_damage: Literal["fail", "passthrough", "skip"]
    rate: str | None
    force: bool
    overwrite: bool

    @property
    def record(self) -> Path:
        return self.output.with_suffix(".rsvideo.json")


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """As in rsvideo.pipeline.chunk."""

    index: int
    first: int
    last: int
    warm_up: int


@dataclass(frozen=True, kw_only=True)
class ClipTask:
    """As in rsvideo.pipeline.clip_job."""

    job: ClipJob
    data: bytes
    timing: ShutterTiming
    timing_source: str = "exposure explicit, readout explicit"
    notes: tuple[str, ...] = ()
    rows: int = 48
    cols: int = 64

    @property
    def frames(self) -> int:
        return len(self.data)

    def estimate(self) -> tuple[float, int]:
        return 2.0 * self.frames, 1_000_000 * self.frames


class ChunkRecord(BaseModel):
    """As in rsvideo.pipeline.chunk."""

    pictures: str
    sha256: dict[str, str]


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """As in rsvideo.pipeline.clip."""

    notes: tuple[str, ...]
    restored: int
    left: int
    failed: int
    seconds: float


def prepare(job: ClipJob) -> ClipTask:
    if job.exposure is None:
        raise ValueError("exposure must be given, it is not in the file")
    data = job.source.read_bytes()
    if data.startswith(b"BAD"):
        raise UnreadableError(f"{job.source} is damaged")
    for path in (job.output, job.output.with_suffix(".rsvideo.json")):
        if path.exists() and not job.overwrite:
            raise FileExistsError(f"{path} exists already; give --overwrite to replace it")
    return ClipTask(job=job, data=data, timing=ShutterTiming.from_readout(exposure=job.exposure, readout=job.readout or 0, rows=48))


def chunks(task: ClipTask) -> list[Chunk]:
    starts = range(0, task.frames, CHUNK)
    return [Chunk(index=n, first=i, last=min(i + CHUNK, task.frames) - 1, warm_up=min(i, 2)) for n, i in enumerate(starts)]


def work(task: ClipTask, chunk: Chunk, folder: Path, observe: Callable[[int, str, float], None]) -> ChunkRecord:
    if tally := os.environ.get("TALLY"):
        with Path(tally).open("a") as file:
            file.write(f"{task.job.source.name} {chunk.index}\n")
    once = Path(os.environ.get("KILLED_ONCE", "/"))
    if os.environ.get("KILLED") == f"{task.job.source.name} {chunk.index}" or not once.exists():
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if os.environ.get("HELD") == f"{task.job.source.name} {chunk.index}":
        time.sleep(60)
    if os.environ.get("CHANGED") == task.job.source.name:
        task.job.source.write_bytes(task.data.upper())
    if os.environ.get("FULL") == str(chunk.index):
        raise OSError(errno.ENOSPC, "No space left on device", str(folder / "chunk.part"))
    value, made = 0, bytearray()
    for frame in range(chunk.first - chunk.warm_up, chunk.last + 1):
        observe(frame, "motion", 0.5)
        time.sleep(float(os.environ.get("PACE", "0")))
        if task.data[frame] == ord("!"):
            raise UnreadableError(f"{task.job.source} is damaged at frame {frame}")
        value = (31 * value + task.data[frame]) % 251
        if frame >= chunk.first:
            made.append(value)
    name = f"{chunk.index:05}.bytes"
    write_whole({folder / name: bytes(made)})
    return ChunkRecord(pictures=name, sha256={name: hashlib.sha256(made).hexdigest()})


def finish(task: ClipTask, records: list[ChunkRecord], folder: Path) -> Outcome:
    made = b"".join((folder / record.pictures).read_bytes() for record in records)
    write_whole({task.job.output: made, task.job.record: repr(sorted(task.job.steering.items())).encode()})
    if os.environ.get("ORPHANED") == task.job.source.name:
        Path(os.environ["TALLY"]).write_text(f"{os.getpid()}")
        os.kill(os.getppid(), signal.SIGKILL)
        time.sleep(60)
    failed = task.data.count(b"?")
    return Outcome(notes=("timecode is dropped",), restored=len(made) - failed, left=0, failed=failed, seconds=1.5)


core = {"clip_job": (ClipJob, ClipTask, prepare), "chunk": (Chunk, ChunkRecord, chunks, work), "clip": (Outcome, finish)}
for name, held in core.items():  # in the workers too, which import this file by its path
    module = ModuleType(f"rsvideo.pipeline.{name}")
    vars(module).update({each.__name__: each for each in held})
    sys.modules[module.__name__] = module
    setattr(rsvideo.pipeline, name, module)

if __name__ == "__main__":
    from rsvideo.cli import main

    main()
