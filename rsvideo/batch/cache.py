"""Sources from object storage on this machine's own disk: each is brought once, and the oldest go when there are too many.

An entry is a folder named by the object's address and version, with the object in it under its own name. It gets its name when it is
whole, and is held by all processes that read it for as long as they live; only what nobody holds is removed.
"""

import contextlib
import errno
import hashlib
import os
import re
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from rsvideo.batch import objects
from rsvideo.config.address import Origin
from rsvideo.config.files import naming
from rsvideo.config.lock import BusyError, locked, shared

_FOLDER, _MOST_GB = "RSVIDEO_CACHE", "RSVIDEO_CACHE_GB"
_GB = 100.0  # unless the environment states another number
_ENTRY = re.compile(r"[0-9a-f]{32}")
_UNFINISHED = "brought-"
_kept = contextlib.ExitStack()  # holds entries as long as this process lives: whatever it starts reads them by their paths
_held: set[Path] = set()  # these


def place_of(origin: Origin) -> Path:
    """Where a source is, once it was brought."""
    named = hashlib.sha256(f"{origin.address} {origin.size} {origin.version}".encode()).hexdigest()[:32]
    return _folder() / named / origin.name


def bring(origin: Origin) -> Path:
    """The file of a source on this machine, downloaded if it is not there yet.

    Raises UnreadableError where it has changed, UnreachableError, and OSError where there is no room.
    """
    path = place_of(origin)
    with naming(path.parent):
        path.parent.parent.mkdir(parents=True, exist_ok=True)
    if not _holds(path, origin):
        _held.discard(path.parent)
        with contextlib.suppress(OSError, BusyError), locked(path.parent, certain=True):
            shutil.rmtree(path.parent)  # which somebody has damaged
        _make_room(origin)
        _download(origin, path)
        if not _holds(path, origin):
            raise OSError(errno.EIO, "it was changed by somebody while it was brought; RSVIDEO_CACHE names another folder", str(path))
    with contextlib.suppress(OSError):
        os.utime(path.parent)  # what was used last is removed last
    return path


def _folder() -> Path:
    if given := os.environ.get(_FOLDER):
        return Path(given).absolute()
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache").absolute() / "rsvideo" / "sources"


def _most_bytes() -> float:
    given = os.environ.get(_MOST_GB, "")
    try:
        most = float(given or _GB)
    except ValueError:
        most = -1.0
    if not 0 < most < 1e6:
        raise ValueError(f"{_MOST_GB} must be a number of gigabytes such as 100, got {given[:40]!r}")
    return 1e9 * most


def _holds(path: Path, origin: Origin) -> bool:
    """Whether an entry is whole; it is then held until this process ends."""
    try:
        if _whole(path, origin) and path.parent not in _held:
            _kept.enter_context(shared(path.parent))
            _held.add(path.parent)
        return _whole(path, origin)
    except (BusyError, OSError):
        return False


def _whole(path: Path, origin: Origin) -> bool:
    return not path.is_symlink() and path.is_file() and path.stat().st_size == origin.size


def _download(origin: Origin, path: Path) -> None:
    with naming(path):
        within = Path(tempfile.mkdtemp(prefix=_UNFINISHED, dir=path.parent.parent))
    try:
        with locked(within):
            objects.download(origin, within / path.name)
            with naming(path):
                os.utime(within / path.name, ns=(origin.modified_ns, origin.modified_ns))  # part of how large sources are recognised
                with contextlib.suppress(FileExistsError), _not_empty_is_there():
                    within.rename(path.parent)
    finally:
        shutil.rmtree(within, ignore_errors=True)


@contextlib.contextmanager
def _not_empty_is_there() -> Iterator[None]:
    """Another process may have brought the same meanwhile."""
    try:
        yield
    except OSError as error:
        if error.errno != errno.ENOTEMPTY:
            raise
        raise FileExistsError from error


def _make_room(origin: Origin) -> None:
    """Remove the oldest entries that nobody holds, and what was never finished; OSError where a source does not fit all the same."""
    folder, most = _folder(), _most_bytes()
    entries, sizes = [], dict[Path, int]()
    with naming(folder):
        for each in folder.iterdir():
            if each.is_dir() and not each.is_symlink() and (_ENTRY.fullmatch(each.name) or each.name.startswith(_UNFINISHED)):
                with contextlib.suppress(OSError):
                    entries.append((_ENTRY.fullmatch(each.name) is not None, each.stat().st_mtime_ns, each))
                    sizes[each] = sum(file.stat().st_size for file in each.iterdir())
    for finished, _, each in sorted(entries):
        if not finished or sum(sizes.values()) + origin.size > most or shutil.disk_usage(folder).free < origin.size:
            with contextlib.suppress(OSError, BusyError), locked(each, certain=True):
                shutil.rmtree(each)
                sizes.pop(each, None)
    if sum(sizes.values()) + origin.size > most:
        words = f"it would hold more than {most / 1e9:g} GB with {origin.address}, of {origin.size / 1e9:.3g} GB; {_MOST_GB} allows more"
        raise OSError(errno.EFBIG, words, str(folder))
    if (free := shutil.disk_usage(folder).free) < origin.size:
        words = f"{origin.address} has {origin.size / 1e9:.3g} GB, {free / 1e9:.3g} GB are free; {_FOLDER} names another folder"
        raise OSError(errno.ENOSPC, words, str(folder))
