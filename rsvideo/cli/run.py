"""rsvideo run: a file that lists clips, photographs and settings in, restored ones out."""

import contextlib
import shutil
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
from rsvideo.cli.validate import Sets, counted, some
from rsvideo.config.printable import printable

if TYPE_CHECKING:
    from rsvideo.batch.ledger import Ledger
    from rsvideo.batch.plan import Batch, Planned, Unreadable
    from rsvideo.batch.run import Event, Result
    from rsvideo.batch.status import Recorder
    from rsvideo.batch.workers import Hands
    from rsvideo.config.request import Request
    from rsvideo.pipeline.pieces import Chunk


Job = Annotated[Path, typer.Argument(metavar="JOB.yaml", help="Which clips and photographs, how they are treated, where results go.")]
Jobs = Annotated[int, Option("-j", "--jobs", metavar="N", min=1, max=MOST_JOBS, help="Worker processes; each may need 2 GB.")]
Shown = Annotated[
    Literal["auto", "jsonl", "none"],
    Option("--progress", help="jsonl: one JSON object a line on standard output, the last one the result."),
]
Overwrite = Annotated[bool, Option("--overwrite", help="Replace results that exist.")]
CANCELLED = 143  # as SIGTERM ends it, though the wish came by a file


def run(
    path: Job,
    jobs: Jobs = 1,
    sets: Sets = None,
    dry_run: Annotated[bool, Option("--dry-run", help="Print what would be done, and do nothing.")] = False,
    resume: Annotated[bool, Option("--resume/--fresh", help="Go on where an earlier run ended, or forget it.")] = True,
    progress: Shown = "auto",
    overwrite: Overwrite = False,
    json: Annotated[bool, Option("--json", help="Print the plan, or the result, as JSON on standard output.")] = False,
    scheduler: Annotated[
        str | None,
        Option(metavar="ADDRESS", help="Of dask.distributed, whose workers restore: tcp://HOST:8786; local starts N workers here."),
    ] = None,
) -> int:
    """Restore the clips and photographs that a job's file lists.

    What is done is kept beside the results until all is: the same command goes on after an interruption.

    Exit codes: 0 all done; 1 one failed; 2 the request is wrong; 3 a source is damaged or missing; 4 a result exists;
    5 done, but more frames failed than report.most_failed_frames.
    """
    from rsvideo.batch import plan, status
    from rsvideo.cli import quiet

    batch = read(path, sets, overwrite=overwrite)
    if dry_run and not batch.working.exists():
        with made(batch.folder):
            return _print_plan(batch, lambda _: False, json=json)
    with opened(batch, fresh=not resume and not dry_run) as book:
        if dry_run:
            return _print_plan(batch, ours(batch, book), json=json)
        with status.noted(batch, path, workers=jobs, scheduler=scheduler) as recorder, _hands(batch, scheduler, jobs) as crew:
            with refusing(), quiet.c_libraries():
                plans = plan.settled(batch, ours(batch, book))
            return carried_out(batch, book, plans, crew, recorder, progress=progress, json=json)


