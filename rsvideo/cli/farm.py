"""rsvideo chunks, work and finish: a job in numbered parts for render farms and clusters, which call commands."""

import tempfile
from pathlib import Path
from typing import Annotated

from typer import Option

from rsvideo.cli.batches import Job, Jobs, Overwrite, Shown, carried_out, opened, ours, plans_of, print_json, read
from rsvideo.cli.exit_codes import Code, note, refusing
from rsvideo.cli.terminal import say
from rsvideo.cli.validate import Sets
from rsvideo.config import placing


def chunks(path: Job, sets: Sets = None, overwrite: Overwrite = False) -> int:
    """Cut a job's clips into chunks, and list them as JSON, by the numbers that rsvideo work takes.

    Exit codes: 0 all are cut; 2 the request is wrong; 3 a source is damaged or missing, the others are cut; 4 a result exists.
    """
    from rsvideo.batch import farm, plan
    from rsvideo.cli import quiet

    batch = read(path, sets, overwrite=overwrite)
    with opened(batch) as book:
        plans = plans_of(batch, ours(batch, book))
        with refusing(), quiet.c_libraries():
            cut = farm.laid_out(batch, plans)
    for each in plans:
        if isinstance(each, plan.Planned):
            note(f"{each.source}: {words}" for words in each.notes)
        else:
            say(each.fault)
    print_json(farm.values(cut, batch))
    return Code.DONE if len(cut.parts) == len(plans) else Code.UNREADABLE


def work(
    path: Job,
    wanted: Annotated[str, Option("--chunks", metavar="NUMBERS", help="Such as 3, 3-17 or 3,5-7; rsvideo chunks lists them.")],
    jobs: Jobs = 1,
    sets: Sets = None,
) -> int:
    """Restore chunks of a job, for rsvideo finish; any number of machines may do so at the same time.

    Exit codes: 0 all are done; 1 one failed; 2 the request is wrong; 3 a source is damaged or missing.
    """
    from rsvideo.batch import farm, workers
    from rsvideo.cli import quiet

    batch = read(path, sets, overwrite=True)  # nothing gets a name here
    faults = []
    with placing.aside(Path(tempfile.gettempdir())) as folder:
        with refusing(), quiet.c_libraries():
            orders = farm.orders(batch.working_in(folder), farm.layout(batch, path), farm.numbers(wanted))
        with workers.crew(most=jobs, quiet=quiet.wanted()) as crew:
            for number, fault in farm.restored(orders, crew, folder):
                if fault is not None:
                    faults.append(fault)
                    say(f"chunk {number} failed: {fault.words}")
    if not faults:
        return Code.DONE
    return Code.UNREADABLE if all(fault.unreadable for fault in faults) else Code.FAILED


def finish(
    path: Job,
    jobs: Jobs = 1,
    sets: Sets = None,
    progress: Shown = "auto",
    overwrite: Overwrite = False,
    json: Annotated[bool, Option("--json", help="Print the result as JSON on standard output.")] = False,
) -> int:
    """Make the results of a job whose chunks rsvideo work has restored.

    Exit codes: as of rsvideo run; 3 also where chunks are missing.
    """
    from rsvideo.batch import farm, status, workers
    from rsvideo.cli import quiet

    batch = read(path, sets, overwrite=overwrite)
    with opened(batch) as book, status.noted(batch, path, workers=jobs, scheduler=None) as recorder:
        with refusing(), quiet.c_libraries():
            cut = farm.layout(batch, path)
            plans = farm.planned(batch, cut, ours(batch, book))
        with workers.crew(most=jobs, quiet=quiet.wanted()) as crew:
            hands = farm.Finishers(cut, crew)
            code = carried_out(batch, book, plans, hands, recorder, progress=progress, json=json)
    if hands.missing:
        numbers = farm.written(hands.missing)
        say(f"chunks {numbers} are missing; rsvideo work {path} --chunks {numbers} restores them")
    return code
