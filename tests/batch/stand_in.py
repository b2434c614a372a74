"""The command with a core to which a clip is a file of bytes, each of them a frame: quick, but all around it is real.

A frame is restored from all that came before it in its chunk and its warm-up. The environment asks for mishaps:

PACE: seconds a frame
TALLY: a file that gets a line, `clip number`, for each chunk begun
OPENED: a file that gets a line, `clip process`, each time a clip is opened
DIARY: a file that gets a line, `begun clip number` or `done clip number`, for each chunk begun and each done
KILLED: the `clip number` of a chunk whose workers die
KILLED_ONCE: a file, absent, that will note that a worker has died
HELD: the `clip number` of a chunk that takes a minute
FULL: the number of a chunk that finds the disk full
CHANGED: a clip that changes while it is read
UNSEEN: a folder that lies on another machine
REFUSED: an object that cannot be uploaded
UPLOADED: an object after whose upload the command is killed
ORPHANED: a result after which the command is killed; TALLY then gets the number of the worker that is left
"""

import errno
import hashlib
import json
import multiprocessing
import os
import signal
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import rsvideo.pipeline
from rsvideo.config import placing
from rsvideo.config.files import UnreachableError, UnreadableError, made_within, write_whole
from rsvideo.config.placing import Made
from rsvideo.config.request import Request
from rsvideo.config.sidecar import Mark
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline.pieces import Chunk, ChunkRecord, Finished, Outcome, stated
from rsvideo.progress import Observer, Progress

CHUNK = 4


@dataclass(frozen=True, kw_only=True)
class Task:
    """As in rsvideo.pipeline.prepare."""

    request: Request
    data: bytes
    picture_bytes: int = 1
    timing: ShutterTiming
    timing_source: str = "exposure explicit, readout explicit"
    notes: tuple[str, ...] = ()
    first: int = 0
    rows: int = 48
    cols: int = 64

    @property
    def frames(self) -> int:
        return len(self.data)

    def estimate(self) -> tuple[float, int]:
        return 2.0 * self.frames, 1_000_000 * self.frames


def prepare(request: Request, piped: object = None, found: object = None) -> Task:
    if opened := os.environ.get("OPENED"):
        with Path(opened).open("a") as file:
            file.write(f"{request.source.name} {os.getpid()}\n")
    camera = request.camera
    if camera.exposure is None:
        raise ValueError("exposure must be given, it is not in the file")
    for path in (request.source, request.output):
        if (unseen := os.environ.get("UNSEEN")) and Path(unseen) in path.parents:
            raise UnreadableError(f"{path} is on another machine")
    data = request.source.read_bytes()
    if data.startswith(b"BAD"):
        raise UnreadableError(f"{request.source} is damaged")
    for path in (request.output, request.record):
        if path.exists() and not request.overwrite:
            raise FileExistsError(f"{path} exists already; give --overwrite to replace it")
    timing = ShutterTiming.from_readout(exposure=camera.exposure, readout=camera.readout or 0, rows=48)
    return Task(request=request, data=data, timing=timing)


def chunks(task: Task) -> list[Chunk]:
    starts = range(0, task.frames, CHUNK)
    return [Chunk(index=n, first=i, last=min(i + CHUNK, task.frames) - 1, warm_up=min(i, 2)) for n, i in enumerate(starts)]


def work(task: Task, chunk: Chunk, folder: Path, observe: Observer) -> ChunkRecord:
    if tally := os.environ.get("TALLY"):
        with Path(tally).open("a") as file:
            file.write(f"{task.request.source.name} {chunk.index}\n")
    note(f"begun {task.request.source.name} {chunk.index}")
    once = Path(os.environ.get("KILLED_ONCE", "/"))
    if os.environ.get("KILLED") == f"{task.request.source.name} {chunk.index}" or not once.exists():
        once.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    if os.environ.get("HELD") == f"{task.request.source.name} {chunk.index}":
        time.sleep(60)
    if os.environ.get("CHANGED") == task.request.source.name:
        task.request.source.write_bytes(task.data.upper())
    if os.environ.get("FULL") == str(chunk.index):
        raise OSError(errno.ENOSPC, "No space left on device", str(folder / "chunk.part"))
    value, made = 0, bytearray()
    for frame in range(chunk.first - chunk.warm_up, chunk.last + 1):
        observe(Progress(stage="motion", fraction=0.5, frame=frame))
        time.sleep(float(os.environ.get("PACE", "0")))
        if task.data[frame] == ord("!"):
            raise UnreadableError(f"{task.request.source} is damaged at frame {frame}")
        value = (31 * value + task.data[frame]) % 251
        if frame >= chunk.first:
            made.append(value)
    name = f"{chunk.index:05}.bytes"
    write_whole({folder / name: bytes(made)})
    note(f"done {task.request.source.name} {chunk.index}")
    return ChunkRecord(pictures=name, frames=name, sha256={name: hashlib.sha256(made).hexdigest()})


def note(line: str) -> None:
    if diary := os.environ.get("DIARY"):
        with Path(diary).open("a") as file:
            file.write(f"{line}\n")


def finish(task: Task, records: list[ChunkRecord], folder: Path, mark: Mark | None = None) -> Finished:
    data = b"".join((folder / record.pictures).read_bytes() for record in records)
    within = Path(tempfile.mkdtemp(prefix="run-", dir=folder))
    made = made_within(within, task.request.output, data)
    failed = task.data.count(b"?")
    outcome = Outcome(notes=("timecode is dropped",), restored=len(data) - failed, left=0, failed=failed, seconds=1.5)
    head = {"version": 1, "stated": repr(task.request.stated()), "written": stated(outcome, [made], mark).model_dump()}
    record = made_within(within, task.request.record, json.dumps(head)[:-1].encode() + b',"frames":[\n]}\n')
    return Finished(outcome=outcome, made=(made, record))


place = placing.place


def place_and_die(made: Sequence[Made]) -> None:
    """As a run does that is killed when the result has its names and the ledger does not know."""
    place(made)
    if os.environ.get("ORPHANED") in [each.path.name for each in made]:
        (worker,) = multiprocessing.active_children()
        Path(os.environ["TALLY"]).write_text(f"{worker.pid}")
        os.kill(os.getpid(), signal.SIGKILL)


core = {"prepare": (Task, prepare), "deblur": (chunks, work, finish)}
for name, held in core.items():  # in the workers too, which import this file by its path
    module = ModuleType(f"rsvideo.pipeline.{name}")
    vars(module).update({each.__name__: each for each in held})
    sys.modules[module.__name__] = module
    setattr(rsvideo.pipeline, name, module)

if __name__ == "__main__":
    from rsvideo.batch import objects
    from rsvideo.cli import main

    upload = objects.Objects._upload

    def refuse(self: objects.Objects, name: str, content: Path | bytes) -> None:
        """As the owner of a bucket may, or a network that goes away."""
        if name == os.environ.get("REFUSED"):
            raise UnreachableError(errno.EIO, "no access", self.at(name))
        upload(self, name, content)
        if name == os.environ.get("UPLOADED"):
            os.kill(os.getpid(), signal.SIGKILL)

    placing.place = place_and_die
    objects.Objects._upload = refuse
    main()
