"""How much memory there is, and work that needs more refused before it begins, with both figures."""

import contextlib
import os
from collections.abc import Iterator
from pathlib import Path

from rsvideo.config.files import UnreadableError

_GROUPS = Path("/sys/fs/cgroup")
_LEAST_REFUSED = 256_000_000  # bytes; what needs less is tried: the figures are not that exact


def check(path: Path, what: str, needed: float) -> None:
    """Refuse a file (`what` says its size) whose treatment needs more bytes than there are; UnreadableError."""
    there = available()
    if there is not None and needed > max(there, _LEAST_REFUSED):
        raise UnreadableError(
            f"{path} needs about {needed / 1e9:.2g} GB of memory, since {what}; there are {there / 1e9:.2g} GB: a crop needs less"
        )


def available() -> int | None:
    """Bytes that this process can still take, by the system, by its control groups and by its own limit; None where nothing states it."""
    return min((max(0, each) for each in (*_of_system(), *_of_groups(), *_of_process())), default=None)


def _of_system() -> Iterator[int]:
    with contextlib.suppress(OSError, ValueError, IndexError):
        lines = (line.split() for line in Path("/proc/meminfo").read_text(encoding="ascii").splitlines())
        held = {words[0]: 1024 * int(words[1]) for words in lines}
        yield held["MemAvailable:"] + held.get("SwapFree:", 0)
        return
    with contextlib.suppress(AttributeError, ValueError, OSError):  # not on Windows, and not on every Unix
        yield os.sysconf("SC_AVPHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


def _of_groups() -> Iterator[int]:
    """What is left in each control group around this process, of either version; pages of files that can be dropped are not counted."""
    with contextlib.suppress(OSError, UnicodeDecodeError):
        for line in Path("/proc/self/cgroup").read_text(encoding="utf-8").splitlines():
            _, kinds, name = line.split(":", 2)
            if kinds not in ("", "memory"):
                continue
            top = _GROUPS / kinds
            limit, used = ("memory.max", "memory.current") if not kinds else ("memory.limit_in_bytes", "memory.usage_in_bytes")
            inner = top / name.strip("/")
            for folder in [inner, *(each for each in inner.parents if each.is_relative_to(top))]:
                with contextlib.suppress(OSError, ValueError):  # no such group is visible here, or it is "max"
                    yield int((folder / limit).read_text()) - int((folder / used).read_text()) + _droppable(folder / "memory.stat")


def _droppable(stat: Path) -> int:
    held = dict(line.split() for line in stat.read_text().splitlines())
    return int(held.get("inactive_file", 0))


def _of_process() -> Iterator[int]:
    with contextlib.suppress(ImportError, OSError, ValueError):  # there is no such module on Windows
        import resource

        limit = resource.getrlimit(resource.RLIMIT_AS)[0]
        if limit != resource.RLIM_INFINITY:
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
            yield limit - pages * resource.getpagesize()
