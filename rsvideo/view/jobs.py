"""Jobs in the folders that were opened, and the runs that work on them, whoever started these.

What is shown of a run is what it states beside its ledger; what is shown of a finished job are its results and their sidecars. Nothing
is kept here, so that a page, or a server, that comes later shows the same.
"""

import json
import os
import signal
import subprocess
import time
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path
from typing import Any

from rsvideo.batch import control, plan, status
from rsvideo.batch.control import Wish
from rsvideo.batch.job import Output, parsed
from rsvideo.batch.plan import Batch
from rsvideo.batch.status import Status
from rsvideo.config import sidecar, yaml
from rsvideo.config.files import UnreadableError
from rsvideo.config.lock import BusyError
from rsvideo.config.placing import real
from rsvideo.view.errands import COMMAND, last_words
from rsvideo.view.opened import JOBS, Opened
from rsvideo.view.processes import descendants, resident

MOST_JOBS = 500  # that are listed
MOST_CLIPS = 200  # of a job, whose results are looked for
MOST_WORKERS = 64
_SILENT = 90.0  # seconds without a word from a run on another machine, after which it counts as ended
_MOST_LOG = 200_000  # bytes of a log that are read
_MOST_LOGS = 200  # of runs, that are kept


@dataclass(frozen=True, kw_only=True)
class Job:
    """A job's file, and where it works."""

    path: Path
    working: Path
    folder: Path  # of the results
    fault: str = ""  # why it is none that can be run


