"""What rsvideo run and the verbs of farms share: a job's options, its batch and ledger, and the words on what became of it."""

import contextlib
import signal
import sys
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from typer import Option

from rsvideo.cli.exit_codes import note, refusing
from rsvideo.cli.options import MOST_JOBS
from rsvideo.cli.terminal import last_words, say
from rsvideo.cli.validate import counted, some
from rsvideo.config.printable import printable

if TYPE_CHECKING:
    from rsvideo.batch.ledger import Ledger
    from rsvideo.batch.plan import Batch, Item, Planned, Unreadable
    from rsvideo.batch.run import Event, Result
    from rsvideo.batch.status import Recorder
    from rsvideo.batch.workers import Hands

Job = Annotated[Path, typer.Argument(metavar="JOB.yaml", help="Which clips and photographs, how they are treated, where results go.")]
Jobs = Annotated[int, Option("-j", "--jobs", metavar="N", min=1, max=MOST_JOBS, help="Worker processes; each may need 2 GB.")]
Shown = Annotated[
    Literal["auto", "jsonl", "none"],
    Option("--progress", help="jsonl: one JSON object a line on standard output, the last one the result."),
]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace results that exist.")]
CANCELLED = 143  # as SIGTERM ends it, though the wish came by a file


def read(path: Path, sets: "Sequence[str] | None", *, overwrite: bool) -> "Batch":
    """The batch in a job's file."""
    with refusing():
        from rsvideo.batch import plan

        return plan.read(path, sets or (), overwrite=overwrite)


@contextlib.contextmanager
def opened(batch: "Batch", *, fresh: bool = False) -> "Iterator[Ledger]":
    """The job's ledger, in the folder of the results, with what there is to say of it; raises BusyError."""
    from rsvideo.batch import ledger

    with made(batch.folder), ledger.opened(batch.working, fresh=fresh) as (book, notes):
        note(notes)
        with refusing():
            batch.results.check_writable()
            if fresh:
                batch.stores.remove()
        yield book


def plans_of(
    batch: "Batch", ours: "Callable[[Item], bool]", hands: "Hands | None" = None, *, bar: bool = True
) -> "list[Planned | Unreadable]":
    """What each item comes to, with a bar meanwhile: to measure a clip takes seconds. Hands measure several at a time."""
    from rsvideo.batch import plan, workers
    from rsvideo.cli.progress import progress_bar

    with refusing(), progress_bar(shown=bar) as observe:
        found = workers.found(plan.clips(batch), hands, observe) if hands else {}
        return plan.settled(batch, ours, found, observe)


def carried_out(
    batch: "Batch",
    book: "Ledger",
    plans: "Sequence[Planned | Unreadable]",
    hands: "Hands",
    recorder: "Recorder",
    *,
    progress: Literal["auto", "jsonl", "none"],
    json: bool,
) -> int:
    """Carry a plan out, print what became of it, and answer with the exit code."""
    from rsvideo.batch import plan
    from rsvideo.batch.control import CancelledError
    from rsvideo.batch.run import carry_out
    from rsvideo.batch.workers import ClusterError
    from rsvideo.cli import batch_progress
    from rsvideo.cli.exit_codes import Code, Stopped

    for each in plans:
        if isinstance(each, plan.Planned):
            note(f"{each.source}: {words}" for words in each.notes)
    recorder.planned(plans)

    def ended(code: int, words: str = "") -> int:
        recorder.ended(code, words)
        return code

    try:
        with batch_progress.shown(progress) as show:
            results = carry_out(plans, book, hands, _both(recorder.take, show))
    except CancelledError:
        say(f"cancelled by whoever watches it; {_kept(book)}")
        return ended(CANCELLED, "cancelled")
    except Stopped as error:
        ended(128 + error.number, f"stopped by {signal.Signals(error.number).name}")
        last_words(f"stopped by {signal.Signals(error.number).name}; {_kept(book)}")
        return 128 + error.number
    except ClusterError as error:
        say(f"{error}; {_kept(book)}")
        return ended(Code.FAILED, str(error))
    except OSError as error:
        words = f"{error.filename or 'a file'} could not be written: {error.strerror or error}"
        say(f"{words}; {_kept(book)}")
        return ended(Code.FAILED, words)
    code = ended(_code(results, batch.report.most_failed_frames))
    if json or progress == "jsonl":
        print_json({"event": "ended", "code": code, "clips": [vars(result) for result in results]})
    _print_table(results)
    if code == Code.WORSE:
        say(f"a clip has more failed frames than report.most_failed_frames allows, {batch.report.most_failed_frames}")
    if faults := sum(result.fault is not None for result in results):
        say(f"{faults} of {counted([item.request.is_clip for item in batch.items])} failed; {_kept(book)}")
    else:
        with contextlib.suppress(OSError):  # all is done, even where nothing more can be tidied
            batch.stores.remove()
        book.remove()
    return code


def _both(one: "Callable[[Event], None]", other: "Callable[[Event], None]") -> "Callable[[Event], None]":
    """A function that tells both of each event."""

    def tell(event: "Event") -> None:
        one(event)
        other(event)

    return tell


def _code(results: "Sequence[Result]", most_failed_frames: int) -> int:
    from rsvideo.cli.exit_codes import Code

    if faults := [result for result in results if result.fault is not None]:
        return Code.UNREADABLE if all(fault.unreadable for fault in faults) else Code.FAILED
    return Code.WORSE if any(result.failed > most_failed_frames for result in results) else Code.DONE


@contextlib.contextmanager
def made(folder: Path) -> Iterator[None]:
    """The folder of the results; it goes again if nothing came of it."""
    from rsvideo.cli.exit_codes import RefusedError

    there = folder.is_dir()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise RefusedError(f"the folder {folder} of the results must be writable: {error.strerror}; is output.folder right?") from error
    try:
        yield
    finally:
        if not there:
            with contextlib.suppress(OSError):
                folder.rmdir()


def ours(batch: "Batch", book: "Ledger") -> "Callable[[Item], bool]":
    """Whether what stands under an item's names was written by this job."""
    from rsvideo.batch import recognition

    return lambda item: recognition.may_replace(item, batch.job, book)


def _print_table(results: "Sequence[Result]") -> None:
    rows = [("clip", "restored", "left", "failed", "seconds", "output")]
    for result in results:
        if result.fault is None:
            counts = str(result.restored), str(result.left), str(result.failed), f"{result.seconds:.1f}"
            rows.append((result.source, *counts, result.output))
        else:
            rows.append((result.source, "-", "-", "-", "-", result.fault))
    widths = [max(len(row[column]) for row in rows) for column in range(5)]
    for clip, *counts, output in rows:
        cells = [clip.ljust(widths[0]), *(count.rjust(width) for count, width in zip(counts, widths[1:], strict=True)), output]
        print(printable("  ".join(cells)), file=sys.stderr)
    for result in results:
        note(f"{result.source}: {words}" for words in result.notes)


def _kept(book: "Ledger") -> str:
    try:
        clips, chunks = book.counts()
    except OSError:
        return "what was done before is kept, the same command goes on from there"
    return f"{some(clips, 'clip')} and {some(chunks, 'chunk')} of others are kept, the same command goes on from there"


def print_json(values: object) -> None:
    """On one line, for a machine."""
    import json

    print(json.dumps(values, default=str), flush=True)
