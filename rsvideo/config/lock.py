"""Folders that a process holds until it ends, however it ends: one run of a job at a time, and none that works is cleared away."""

import contextlib
import errno
import os
from collections.abc import Iterator
from pathlib import Path

try:
    import fcntl
except ImportError:  # not on Windows, where an open ledger cannot be moved or opened by others
    fcntl = None


class BusyError(Exception):
    """Another run works on this job."""

    def __init__(self, held: Path) -> None:
        super().__init__(f"another run works on this job already (it holds {held}); wait for it, or stop it first")


@contextlib.contextmanager
def locked(folder: Path, *, certain: bool = False) -> Iterator[None]:
    """Hold a folder; raises BusyError where another process does, and if it must be `certain`, where the system cannot tell."""
    if fcntl is None:
        if certain:
            raise BusyError(folder)
        yield
        return
    try:
        descriptor = os.open(folder, os.O_RDONLY)
    except FileNotFoundError as error:
        raise BusyError(folder) from error  # which has just ended, and removed it
    try:
        if not _held(descriptor, folder, certain=certain):
            raise BusyError(folder)
        yield
    finally:
        os.close(descriptor)


@contextlib.contextmanager
def shared(folder: Path) -> Iterator[None]:
    """Hold a folder together with others who do so too, so that nobody has it for himself; raises BusyError where somebody has."""
    if fcntl is None:
        yield
        return
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        if not _held(descriptor, folder, certain=False, kind=fcntl.LOCK_SH):
            raise BusyError(folder)
        yield
    finally:
        os.close(descriptor)


def _held(descriptor: int, folder: Path, *, certain: bool, kind: int | None = None) -> bool:
    assert fcntl is not None
    try:
        fcntl.flock(descriptor, (fcntl.LOCK_EX if kind is None else kind) | fcntl.LOCK_NB)
        return os.path.samestat(os.fstat(descriptor), folder.stat())
    except (BlockingIOError, FileNotFoundError):
        return False
    except OSError as error:
        if error.errno not in (errno.ENOLCK, errno.EOPNOTSUPP, errno.EINVAL, errno.ENOSYS):
            raise
        return not certain  # a file system without locks; the ledger has one of its own