class Jobs:
    """Finds jobs, and starts, pauses, resumes and cancels their runs."""

    def __init__(self, opened: Opened, state: Path, command: Sequence[str] = COMMAND) -> None:
        self._opened, self._command = opened, tuple(command)
        self._logs = state / "runs"
        self._logs.mkdir(parents=True, exist_ok=True, mode=0o700)
        self._read: dict[Path, tuple[tuple[int, int], Job | None]] = {}
        self._started: dict[Path, subprocess.Popen[bytes]] = {}  # by the folders they work in
        self._results: dict[Path, tuple[int, bool]] = {}

    def listed(self) -> list[dict[str, Any]]:
        """All jobs, those at work first."""
        found = [self._values(job) for job in self._found()]
        order = {"running": 0, "preparing": 0, "starting": 0, "pausing": 0, "paused": 0}
        return sorted(found, key=lambda job: (order.get(job["state"], 1), job["name"]))

    def one(self, path: Path) -> Job:
        """The job in a file; UnreadableError where it is none."""
        job = self._job(path)
        if job is None:
            raise UnreadableError(f"{path.name} is no job's file; it lists no clips")
        return job

    def start(self, path: Path, *, workers: int, overwrite: bool, fresh: bool = False) -> None:
        """Start a run as a process of its own, which outlives the server; ValueError, UnreadableError or BusyError where it may not be."""
        plan.read(path, overwrite=overwrite)  # what is wrong with the file is a sentence for the page
        job = self.one(path)
        if self._state(job, status.read(job.working))[0] in ("running", "preparing", "starting", "pausing", "paused"):
            raise BusyError(job.working)
        words = ["run", str(path), "-j", str(min(max(workers, 1), MOST_WORKERS)), "--progress", "none", "--json"]
        words += [flag for flag, wanted in (("--overwrite", overwrite), ("--fresh", fresh)) if wanted]
        self._tidy()
        with (self._log(job, "out")).open("wb") as out, self._log(job, "err").open("wb") as err:
            process = subprocess.Popen(
                [*self._command, *words],
                stdin=subprocess.DEVNULL,
                stdout=out,
                stderr=err,
                cwd=path.parent,
                start_new_session=True,  # no signal to the server reaches it
                env=os.environ | {"PYTHONSAFEPATH": "1"},
            )
        self._started[job.working] = process

    def steer(self, path: Path, what: Wish) -> None:
        """Pause, resume or cancel the run of a job; ValueError where none is at work."""
        job = self.one(path)
        held = status.read(job.working)
        state, _ = self._state(job, held)
        if held is None or state not in ("running", "preparing", "pausing", "paused"):
            if state == "starting" and what == "cancel":
                self._started[job.working].terminate()
                return
            raise ValueError(f"no run of {path.name} is at work; start one first")
        if what == "cancel" and held.here and held.born is not None and status.born(held.pid) == held.born:
            os.kill(held.pid, signal.SIGTERM)
        else:
            control.want(job.working, what)

    def _found(self) -> Iterator[Job]:
        """Jobs by their files, and by runs whose results lie in the folders."""
        found: dict[Path, Job] = {}
        running: list[Path] = []
        for path in self._opened.below():
            if path.suffix.lower() in JOBS and path.is_file() and (job := self._job(path)):
                found[real(job.working)] = job
            elif path.name.startswith(".rsvideo-") and (path / status.NAME).is_file():
                running.append(path)
            if len(found) >= MOST_JOBS:
                break
        for working in running:
            if real(working) not in found and (held := status.read(working)):
                found[real(working)] = Job(path=Path(held.job), working=working, folder=working.parent)
        yield from found.values()

    def _job(self, path: Path) -> Job | None:
        """The job in a file, read again once it has changed; None where the file is none."""
        try:
            stat = path.stat()
        except OSError:
            return None
        stamp = stat.st_mtime_ns, stat.st_size
        if path not in self._read or self._read[path][0] != stamp:
            self._read[path] = stamp, _read(path)
        return self._read[path][1]

    def _state(self, job: Job, held: Status | None) -> tuple[str, bool]:
        """In one word what a job is doing, and whether its run may be steered."""
        process = self._started.get(job.working)
        at_work = process is not None and process.poll() is None
        if held is not None and held.alive is not False:
            silent = held.alive is None and time.time() - held.written > _SILENT
            if not silent:
                wish = control.wish(job.working)
                pausing = wish == "pause" and held.state == "running"
                return ("pausing" if pausing else held.state), True
        if at_work:
            return "starting", True
        if held is not None:
            return ("failed" if held.state == "ended" and held.code in (1, 2, 3, 4, 5) else "interrupted"), False
        return "ready", False

    def _values(self, job: Job) -> dict[str, Any]:
        """A job for the page."""
        held = status.read(job.working)
        state, steerable = self._state(job, held)
        values: dict[str, Any] = {
            "name": job.path.name,
            "at": self._opened.at(job.path) if self._opened.holds(job.path) else None,
            "fault": job.fault,
            "steerable": steerable,
            "words": self._last_words(job, held, state),
            "clips": [],
        }
        if held is not None:
            alive = held.alive and held.here
            values |= {name: getattr(held, name) for name in ("done", "frames", "seconds_left", "workers", "scheduler", "began", "more")}
            values["host"] = None if held.here else held.host
            values["memory"] = resident([held.pid, *descendants(held.pid)]) if alive else None
            values["clips"] = [clip.model_dump() | self._places(clip.source, clip.output, job) for clip in held.clips[:MOST_CLIPS]]
        elif not job.fault:
            values["clips"] = self._finished(job)
            made = [clip["state"] == "finished" for clip in values["clips"]]
            if state == "ready" and made:
                state = "done" if all(made) else "ready"
            self._add_faults(job, values, state)
            if values["words"] and state == "ready":
                state = "failed"
        return values | {"state": state}

    def _finished(self, job: Job) -> list[dict[str, Any]]:
        """What stands of the results of a job that is not running."""
        try:
            batch = plan.read(job.path, overwrite=True)
        except (ValueError, OSError, UnreadableError):
            return []
        clips = []
        for item in batch.items[:MOST_CLIPS]:
            made = self._is_result(item.request.record, item.request.output, batch)
            clip = {"source": str(item.request.source), "output": str(item.request.output), "words": "", "fraction": float(made)}
            clip |= {"state": "finished" if made else "waiting", "frames": 0, "chunks": 0, "chunks_done": 0}
            clips.append(clip | self._places(item.request.source, item.request.output, job))
        return clips

    def _is_result(self, record: Path, output: Path, batch: Batch) -> bool:
        """Whether a result of this job stands under a name."""
        try:
            stamp = record.stat().st_mtime_ns
        except OSError:
            return False
        if self._results.get(record, (0, False))[0] != stamp:
            written = sidecar.written(record)
            self._results[record] = stamp, bool(written and written.mark and written.mark.job == batch.job)
        return self._results[record][1] and output.exists()

    def _places(self, source: object, output: object, job: Job) -> dict[str, Any]:
        """How source and result are called, and where they are, as far as their folders were opened."""
        found: dict[str, Any] = {}
        for which, path in (("source", Path(str(source))), ("output", Path(str(output)))):
            whole = path if path.is_absolute() else job.path.parent / path
            found[f"{which}_name"] = path.name
            found[f"{which}_at"] = self._opened.at(whole) if self._opened.holds(whole) and whole.exists() else None
        return found

    def _last_words(self, job: Job, held: Status | None, state: str) -> str:
        """Why the latest run ended, if it did not end well."""
        if state in ("running", "preparing", "starting", "pausing", "paused"):
            return ""
        if held is not None and held.words:
            return held.words
        process = self._started.get(job.working)
        log = self._log(job, "err")
        if held is None and log.is_file() and (process is None or process.poll() not in (None, 0)):
            with suppress(OSError):
                lines = [line.removeprefix("rsvideo: ") for line in last_words(log.read_bytes()[-_MOST_LOG:]).splitlines()]
                kept = [line for line in lines if line and not line.startswith(("note: ", "clip  "))]
                return kept[-1] if kept else ""
        return ""

    def _add_faults(self, job: Job, values: dict[str, Any], state: str) -> None:
        """The reasons that a run gave at its end, of clips that have no result."""
        if state == "done":
            values["words"] = ""
        if state != "ready":
            return
        with suppress(OSError, ValueError, TypeError, LookupError):
            ended = json.loads(self._log(job, "out").read_bytes()[-_MOST_LOG:].splitlines()[-1])
            faults = {clip["output"]: clip["fault"] for clip in ended["clips"] if clip["fault"]}
            for clip in values["clips"]:
                if clip["state"] != "finished" and clip["output"] in faults:
                    clip |= {"state": "failed", "words": str(faults[clip["output"]])[:2000]}

    def _log(self, job: Job, kind: str) -> Path:
        return self._logs / f"{sha256(str(real(job.working)).encode('utf-8', 'surrogateescape')).hexdigest()[:24]}.{kind}"

    def _tidy(self) -> None:
        """Remove the oldest logs."""
        with suppress(OSError):
            logs = sorted(self._logs.iterdir(), key=lambda path: path.stat().st_mtime)
            for old in logs[:-_MOST_LOGS]:
                old.unlink()


def _read(path: Path) -> Job | None:
    """A job as its file states it; with its fault where it is meant for one and is none."""
    try:
        data, positions = yaml.load(path)
    except (UnreadableError, ValueError):
        return None
    if not isinstance(data, dict) or "clips" not in data:
        return None
    stated = data.get("output")
    folder = stated.get("folder") if isinstance(stated, dict) else None
    results = folder if isinstance(folder, str) and folder and "\0" not in folder else Output().folder
    working = plan.working_of(path, results)
    try:
        parsed(data, positions)
        fault = ""
    except ValueError as error:
        fault = str(error)
    return Job(path=path, working=working, folder=working.parent, fault=fault)
