"""The loops that take longest to compile, compiled by a process of their own while a new installation's first frame is begun."""

import os
import subprocess
import sys
import threading
from pathlib import Path

import numpy as np

from rsvideo import threads
from rsvideo.solvers import collaborative_filter
from rsvideo.solvers.collaborative_filter import PATCH, Matches, denoise, match

LIMIT = 120.0  # s, after which that process gives up
_PROGRAM = "from rsvideo.solvers import ahead; ahead.compile_denoiser()"
_begun: list["subprocess.Popen[bytes]"] = []  # kept, since Python warns of processes that are forgotten while they run


def begin() -> None:
    """Have the denoiser's loops compiled on another core, where there is one and none has compiled them yet."""
    if _begun or threads.most() == 1 or compiled() or not sys.executable:
        return
    nothing = subprocess.DEVNULL
    words = [sys.executable, "-P", "-c", _PROGRAM]
    _begun.append(subprocess.Popen(words, stdin=nothing, stdout=nothing, stderr=nothing, start_new_session=True))


def compiled() -> bool:
    """Whether numba's cache holds the denoiser's loops as they are now."""
    source = Path(collaborative_filter.__file__)
    kept = Path(collaborative_filter._filter.stats.cache_path).glob(f"{source.stem}._filter-*.nbi")  # pyright: ignore[reportFunctionMemberAccess]
    return any(index.stat().st_mtime >= source.stat().st_mtime for index in kept)


def compile_denoiser() -> None:
    """What takes longest first: whoever needs it meanwhile compiles the rest."""
    watch = threading.Timer(LIMIT, os._exit, (1,))
    watch.daemon = True
    watch.start()
    image, lone = np.zeros((PATCH, PATCH, 1), np.float32), np.zeros((1, 1, 1, 2), np.int8)
    denoise(image, 1.0, matches=Matches(shape=(PATCH, PATCH), offsets=lone))
    match(image)
