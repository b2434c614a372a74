"""rsvideo validate and rsvideo schema: what a job's file may say, and whether it does."""

import contextlib
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer
from typer import Option

Sets = Annotated[
    list[str] | None,
    Option("--set", metavar="SECTION.KEY=VALUE", help="Over what the file says, for all clips: camera.exposure=1/100."),
]


def validate(
    path: Annotated[Path, typer.Argument(metavar="JOB.yaml", help="A file for rsvideo run.")],
    sets: Sets = None,
) -> None:
    """Check a job's file and print which source becomes which result; the clips are not opened (run --dry-run does that)."""
    with refusing():
        from rsvideo.batch import plan

        batch = plan.read(path, sets or ())
    for request in batch.requests:
        print(f"{request.job.source}\t{request.job.output}")
    print(f"rsvideo: {path} is valid: {len(batch.requests)} clip{'s' * (len(batch.requests) != 1)}", file=sys.stderr)


def schema() -> None:
    """Print the JSON Schema of a job's file, by which editors complete and check it."""
    import json

    from rsvideo.batch.job import JobFile

    print(json.dumps(JobFile.model_json_schema(), indent=1))


@contextlib.contextmanager
def refusing() -> Iterator[None]:
    """Every fault of a request becomes one line, and the exit code of a wrong request."""
    from rsvideo.cli.exit_codes import RefusedError
    from rsvideo.config.files import UnreadableError
    from rsvideo.config.yaml import ConfigError

    try:
        yield
    except UnreadableError:
        raise
    except ConfigError as error:
        for fault in error.faults[:-1]:
            print(f"rsvideo: {fault}", file=sys.stderr)
        raise RefusedError(error.faults[-1]) from error
    except ValueError as error:
        raise RefusedError(str(error)) from error
