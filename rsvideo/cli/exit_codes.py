"""How the command ends: an exit code, and one line that says why."""

import atexit
import contextlib
import enum
import os
import signal
import sys
from collections.abc import Iterable, Iterator
from types import FrameType

from rsvideo.cli.terminal import say
from rsvideo.config.files import UnreachableError, UnreadableError
from rsvideo.config.lock import BusyError
from rsvideo.config.placing import SIGNALS

_SOON = 0.002  # seconds after which a signal is tried again that came where it may not raise
_SIGPIPE = 13  # by which other programs end whose reader has gone; not every system names it


class Code(enum.IntEnum):
    """Exit codes; a signal ends with 128 and its number."""

    DONE = 0
    FAILED = 1  # while working
    USAGE = 2
    UNREADABLE = 3  # input missing, damaged or of the wrong kind
    EXISTS = 4  # output, and --overwrite was not given
    WORSE = 5  # done, but with more failed frames than allowed


class GoneError(Exception):
    """The reader of standard output has gone; no OSError, whose number typer takes for an end without a word."""


class RefusedError(Exception):
    """The request contradicts itself or a rule."""


class Stopped(BaseException):  # not an error, and no handler of errors may catch it
    """The user, or the machine, stopped the work."""

    def __init__(self, number: int) -> None:
        super().__init__(number)
        self.number = number


class LastExit:
    """Ends the process with `code` after all else that is to happen at its end; make it first.

    Python does not take itself down: a thread that comes back to it meanwhile from C++, such as OpenCV's, would abort it.
    """

    def __init__(self) -> None:
        self.code: int = Code.FAILED
        atexit.register(self._leave)

    def _leave(self) -> None:
        for stream in (sys.stdout, sys.stderr):
            with contextlib.suppress(OSError):
                stream.flush()
        os._exit(self.code)


def listen() -> None:
    """Turn the first signal to end into `Stopped`; a second one ends at once. One that is ignored, as under nohup, stays so."""
    for number in SIGNALS:
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)


def _stop(number: int, frame: FrameType | None) -> None:
    if frame is not None and _is_made_up(frame) and hasattr(signal, "setitimer"):
        signal.signal(signal.SIGALRM, lambda _, later: _stop(number, later))
        signal.setitimer(signal.ITIMER_REAL, _SOON)
        return
    signal.signal(number, signal.SIG_DFL)
    raise Stopped(number)


def _is_made_up(frame: FrameType) -> bool:
    """Whether a compiled module, such as PyAV's, just runs this frame to give a traceback a line; it forgets what is raised there."""
    return "__name__" not in frame.f_globals


@contextlib.contextmanager
def refusing() -> Iterator[None]:
    """Every fault of a request becomes one line, and the exit code of a wrong request."""
    try:
        yield
    except UnreadableError:
        raise
    except UnreachableError as error:
        raise RefusedError(f"{error.filename} cannot be used: {error.strerror}") from error
    except ValueError as error:
        *others, last = getattr(error, "faults", (str(error),))  # a file of settings may have several
        for fault in others:
            say(fault)
        raise RefusedError(last) from error


def note(notes: Iterable[str]) -> None:
    """What the user should know beside the result, a line each."""
    for each in notes:
        say(f"note: {each}")


def code_and_line(error: BaseException) -> tuple[int, str]:
    """The exit code for what went wrong, and the line that says so."""
    code, words = _code_and_words(_origin(error))
    return code, " ".join(words.split())


def _origin(error: BaseException) -> BaseException:
    """A signal that comes while a compiled kernel is called is reported by numba as a SystemError; the signal is what counts."""
    cause = error.__cause__ or error.__context__
    return cause if isinstance(error, SystemError) and isinstance(cause, Stopped) else error


def _code_and_words(error: BaseException) -> tuple[int, str]:
    match error:
        case Stopped():
            result = "; ".join(getattr(error, "__notes__", ())) or "nothing was written"
            return 128 + error.number, f"stopped by {signal.Signals(error.number).name}; {result}"
        case RefusedError():
            return Code.USAGE, str(error)
        case UnreadableError():
            return Code.UNREADABLE, str(error)
        case FileExistsError():
            return Code.EXISTS, str(error)
        case BusyError():
            return Code.FAILED, str(error)
        case MemoryError():
            return Code.FAILED, "memory ran out; is there room for about 1.5 GB at 2 megapixels? a crop needs less"
        case GoneError():
            return 128 + _SIGPIPE, str(error)
        case OSError():
            return Code.FAILED, f"{error.filename or 'a file'} could not be written: {error.strerror or error}"
        case _ if hasattr(error, "format_message"):  # what typer raises for a command line it cannot parse
            words = str(error.format_message()).replace("Value error, ", "")  # pyright: ignore[reportAttributeAccessIssue]
            return Code.USAGE, f"{words} (rsvideo --help lists what there is)"
        case _:
            return Code.FAILED, f"failed while working: {type(error).__name__}: {error} (RSVIDEO_DEBUG=1 shows where)"
