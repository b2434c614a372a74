"""How results get their names: made aside, placed together, and never over an input or over what is not to be replaced.

Whatever writes a file for the user does it in three steps. `check` refuses names that must not be written. `aside` gives a new folder
beside the result, which is ours alone: nothing that stands there already is written through or removed. `place` moves what was made
there to its names, all of it or nothing.
"""

import contextlib
import errno
import os
import shutil
import signal
import tempfile
import threading
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import FrameType

from rsvideo.config.lock import BusyError, locked

SIGNALS = tuple(getattr(signal, name) for name in ("SIGINT", "SIGTERM", "SIGHUP") if hasattr(signal, name))
"""By which a person or the system asks for an end."""

_PREFIX, _MARK, _OLDER = ".rsvideo-", ".made-aside-by-rsvideo", ".older"


@dataclass(frozen=True, kw_only=True)
class Made:
    """A file or folder that is complete and on the disk, in a folder of our own under the name it is to have."""

    at: Path
    path: Path  # where it is to be, on the same file system
    sha256: str = ""  # of its content, where that is of use
    replaced: tuple[Path, ...] = ()  # files of an older folder at `path` that the new one stands for; what else it holds stays


def check(written: Sequence[Path], read: Iterable[Path], *, overwrite: bool) -> None:
    """Refuse files that must not be written.

    Raises ValueError for one that is or holds a file that is read, for one that stands for something else than a file or folder, and for
    two of one name; FileExistsError for one that exists, unless it is to be overwritten.
    """
    if len({path.absolute() for path in written}) < len(written):
        raise ValueError(f"each file that is written needs a name of its own, got {', '.join(map(str, written))}")
    inputs = list(read)
    for path in written:
        for each in inputs:
            if same(path, each):
                raise ValueError(f"{path} must not be written, it is {each}, which is read and would be lost")
            if path.is_dir() and real(path) in real(each).parents:
                raise ValueError(f"{path} must not be written, it holds {each}, which is read and would be lost")
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise ValueError(f"{path} must be the name of a file, it is a device or a pipe")
        check_free(path, overwrite=overwrite)


def check_free(path: Path, *, overwrite: bool) -> None:
    """Raises FileExistsError where something stands under a name, be it a link that leads nowhere, and is not to be overwritten."""
    if os.path.lexists(path) and not overwrite:
        raise FileExistsError(f"{path} exists already; give --overwrite to replace it")


def same(one: Path, other: Path) -> bool:
    """Whether two names stand for one file, by links or by letters that the file system does not tell apart."""
    with contextlib.suppress(OSError):
        if one.samefile(other):
            return True
    return real(one) == real(other)


def real(path: Path) -> Path:
    """The path without links, as far as they lead anywhere: links in a circle stay."""
    return Path(os.path.realpath(path))


@contextlib.contextmanager
def aside(folder: Path) -> Iterator[Path]:
    """A new folder of our own within `folder`, gone at the end with all that is left in it; and so are those of processes that died."""
    _clear(folder)
    with tempfile.TemporaryDirectory(prefix=_PREFIX, dir=folder, ignore_cleanup_errors=True) as name, locked(Path(name)):
        (Path(name) / _MARK).touch()  # by which others know whose it is, from when on it is held
        yield Path(name)


def _clear(folder: Path) -> None:
    """Remove what processes that were killed have left aside: what is marked as ours, held by nobody, and keeps nothing older."""
    with contextlib.suppress(OSError):
        for left in folder.glob(f"{_PREFIX}*"):
            with contextlib.suppress(OSError, BusyError):
                if (left / _MARK).exists() and not (left / _OLDER).exists():
                    with locked(left, certain=True):
                        shutil.rmtree(left, ignore_errors=True)


def place(made: Sequence[Made]) -> None:
    """Give all their names in this order, or none of them where one cannot be had; no signal that can be caught comes between.

    A kill that cannot be caught may come between two names. So the last is to be the sidecar, which states the hashes of the others:
    a result beside which a sidecar stands that states its hash is whole and belongs to it, whatever happened.
    What stood under a name is kept beside the new until all have theirs, and goes with the folder in which the new was made.
    """
    path, moved = None, list[tuple[Path, Path]]()
    with uninterrupted():
        try:
            for each in made:
                path = each.path
                _place(each, moved)
        except OSError as error:
            for before, after in reversed(moved):
                with contextlib.suppress(OSError):
                    after.rename(before)
            raise OSError(error.errno, error.strerror, str(path)) from error
        for folder in {each.path.parent for each in made}:
            _sync(folder)


def _place(made: Made, moved: list[tuple[Path, Path]]) -> None:
    """Move what was made, or into an older folder its files; `moved` gets what was moved from where to where, to be undone if need be."""
    if made.path.exists() and made.path.is_dir() != made.at.is_dir():
        number = errno.EISDIR if made.path.is_dir() else errno.ENOTDIR
        raise OSError(number, os.strerror(number), str(made.path))
    older = made.at.parent / _OLDER
    pairs = [(made.at, made.path)]
    if made.at.is_dir() and made.path.is_dir():
        pairs = [(file, made.path / file.name) for file in sorted(made.at.iterdir())]
    for path in [*made.replaced, *(path for _, path in pairs)]:
        if os.path.lexists(path):
            older.mkdir(exist_ok=True)
            _keep(path, older / path.name, moved, named=path not in made.replaced)
    for at, path in pairs:
        at.rename(path)
        moved.append((at, path))


def _keep(path: Path, older: Path, moved: list[tuple[Path, Path]], *, named: bool) -> None:
    """Keep what stands under a name; `named`: by a second name, so that its own, which the new takes, is at no time without one."""
    try:
        if not named:
            raise OSError
        os.link(path, older, follow_symlinks=False)
    except OSError:  # there are file systems without second names
        path.rename(older)
    moved.append((path, older))


def _sync(folder: Path) -> None:
    """Names are on the disk when this returns, where the system can say so."""
    with contextlib.suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


@contextlib.contextmanager
def uninterrupted() -> Iterator[None]:
    """Signals that come meanwhile are obeyed at the end; what they raise then carries a note if the work was completed."""
    if threading.current_thread() is not threading.main_thread():  # which alone obeys signals
        yield
        return
    came: list[int] = []

    def later(number: int, _: FrameType | None) -> None:
        came.append(number)

    before = {number: signal.getsignal(number) for number in SIGNALS}
    before = {number: how for number, how in before.items() if callable(how) or how is signal.SIG_DFL}
    for number in before:
        signal.signal(number, later)
    complete = False
    try:
        yield
        complete = True
    finally:
        for number, how in before.items():
            signal.signal(number, how)
        try:
            for number in came:
                signal.raise_signal(number)
        except BaseException as stop:
            if complete:
                stop.add_note("the result is complete")
            raise
