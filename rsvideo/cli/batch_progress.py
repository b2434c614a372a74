"""How far a batch is: bars on a terminal, lines for a machine, silence anywhere else."""

import contextlib
import dataclasses
import json
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from rsvideo.cli.terminal import say
from rsvideo.config.printable import printable

if TYPE_CHECKING:
    from rsvideo.batch.run import Event


@contextlib.contextmanager
def shown(how: Literal["auto", "jsonl", "none"]) -> "Iterator[Callable[[Event], None]]":
    """A function that takes each event of the run."""
    if how == "jsonl":
        yield _line
    elif how == "none" or not sys.stderr.isatty():
        yield _remark
    else:
        with _bars() as show:
            yield show


def clock(seconds: float) -> str:
    """Hours, minutes and seconds."""
    return f"{seconds // 3600:.0f}:{seconds // 60 % 60:02.0f}:{seconds % 60:02.0f}"


def _line(event: "Event") -> None:
    print(json.dumps(dataclasses.asdict(event)), flush=True)


def _remark(event: "Event") -> None:
    if words := _words(event):
        say(words)


def _words(event: "Event") -> str | None:
    """What the user should know even where no bar is shown."""
    return f"{event.output}: {event.words}" if event.event in ("resumed", "retry", "failed") else None


@contextlib.contextmanager
def _bars() -> "Iterator[Callable[[Event], None]]":
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TaskID, TextColumn

    columns = (
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TextColumn("{task.fields[left]}"),
    )
    console = Console(file=sys.__stderr__)
    with Progress(*columns, console=console, transient=True) as progress:
        batch = progress.add_task("batch", total=1.0, left="")
        clips: dict[str, TaskID] = {}

        def show(event: "Event") -> None:
            if words := _words(event):
                console.print(printable(f"rsvideo: {words}"), markup=False, highlight=False, soft_wrap=True)
            left = "" if event.seconds_left is None else f"{clock(event.seconds_left)} left"
            progress.update(batch, completed=event.done / max(1, event.frames), left=left)
            if event.event in ("finished", "failed"):
                if (task := clips.pop(event.output, None)) is not None:
                    progress.remove_task(task)
            elif event.event in ("stage", "frame"):
                if event.output not in clips:
                    clips[event.output] = progress.add_task("", total=1.0, left="")
                frame = "" if event.frame is None else f"frame {event.frame}, "
                stage = printable(f"{Path(event.output).name}: {frame}{event.words}")
                progress.update(clips[event.output], description=stage, completed=event.fraction)

        yield show
