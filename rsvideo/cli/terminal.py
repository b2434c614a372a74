"""What reaches the terminal: lines of words in which nothing acts, whoever chose the names and the metadata in them."""

import io
import os
import sys
from typing import TextIO

from rsvideo.config.printable import printable

_LAYOUT = "\n\t"  # what may stand between words


class _Printable(io.TextIOWrapper):
    """A text stream that writes out control characters."""

    def write(self, text: str, /) -> int:
        super().write(printable(text, keep=_LAYOUT))
        return len(text)


def guard() -> None:
    """Let nothing but text, laid out in lines, reach standard output and standard error.

    Bars, which move the cursor, draw on `sys.__stderr__`, and have to write out themselves what is not theirs.
    """
    sys.stdout, sys.stderr = _guarded(1, sys.stdout), _guarded(2, sys.stderr)


def _guarded(number: int, stream: TextIO | None) -> TextIO:
    """The stream of a descriptor, guarded; one that was closed before the command began leads nowhere, and no file gets its number."""
    if stream is None:
        os.dup2(os.open(os.devnull, os.O_WRONLY), number)
        return open(number, "w", encoding="utf-8", closefd=False)
    if not isinstance(stream, io.TextIOWrapper):
        return stream
    return _Printable(
        open(number, "wb", closefd=False),
        encoding=stream.encoding,
        errors="backslashreplace",
        line_buffering=stream.line_buffering,
        write_through=stream.write_through,
    )


def say(words: str) -> None:
    """A line for a person."""
    print(f"rsvideo: {printable(words)}", file=sys.stderr)


def flush() -> None:
    """Hand over what is left of standard output; OSError."""
    try:
        sys.stdout.flush()
    except OSError as error:
        raise OSError(error.errno, error.strerror, "standard output") from error


def last_words(words: str) -> None:
    """Why the command ends, if anybody is left to read it: after a SIGHUP the terminal may be gone."""
    try:
        say(words)
        sys.stderr.flush()
    except OSError:
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 # where the interpreter can flush what it could not print
            os.dup2(nowhere.fileno(), 2)
