"""rsvideo validate and rsvideo schema: what a job's file may say, and whether it does."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

from rsvideo.cli.exit_codes import refusing
from rsvideo.cli.terminal import say
from rsvideo.config.printable import printable

Sets = Annotated[
    list[str] | None,
    Option("--set", metavar="SECTION.KEY=VALUE", help="Over what the file says, for all it lists: camera.exposure=1/100."),
]


def validate(
    path: Annotated[Path, typer.Argument(metavar="JOB.yaml", help="A file for rsvideo run.")],
    sets: Sets = None,
) -> None:
    """Check a job's file and print which source becomes which result; they are not opened (run --dry-run does that)."""
    with refusing():
        from rsvideo.batch import plan

        batch = plan.read(path, sets or ())
    for item in batch.items:
        print(f"{printable(item.source)}\t{printable(item.output)}")
    say(f"{path} is valid: {counted([item.request.is_clip for item in batch.items])}")


def counted(clips: Sequence[bool]) -> str:
    """How many clips and photographs there are, `clips` saying of each whether it is a clip."""
    numbers = {"clip": sum(clips), "photograph": len(clips) - sum(clips)}
    return " and ".join(some(number, kind) for kind, number in numbers.items() if number)


def some(number: int, thing: str) -> str:
    """1 clip, 2 clips."""
    return f"{number} {thing}{'' if number == 1 else 's'}"


def schema() -> None:
    """Print the JSON Schema of a job's file, by which editors complete and check it."""
    import json

    from rsvideo.batch.job import JobFile

    print(json.dumps(JobFile.model_json_schema(), indent=1))
