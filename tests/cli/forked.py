"""Starts the command quickly: one process imports the libraries and forks for every call. `from tests.cli.forked import call`.

A start of the command takes about a second, nearly all of it imports. The forked process differs from a fresh one in this alone:
the rooms below the pipeline, and the libraries they use, are imported already. So it is with the workers that a stand-in starts: they
fork from it, and do what a fresh one does with the words that are sent to it. Where the start itself matters (signals, terminals,
limits of the system), tests start a fresh process.
"""

import atexit
import functools
import gc
import importlib
import itertools
import json
import os
import pkgutil
import runpy
import select
import signal
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Sequence
from multiprocessing import util
from pathlib import Path

INSTALLED = Path(sys.executable).with_name("rsvideo")
_LATER = (
    "rsvideo.pipeline",
    "rsvideo.batch",
    "rsvideo.comparison",
    "rsvideo.view",
    "rsvideo.cli",
)  # stand-ins replace parts of them before they are imported
_NEEDS_EXTRA = ("rsvideo.vs", "rsvideo.gpu")
_WITHIN_FUNCTIONS = (
    "av",
    "matplotlib.figure",
    "matplotlib.backends.backend_agg",
    "rich.console",
    "rich.progress",
    "rich.table",
    "s3fs",
    "tifffile",
    "typer",
    "yaml",
)


def call(
    *words: object, program: Path = INSTALLED, timeout: float = 120, env: dict[str, str] | None = None, stdin: str | Path = os.devnull
) -> subprocess.CompletedProcess[str]:
    """What `subprocess.run` answers for the program with these words, from a forked process."""
    server = _server()
    assert server.stdin
    assert server.stdout
    with tempfile.TemporaryDirectory() as folder:
        outputs = [Path(folder, name) for name in ("stdout", "stderr")]
        argv = [str(program), *map(str, words)]
        request = {
            "argv": argv,
            "env": dict(os.environ if env is None else env),
            "cwd": str(Path.cwd()),
            "stdin": str(stdin),
            "outputs": list(map(str, outputs)),
        }
        server.stdin.write(json.dumps(request).encode() + b"\n")
        pid = int(server.stdout.readline())
        if not select.select([server.stdout], [], [], timeout)[0]:
            os.kill(pid, signal.SIGKILL)
            server.stdout.readline()
            raise subprocess.TimeoutExpired(argv, timeout)
        code = int(server.stdout.readline())
        return subprocess.CompletedProcess(argv, code, *(output.read_text(encoding="utf-8") for output in outputs))


@functools.cache
def _server() -> subprocess.Popen[bytes]:
    environment = os.environ | {f"{library}_NUM_THREADS": "1" for library in ("OMP", "OPENBLAS", "MKL")}  # read on import; as main does
    environment |= {"OPENCV_LOG_LEVEL": "SILENT"}
    pipe = subprocess.PIPE
    server = subprocess.Popen([sys.executable, __file__], stdin=pipe, stdout=pipe, env=environment, bufsize=0)
    atexit.register(_end, server)
    return server


def _end(server: subprocess.Popen[bytes]) -> None:
    server.communicate()  # it ends where its requests do


def _serve() -> None:
    """Fork for each request; answer with the process's number, and when it has ended with its exit code."""
    import_libraries(but=_LATER)
    gc.freeze()  # else each forked process would sweep, and so copy, all that was imported when it ends
    while line := sys.stdin.buffer.readline():
        request = json.loads(line)
        if not (pid := os.fork()):
            _run(**request)
            return  # at the interpreter's own end, with what it does there
        os.write(1, b"%d\n" % pid)
        os.write(1, b"%d\n" % os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]))


def import_libraries(*, but: tuple[str, ...] = ()) -> None:
    """Import the project, but for some rooms, and the libraries that its functions import."""
    for package in ("rsvideo", "calibration"):
        for module in pkgutil.walk_packages(importlib.import_module(package).__path__, f"{package}."):
            if not module.name.startswith(but + _NEEDS_EXTRA) and not module.name.endswith("__main__"):
                importlib.import_module(module.name)
    for name in _WITHIN_FUNCTIONS:
        importlib.import_module(name)


def _run(argv: list[str], env: dict[str, str], cwd: str, stdin: str, outputs: list[str]) -> None:
    os.dup2(os.open(stdin, os.O_RDONLY), 0)
    for descriptor, output in enumerate(outputs, start=1):
        os.dup2(os.open(output, os.O_WRONLY | os.O_CREAT | os.O_APPEND), descriptor)
    os.chdir(cwd)
    os.environ.clear()
    os.environ.update(env)
    sys.argv = argv
    sys.path[0] = str(Path(argv[0]).parent)
    if Path(argv[0]) != INSTALLED:  # threads of compiled loops, of which stand-ins have none, do not outlive a fork
        util.spawnv_passfds = _worker
    runpy.run_path(argv[0], run_name="__main__")


def _worker(program: str, line: Sequence[object], kept: Sequence[int]) -> int:
    """In place of `multiprocessing.util.spawnv_passfds`: the line that a fresh Python would be given runs in a forked one."""
    with warnings.catch_warnings(action="ignore"):  # of threads, which only show progress
        if pid := os.fork():
            return pid
    code = 1
    try:
        for number in signal.valid_signals() - {signal.SIGKILL, signal.SIGSTOP}:
            if callable(signal.getsignal(number)):
                signal.signal(number, signal.SIG_DFL)
        for first, last in itertools.pairwise(sorted({2, *kept, os.sysconf("SC_OPEN_MAX")})):
            os.closerange(first + 1, last)
        sys.argv = [program, "--multiprocessing-fork"]
        words = [os.fsdecode(word) if isinstance(word, bytes) else str(word) for word in line]
        exec(words[words.index("-c") + 1], {})
        code = 0
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    finally:
        os._exit(code)


if __name__ == "__main__":
    _serve()
