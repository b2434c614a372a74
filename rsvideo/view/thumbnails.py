"""Small pictures for lists, made when a page shows their place, and kept as long as there is room."""

import threading
from pathlib import Path

from rsvideo.view import glance
from rsvideo.view.child import Child
from rsvideo.view.drawing import File
from rsvideo.view.glance import OneFrame, Thumbnail

MOST_BYTES = 64_000_000
_SECONDS = 15.0  # that one may take

Key = tuple[Path, int, int, int, int]


class Album:
    """Pictures by file, time of its last change, its size, frame and side."""

    def __init__(self, child: Child) -> None:
        self._child, self._lock = child, threading.Lock()
        self._kept: dict[Key, File] = {}
        self._bytes = 0

    def thumbnail(self, path: Path, side: int) -> File:
        """The first picture of a clip or photograph; raises FailedError."""
        return self._picture(path, -1, side, Thumbnail(path=path, side=side), _SECONDS)

    def frame(self, path: Path, index: int, side: int) -> File:
        """One frame; raises FailedError."""
        return self._picture(path, index, side, OneFrame(path=path, index=index, side=side), glance.SECONDS)

    def _picture(self, path: Path, index: int, side: int, order: Thumbnail | OneFrame, seconds: float) -> File:
        stat = path.stat()
        key = path, stat.st_mtime_ns, stat.st_size, index, side
        with self._lock:
            if (held := self._kept.pop(key, None)) is not None:
                self._kept[key] = held  # the latest last
                return held
        made: File = self._child.one(order, seconds=seconds)
        with self._lock:
            self._kept[key] = made
            self._bytes += len(made[1])
            while self._bytes > MOST_BYTES:
                self._bytes -= len(self._kept.pop(next(iter(self._kept)))[1])
        return made
