"""Runs one attack with the real command, in a forked process under limits, and judges the answer.

Starting Python anew for each of thousands of cases would take hours; a worker imports the libraries once and forks.
"""

import contextlib
import gc
import hashlib
import os
import re
import resource
import shutil
import signal
import sys
import tempfile
import time
import traceback
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tests.cli import forked
from tests.robustness import readers
from tests.robustness.case import Case, Fault

SECONDS = 60  # that a case may take
MEMORY = 2 << 30  # bytes that it may hold
_PROTECTION = 6 << 30  # bytes beyond the worker's own at which the system refuses more, for the machine's sake
GRACE = 2.0  # seconds in which a command's own processes must have ended after it
_SAFE_LINE = re.compile(r"[^\x00-\x08\x0b-\x1f\x7f-\x9f\u200e\u200f\u202a-\u202e\u2066-\u2069\ud800-\udfff]*")

RIGHT = ("refused", "restored")
WRONG = ("traceback", "hang", "false success", "wrong code", "memory", "loss", "left behind", "unclear")


@dataclass(frozen=True, kw_only=True)
class Answer:
    """What became of a case."""

    name: str
    family: str
    verdict: str  # one of RIGHT or WRONG
    code: int
    seconds: float
    bytes: int  # the most memory that the command held
    words: str  # why, or the last line that the command wrote


def prepared() -> None:
    """Import what the command needs, and let it make once what it keeps, before forking."""
    os.environ |= {f"{name}_NUM_THREADS": "1" for name in ("OMP", "OPENBLAS", "MKL")}
    os.environ |= {"RSVIDEO_THREADS": "1", "OPENCV_LOG_LEVEL": "SILENT"}
    forked.import_libraries()
    from rsvideo.cli import app

    with tempfile.TemporaryDirectory() as folder, contextlib.suppress(ValueError):  # there is no such clip
        app(["deblur", str(Path(folder, "absent.mp4")), "-o", str(Path(folder, "out.mkv"))], standalone_mode=False)
    gc.freeze()


def command(words: tuple[str, ...]) -> int:
    """The command, to its exit code."""
    from rsvideo.cli import main

    sys.argv = ["rsvideo", *words]
    try:
        main()
    except SystemExit as end:
        return end.code if isinstance(end.code, int) else 0 if end.code is None else 1
    return 0


def answer(case: Case, keep: Path | None = None, *, program: Callable[[tuple[str, ...]], int] = command) -> Answer:
    """Lay the case out, run it, judge it; its folder stays under `keep`, where that is given."""
    with _folder(case, keep) as (folder, temporary, outputs):
        for name, content in case.files.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_bytes(content) if isinstance(content, bytes) else content(path)
        before = contents(folder)
        ended = _run(lambda: program(case.words), folder, temporary, outputs)
        after = contents(folder)
        text = outputs.read_bytes().decode("utf-8", "surrogateescape")
        verdict, why = _judged(case, folder, ended, text, before, after, left=sorted(path.name for path in temporary.iterdir()))
        words = why or (text.strip().splitlines() or [""])[-1]
        return Answer(
            name=case.name,
            family=case.family,
            verdict=verdict,
            code=ended.code,
            seconds=ended.seconds,
            bytes=ended.bytes,
            words=words[:500],
        )


@contextlib.contextmanager
def _folder(case: Case, keep: Path | None) -> Iterator[tuple[Path, Path, Path]]:
    """Where the case is laid out, where its temporary files go, and what it writes to the terminal."""
    whole = Path(tempfile.mkdtemp(prefix="attack-")) if keep is None else keep / case.name.replace("/", "-")
    try:
        for part in ("work", "temporary"):
            (whole / part).mkdir(parents=True)
        (whole / "output").touch()
        yield whole / "work", whole / "temporary", whole / "output"
    finally:
        if keep is None:
            shutil.rmtree(whole, ignore_errors=True)


def contents(folder: Path) -> dict[str, str]:
    """What is in a folder, by name: the kind of each thing, and what it holds."""
    found: dict[str, str] = {}
    for where, folders, files in os.walk(os.fsencode(folder)):  # bytes: names may be anything
        for name in [*folders, *files]:
            path = os.path.join(where, name)  # noqa: PTH118
            key = os.fsdecode(os.path.relpath(path, os.fsencode(folder)))
            if os.path.islink(path):  # noqa: PTH114
                found[key] = f"link {os.fsdecode(os.readlink(path))}"  # noqa: PTH115
            elif os.path.isdir(path):  # noqa: PTH112
                found[key] = "folder"
            elif os.path.isfile(path):  # noqa: PTH113
                with open(path, "rb") as file:  # noqa: PTH123
                    found[key] = hashlib.file_digest(file, "sha256").hexdigest()
            else:
                found[key] = "other"
    return found


@dataclass(frozen=True, kw_only=True)
class _Ended:
    code: int
    seconds: float
    bytes: int
    hung: bool
    orphans: bool  # processes of the command outlived it


