"""Processes of our own: each with its share of the cores, quiet, deaf to the terminal, and gone when its parent is."""

import contextlib
import logging
import multiprocessing
import os
import signal
import threading
import warnings
from collections.abc import Callable, Iterator
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from pathlib import Path
from typing import Any

from rsvideo.allocation import keep_freed_memory
from rsvideo.config.placing import SIGNALS
from rsvideo.gpu import device
from rsvideo.threads import VARIABLE, cores

_ONE_EACH = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")  # threads of libraries would multiply with ours

_SAFE_PATH = {"PYTHONSAFEPATH": "1"}  # no module is taken from the current folder, where anything may lie
GRACE = 5  # seconds in which a process that has no more to do may end by itself


def threads(most: int) -> int:
    """For each of `most` processes: its share of the cores, or what the caller has chosen, if that is less."""
    share, chosen = max(1, cores() // most), os.environ.get(VARIABLE, "")
    return min(share, max(1, int(chosen))) if chosen.isdecimal() else share


def started(target: Callable[..., None], *words: Any, threads: int, quiet: bool) -> tuple[Connection, BaseProcess]:
    """A process that calls target(connection, *words), and our end of the connection."""
    spawn = multiprocessing.get_context("spawn")
    ours, theirs = spawn.Pipe()
    process = spawn.Process(target=_live, args=(target, theirs, words, quiet, device.found()), daemon=True)
    signal.pthread_sigmask(signal.SIG_BLOCK, SIGNALS)  # it is born deaf to them, and opens its ears when it can obey
    try:
        with _environment(**{VARIABLE: str(threads)}, **_SAFE_PATH, **dict.fromkeys(_ONE_EACH, "1")):
            process.start()  # these are read once, when Python starts and when the libraries are first imported
    finally:
        signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    theirs.close()
    return ours, process  # pyright: ignore[reportReturnType] # Windows has another kind


def stat(pid: int) -> list[str]:
    """The fields of /proc/PID/stat behind the command's name; none where there is no such process, or the system does not say."""
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/stat").read_text(encoding="utf-8", errors="replace").rpartition(")")[2].split()
    return []


def death(process: BaseProcess) -> str:
    """How a process ended that has reported nothing more; one that goes on all the same is killed."""
    process.join(GRACE)
    process.kill()
    process.join()
    code = process.exitcode or 0
    how = f"killed by {signal.Signals(-code).name}" if code < 0 else f"exit code {code}"
    return f"ended ({how}{'; did memory run out?' if code == -signal.SIGKILL else ''})"


@contextlib.contextmanager
def _environment(**values: str) -> Iterator[None]:
    before = {name: os.environ.get(name) for name in values}
    os.environ.update(values)
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


def _live(target: Callable[..., None], connection: Connection, words: tuple[Any, ...], quiet: bool, on_device: list[str | None]) -> None:
    keep_freed_memory()
    device.take(on_device)
    for number in SIGNALS:  # the terminal sends the others to everyone; the parent decides
        signal.signal(number, signal.SIG_DFL if number == signal.SIGTERM else signal.SIG_IGN)
    signal.pthread_sigmask(signal.SIG_UNBLOCK, SIGNALS)
    threading.Thread(target=_follow_parent, daemon=True).start()
    if quiet:
        warnings.simplefilter("ignore")
        logging.getLogger().addHandler(logging.NullHandler())
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 # what C libraries remark about a damaged file
            os.dup2(nowhere.fileno(), 1)
            os.dup2(nowhere.fileno(), 2)
    target(connection, *words)


def _follow_parent() -> None:
    """Nobody is left to hear the answer: end, rather than work on beside the run that takes over."""
    parent = multiprocessing.parent_process()
    assert parent is not None
    wait([parent.sentinel])
    os._exit(1)
