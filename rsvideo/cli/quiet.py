"""Keeps the libraries' own remarks off the user's terminal; RSVIDEO_DEBUG=1 lets them through."""

import contextlib
import logging
import os
import sys
import warnings
from collections.abc import Iterator
from typing import TextIO


def wanted() -> bool:
    """Whether the libraries are to be kept quiet: RSVIDEO_DEBUG is not set."""
    return os.environ.get("RSVIDEO_DEBUG") != "1"


def python_libraries() -> None:
    """Silence warnings and logging for good."""
    logging.getLogger().addHandler(logging.NullHandler())
    warnings.simplefilter("ignore")
    os.environ.setdefault("OPENCV_LOG_LEVEL", "SILENT")


@contextlib.contextmanager
def c_libraries() -> Iterator[TextIO]:
    """Silence what libpng, libtiff and LibRaw print about a damaged file: the command says it in its own line.

    Whatever must show meanwhile, such as a bar, is written to the stream that this yields.
    """
    if not wanted():
        yield sys.__stderr__ or sys.stderr
        return
    with open(os.devnull, "wb") as nowhere, open(os.dup(2), "w", encoding="utf-8") as terminal:  # noqa: PTH123 # the second is a descriptor
        os.dup2(nowhere.fileno(), 2)
        try:
            yield terminal
        finally:
            os.dup2(terminal.fileno(), 2)
