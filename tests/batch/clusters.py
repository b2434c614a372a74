"""A scheduler and workers of dask.distributed as their users start them, with the core that costs nothing."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from tests.batch.runs import environment

EVERYWHERE = {"PYTHONPATH": str(Path(__file__).with_name("everywhere"))}


@dataclass(kw_only=True, eq=False)
class Machines:
    """A scheduler, and the workers that were started; each with its nanny and its child in a group of its own."""

    folder: Path
    everywhere: dict[str, str] = field(default_factory=lambda: EVERYWHERE)
    running: list[subprocess.Popen[bytes]] = field(default_factory=list)
    address: str = ""

    def start(self, *words: str, **mishaps: object) -> subprocess.Popen[bytes]:
        """A part of Dask, in the background."""
        line = [sys.executable, "-m", "distributed.cli.dask_" + words[0], *words[1:], "--no-dashboard"]
        log = (self.folder / f"{words[0]}-{len(self.running)}.log").open("wb")
        with log:
            self.running.append(
                subprocess.Popen(line, stdout=log, stderr=log, env=environment({**self.everywhere, **mishaps}), start_new_session=True)
            )
        return self.running[-1]

    def worker(self, *, threads: int = 1, **mishaps: object) -> subprocess.Popen[bytes]:
        """One more worker."""
        words = (self.address, "--nworkers", "1", "--nthreads", str(threads), "--local-directory", str(self.folder))
        return self.start("worker", *words, **mishaps)

    def await_workers(self, count: int) -> None:
        """Wait until so many have joined."""
        program = f"from distributed import Client; Client({self.address!r}).wait_for_workers({count}, timeout=60)"
        subprocess.run([sys.executable, "-c", program], check=True, timeout=90)


@contextlib.contextmanager
def running(folder: Path, everywhere: dict[str, str] = EVERYWHERE) -> Iterator[Machines]:
    """A scheduler without workers; nothing is left of it and its workers at the end."""
    machines = Machines(folder=folder, everywhere=everywhere)
    stated = folder / "scheduler.json"
    machines.start("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(stated))
    try:
        while not stated.exists() or '"address": "tcp://' not in stated.read_text():
            time.sleep(0.05)
        machines.address = stated.read_text().split('"address": "')[1].split('"')[0]
        yield machines
    finally:
        for each in machines.running:
            with contextlib.suppress(ProcessLookupError):
                os.killpg(each.pid, signal.SIGKILL)
            each.wait()