@contextlib.contextmanager
def _hands(batch: "Batch", scheduler: str | None, jobs: int) -> "Iterator[Hands]":
    """Workers on this machine, or those of a cluster."""
    from rsvideo.cli import quiet

    with contextlib.ExitStack() as stack:
        if scheduler is None:
            from rsvideo.batch import workers

            yield stack.enter_context(workers.crew(most=jobs, quiet=quiet.wanted()))
            return
        from rsvideo.batch import cluster

        requests = [item.request for item in batch.items]
        with refusing():
            opened = cluster.opened(scheduler, batch.working, requests, jobs=jobs, tell=say, quiet=quiet.wanted())
            hands = stack.enter_context(opened)
        yield hands


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
        yield book


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
            note(f"{each.request.source}: {words}" for words in each.notes)
    recorder.planned(plans)
    try:
        with batch_progress.shown(progress) as show:
            results = carry_out(plans, book, hands, _both(recorder.take, show))
    except CancelledError:
        say(f"cancelled by whoever watches it; {_kept(book)}")
        recorder.ended(CANCELLED, "cancelled")
        return CANCELLED
    except Stopped as error:
        recorder.ended(128 + error.number, f"stopped by {signal.Signals(error.number).name}")
        last_words(f"stopped by {signal.Signals(error.number).name}; {_kept(book)}")
        return 128 + error.number
    except ClusterError as error:
        say(f"{error}; {_kept(book)}")
        recorder.ended(Code.FAILED, str(error))
        return Code.FAILED
    except OSError as error:
        words = f"{error.filename or 'a file'} could not be written: {error.strerror or error}"
        say(f"{words}; {_kept(book)}")
        recorder.ended(Code.FAILED, words)
        return Code.FAILED
    code = _code(results, batch.report.most_failed_frames)
    if json or progress == "jsonl":
        print_json({"event": "ended", "code": code, "clips": [vars(result) for result in results]})
    _print_table(results)
    if code == Code.WORSE:
        say(f"a clip has more failed frames than report.most_failed_frames allows, {batch.report.most_failed_frames}")
    if faults := sum(result.fault is not None for result in results):
        say(f"{faults} of {counted([item.request.is_clip for item in batch.items])} failed; {_kept(book)}")
    else:
        book.remove()
    recorder.ended(code)
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


def ours(batch: "Batch", book: "Ledger") -> "Callable[[Request], bool]":
    """Whether what stands under a request's names was written by this job."""
    from rsvideo.batch import recognition

    return lambda request: recognition.may_replace(request, batch.job, book)


def _print_plan(batch: "Batch", ours: "Callable[[Request], bool]", *, json: bool) -> int:
    from rsvideo.batch import plan
    from rsvideo.cli import quiet
    from rsvideo.cli.batch_progress import clock
    from rsvideo.cli.exit_codes import Code

    with refusing(), quiet.c_libraries():
        plans = [(each, plan.chunks(each) if isinstance(each, plan.Planned) else ()) for each in plan.settled(batch, ours)]
    planned = [each for each, _ in plans if isinstance(each, plan.Planned)]
    if json:
        print_json({"clips": [each.values(cuts) if isinstance(each, plan.Planned) else vars(each) for each, cuts in plans]})
    else:
        for each, cuts in plans:
            if isinstance(each, plan.Planned):
                _print_planned(each, cuts)
            else:
                print(f"{each.source} -> nothing: {each.fault}")
        seconds, size = sum(each.seconds for each in planned), sum(each.bytes for each in planned)
        free = shutil.disk_usage(batch.folder).free
        print(f"in all about {clock(seconds)} of one worker, {size / 1e9:.2g} GB of disk; {free / 1e9:.2g} GB are free")
    return Code.DONE if len(planned) == len(plans) else Code.UNREADABLE


def _print_planned(each: "Planned", cuts: "Sequence[Chunk]") -> None:
    from rsvideo.cli.batch_progress import clock

    timing = each.timing
    shutter = f"exposure {1e3 * timing.exposure:.4g} ms, readout {1e3 * timing.readout:.4g} ms {timing.direction}"
    chunks = f", in chunks {', '.join(f'{cut.first}-{cut.last}' for cut in cuts)}"
    print(f"{each.request.source} -> {each.request.output}")
    if each.request.is_clip:
        print(f"  {each.frames} frames of {each.cols} x {each.rows}{chunks}")
    else:
        print(f"  a photograph of {each.cols} x {each.rows}")
    print(f"  {shutter} ({each.timing_source})")
    print(f"  about {clock(each.seconds)} of one worker, {each.bytes / 1e9:.2g} GB of disk while it lasts")
    print("".join(f"  note: {words}\n" for words in each.notes), end="")


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
