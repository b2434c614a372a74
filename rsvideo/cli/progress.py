"""A bar on the terminal while long work runs; silence anywhere else, and of the libraries."""

import contextlib
from collections.abc import Iterator

from rsvideo.cli import quiet
from rsvideo.config.printable import printable
from rsvideo.progress import Observer, Progress, ignore


@contextlib.contextmanager
def progress_bar(*, shown: bool = True) -> Iterator[Observer]:
    """Shows the stage and how much of the whole work is done.

    Print nothing else meanwhile: say it before or afterwards.
    """
    with quiet.c_libraries() as terminal:
        if not (shown and terminal.isatty()):
            yield ignore
            return
        from rich.console import Console
        from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as Bar

        columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"), TimeElapsedColumn()
        with Bar(*columns, console=Console(file=terminal), transient=True) as bar:
            task = bar.add_task("starting", total=1.0)

            def observe(at: Progress) -> None:
                bar.update(task, description=printable(at.stage), completed=at.fraction)

            yield observe
