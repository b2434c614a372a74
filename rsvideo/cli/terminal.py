"""What reaches the terminal: lines of words in which nothing acts, whoever chose the names and the metadata in them."""

import io
import os
import sys

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
    sys.stdout, sys.stderr = (
        _Printable(
            open(number, "wb", closefd=False),  # noqa: SIM115 # as long as the process lives
            encoding=stream.encoding,
            errors="backslashreplace",
            line_buffering=stream.line_buffering,
            write_through=stream.write_through,
        )
        for number, stream in ((1, sys.stdout), (2, sys.stderr))
        if isinstance(stream, io.TextIOWrapper)
    )


def say(words: str) -> None:
    """A line for a person."""
    print(f"rsvideo: {printable(words)}", file=sys.stderr)


def last_words(words: str) -> None:
    """Why the command ends, if anybody is left to read it: after a SIGHUP the terminal may be gone."""
    try:
        say(words)
        sys.stderr.flush()
    except OSError:
        with open(os.devnull, "wb") as nowhere:  # noqa: PTH123 # where the interpreter can flush what it could not print
            os.dup2(nowhere.fileno(), 2)
