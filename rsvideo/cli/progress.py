"""A bar on the terminal while long work runs; silence anywhere else, and of the libraries."""

import contextlib
from collections.abc import Callable, Iterator

from rsvideo.cli import quiet


@contextlib.contextmanager
def bar() -> Iterator[Callable[[str, float], None]]:
    """A function that takes the stage's name and the fraction of the whole work that is done.

    Nothing else is seen meanwhile: what is to be said is said before or afterwards.
    """
    with quiet.c_libraries() as terminal:
        if not terminal.isatty():
            yield lambda *_: None
            return
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

        columns = TextColumn("{task.description}"), BarColumn(), TextColumn("{task.percentage:3.0f} %"), TimeElapsedColumn()
        with Progress(*columns, console=Console(file=terminal), transient=True) as progress:
            task = progress.add_task("starting", total=1.0)
            yield lambda stage, fraction: progress.update(task, description=stage, completed=fraction)
