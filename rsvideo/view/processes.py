"""What the system says of processes: who started whom, and how much memory they hold; nothing where it does not say."""

import os
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path

from rsvideo.pipeline.processes import stat

_PROCESSES = Path("/proc")
_PARENT, _PAGES = 1, 21  # of the fields of /proc/PID/stat behind the command's name


def descendants(pid: int) -> list[int]:
    """All processes that a process started, and theirs."""
    children: dict[int, list[int]] = {}
    for number, fields in _stats():
        children.setdefault(int(fields[_PARENT]), []).append(number)
    found, left = [], [pid]
    while left:
        left += children.get(number := left.pop(), [])
        found.append(number)
    return found[1:]


def resident(pids: Iterable[int]) -> int | None:
    """Bytes of memory that processes hold together; what they share is counted for each."""
    page = os.sysconf("SC_PAGE_SIZE") if hasattr(os, "sysconf") else 0
    held = [int(fields[_PAGES]) * page for pid in set(pids) if (fields := stat(pid))]
    return sum(held) if held else None


def _stats() -> Iterator[tuple[int, list[str]]]:
    with suppress(OSError):
        for entry in _PROCESSES.iterdir():
            if entry.name.isdecimal() and (fields := stat(int(entry.name))):
                yield int(entry.name), fields
