"""Memory that is freed is kept for the next array, not given back to the system.

A frame's work makes and frees the same few hundred arrays of some MB again and again. The allocator of glibc gives such arrays back at
once, and the system then finds and clears new pages for each, which takes longer than most of what is computed in them.

Python searches all objects for what nothing refers to whenever enough new ones are there. What libraries leave as they are loaded
is no garbage, and there is much of it.
"""

import ctypes
import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager

_TRIM_THRESHOLD, _MMAP_MAX, _ARENA_MAX = -1, -4, -8  # the names of glibc's mallopt
_NEVER = 2**31 - 1  # bytes


def keep_freed_memory() -> None:
    """Of this process, from now on; to be called before its first thread is started. Nothing happens under an allocator without mallopt."""
    if sys.platform != "linux" or (choose := getattr(ctypes.CDLL(None), "mallopt", None)) is None:
        return
    choose(_TRIM_THRESHOLD, _NEVER)
    choose(_MMAP_MAX, 0)  # large arrays come from the same memory as small ones
    choose(_ARENA_MAX, 1)  # and those of all threads from one


@contextmanager
def nothing_collected() -> Iterator[None]:
    """While libraries are loaded, which is a fifth faster so."""
    gc.disable()
    try:
        yield
    finally:
        gc.enable()
