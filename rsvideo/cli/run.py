"""rsvideo run: a file that lists clips, photographs and settings in, restored ones out."""

import contextlib
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from typer import Option

from rsvideo.cli.batches import Job, Jobs, Overwrite, Shown, carried_out, made, opened, ours, plans_of, print_json, read
from rsvideo.cli.exit_codes import refusing
from rsvideo.cli.terminal import say
from rsvideo.cli.validate import Sets

if TYPE_CHECKING:
    from rsvideo.batch.plan import Batch, Item, Planned, Unreadable
    from rsvideo.batch.workers import Hands
    from rsvideo.pipeline.pieces import Chunk


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
    from rsvideo.batch import status

    batch, bar = read(path, sets, overwrite=overwrite), progress == "auto"
    if dry_run:
        with _replaceable(batch) as own, _hands(batch, None, jobs) as crew:
            return _print_plan(plans_of(batch, own, crew if jobs > 1 else None, bar=bar), batch.folder, json=json)
    with (
        opened(batch, fresh=not resume) as book,
        status.noted(batch, path, workers=jobs, scheduler=scheduler) as recorder,
        _hands(batch, scheduler, jobs) as crew,
    ):
        plans = plans_of(batch, ours(batch, book), crew if jobs > 1 and scheduler is None else None, bar=bar)
        return carried_out(batch, book, plans, crew, recorder, progress=progress, json=json)


@contextlib.contextmanager
def _replaceable(batch: "Batch") -> "Iterator[Callable[[Item], bool]]":
    """Whether what stands under an item's names was written by this job, for a plan that leaves nothing behind."""
    if batch.working.exists():
        with opened(batch) as book:
            yield ours(batch, book)
    else:
        with made(batch.folder):
            yield lambda _: False


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

        with refusing():
            opened = cluster.opened(scheduler, batch, jobs=jobs, tell=say, quiet=quiet.wanted())
            hands = stack.enter_context(opened)
        yield hands


def _print_plan(plans: "Sequence[Planned | Unreadable]", folder: Path, *, json: bool) -> int:
    from rsvideo.batch import plan
    from rsvideo.cli import quiet
    from rsvideo.cli.batch_progress import clock
    from rsvideo.cli.exit_codes import Code

    with refusing(), quiet.c_libraries():
        parts = [(each, plan.chunks(each) if isinstance(each, plan.Planned) else ()) for each in plans]
    planned = [each for each in plans if isinstance(each, plan.Planned)]
    if json:
        print_json({"clips": [each.values(cuts) if isinstance(each, plan.Planned) else vars(each) for each, cuts in parts]})
    else:
        for each, cuts in parts:
            if isinstance(each, plan.Planned):
                _print_planned(each, cuts)
            else:
                print(f"{each.source} -> nothing: {each.fault}")
        seconds, size = sum(each.seconds for each in planned), sum(each.bytes for each in planned)
        free = shutil.disk_usage(folder).free
        print(f"in all about {clock(seconds)} of one worker, {size / 1e9:.2g} GB of disk; {free / 1e9:.2g} GB are free")
    return Code.DONE if len(planned) == len(plans) else Code.UNREADABLE


def _print_planned(each: "Planned", cuts: "Sequence[Chunk]") -> None:
    from rsvideo.cli.batch_progress import clock

    timing = each.timing
    shutter = f"exposure {1e3 * timing.exposure:.4g} ms, readout {1e3 * timing.readout:.4g} ms {timing.direction}"
    chunks = f", in chunks {', '.join(f'{cut.first}-{cut.last}' for cut in cuts)}"
    print(f"{each.source} -> {each.output}")
    if each.request.is_clip:
        print(f"  {each.frames} frames of {each.cols} x {each.rows}{chunks}")
    else:
        print(f"  a photograph of {each.cols} x {each.rows}")
    print(f"  {shutter} ({each.timing_source})")
    print(f"  about {clock(each.seconds)} of one worker, {each.bytes / 1e9:.2g} GB of disk while it lasts")
    print("".join(f"  note: {words}\n" for words in each.notes), end="")