def _run(work: Callable[[], int], folder: Path, temporary: Path, outputs: Path) -> _Ended:
    """Fork, and wait for the end within the limits; all that the process started ends with it."""
    begun = time.monotonic()
    if not (pid := os.fork()):
        _be_forked(work, folder, temporary, outputs)
    hung, status, used = False, 0, None
    while True:
        done, status, used = os.wait4(pid, os.WNOHANG)
        if done:
            break
        if time.monotonic() - begun > SECONDS and not hung:
            hung = True
            os.killpg(pid, signal.SIGKILL)
        time.sleep(0.002 if time.monotonic() - begun < 0.5 else 0.02)
    seconds = time.monotonic() - begun
    return _Ended(code=os.waitstatus_to_exitcode(status), seconds=seconds, bytes=1024 * used.ru_maxrss, hung=hung, orphans=_outlived(pid))


def _outlived(group: int) -> bool:
    """Whether processes of a group are left after a moment; they are ended."""
    until = time.monotonic() + GRACE
    with contextlib.suppress(ProcessLookupError):
        while time.monotonic() < until:
            os.killpg(group, 0)
            time.sleep(0.02)
        os.killpg(group, signal.SIGKILL)
        return True
    return False


def _be_forked(work: Callable[[], int], folder: Path, temporary: Path, outputs: Path) -> None:
    """The forked process: its own group, limits, folder and output. Does not return."""
    code = 1
    try:
        os.setsid()
        held = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
        resource.setrlimit(resource.RLIMIT_AS, (held + _PROTECTION, held + _PROTECTION))
        resource.setrlimit(resource.RLIMIT_FSIZE, (1 << 30, 1 << 30))
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
        for descriptor in (1, 2):
            os.dup2(os.open(outputs, os.O_WRONLY | os.O_APPEND), descriptor)
        os.environ["TMPDIR"] = tempfile.tempdir = str(temporary)
        os.chdir(folder)
        sys.stdout = open(1, "w", encoding="utf-8", closefd=False)  # noqa: SIM115 # as long as the process lives
        sys.stderr = open(2, "w", encoding="utf-8", errors="backslashreplace", closefd=False)  # noqa: SIM115
        code = work()
    except BaseException:
        traceback.print_exc()
    finally:
        with contextlib.suppress(Exception):
            sys.stdout.flush()
            sys.stderr.flush()
        os._exit(code)


def _judged(
    case: Case, folder: Path, ended: _Ended, text: str, before: dict[str, str], after: dict[str, str], left: list[str]
) -> tuple[str, str]:
    """The verdict, and why, where the case does not go as it should; the worst comes first."""
    changed = [name for name, was in before.items() if after.get(name) != was and not (ended.code == 0 and name in case.replaced)]
    refusal = "\n".join(line for line in text.splitlines() if not line.startswith("rsvideo: note: "))
    if changed:
        return "loss", f"changed or gone: {changed}"
    if "Traceback (most recent call last)" in text:
        return "traceback", text[-500:]
    if ended.hung:
        return "hang", f"no end in {SECONDS} s"
    if ended.bytes > MEMORY:
        return "memory", f"{ended.bytes / 1e9:.2f} GB; {text[-200:]!r}"
    if ended.code == 0:
        if case.required:
            return "false success", f"it must refuse, it answered {text[-200:]!r}"
        if fault := _incomplete(case, folder):
            return "false success", fault
    elif ended.code not in case.fault.codes:
        return "wrong code", f"code {ended.code}, right are {sorted(case.fault.codes)}; {text[-300:]!r}"
    elif not _is_clear(case, refusal):
        return "unclear", repr(refusal[-400:])
    new = sorted(set(after) - set(before)) if ended.code else []
    if new or left or ended.orphans:
        return "left behind", f"{new} {left} {'processes' if ended.orphans else ''}; {text[-200:]!r}"
    if not all(_SAFE_LINE.fullmatch(line) for line in text.splitlines()):
        return "unclear", f"control characters: {text[-300:]!r}"
    return ("refused" if ended.code else "restored"), ""


def _is_clear(case: Case, refusal: str) -> bool:
    """One line that begins with the command's name. A file of settings may have several faults, a line each; a plan names them in place."""
    lines = refusal.splitlines()
    if "--dry-run" in case.words and any(" -> nothing: " in line for line in lines):
        return "failed while working" not in refusal
    named = all(line.startswith("rsvideo: ") for line in lines)
    return bool(lines) and named and "failed while working" not in refusal and (len(lines) == 1 or case.fault is Fault.SETTINGS)


def _incomplete(case: Case, folder: Path) -> str | None:
    """Why the result of a success is not whole, by readers that are not the project's; None where it is."""
    if case.output is None:
        return None
    with tempfile.TemporaryDirectory() as name:
        outputs = Path(name, "output")
        outputs.touch()
        found = _run(lambda: _print(readers.incomplete(case, folder)), folder, Path(name), outputs)
        text = outputs.read_text(encoding="utf-8", errors="replace").strip()
    return None if found.code == 0 else f"the result is not whole: {text[-300:]}"


def _print(fault: Any) -> int:
    if fault:
        print(fault, flush=True)
    return 1 if fault else 0
