"""The front door: words to values, results to words; the one room that prints and exits.

Nothing heavy is imported here: each command loads what it needs when it is called.
"""

import os
import sys
from typing import Annotated

import typer

from rsvideo.cli.calibrate import calibrate
from rsvideo.cli.compare import compare
from rsvideo.cli.deblur import deblur
from rsvideo.cli.farm import chunks, finish, work
from rsvideo.cli.inspect import inspect
from rsvideo.cli.options import RequestCommand
from rsvideo.cli.plot import plot
from rsvideo.cli.run import run
from rsvideo.cli.simulate import simulate
from rsvideo.cli.track import track
from rsvideo.cli.validate import schema, validate
from rsvideo.cli.view import view

app = typer.Typer(add_completion=False, rich_markup_mode=None, context_settings={"help_option_names": ["-h", "--help"]})
app.add_typer(calibrate, name="calibrate")
app.command()(chunks)
app.command(cls=RequestCommand)(compare)
app.command(cls=RequestCommand)(deblur)
app.command()(finish)
app.command(cls=RequestCommand)(inspect)
app.command()(plot)
app.command()(run)
app.command()(schema)
app.command(cls=RequestCommand)(simulate)
app.command(cls=RequestCommand)(track)
app.command()(validate)
app.command()(view)
app.command()(work)


def _version(wanted: bool) -> bool:
    if wanted:
        from importlib.metadata import version

        print(f"rsvideo {version('rsvideo')}")
        raise typer.Exit
    return wanted


@app.callback()
def rsvideo(
    version: Annotated[bool, typer.Option("--version", callback=_version, is_eager=True, help="Print the version and exit.")] = False,
) -> None:
    """Remove motion blur and rolling-shutter distortion together, from hand-held photographs and clips."""


def main() -> None:
    """The command `rsvideo`."""
    from rsvideo.allocation import keep_freed_memory
    from rsvideo.cli import exit_codes, quiet, terminal

    last_exit = exit_codes.LastExit()
    keep_freed_memory()
    for library in ("OMP", "OPENBLAS", "MKL"):  # compiled kernels use the cores; threads within threads slow both
        os.environ.setdefault(f"{library}_NUM_THREADS", "1")
    if quiet.wanted():
        quiet.python_libraries()
    terminal.guard()
    exit_codes.listen()
    try:
        code = app(standalone_mode=False) or exit_codes.Code.DONE
        terminal.flush()
    except (Exception, exit_codes.Stopped) as error:
        if not quiet.wanted() and not isinstance(error, exit_codes.Stopped):
            raise
        code, line = exit_codes.code_and_line(error)
        terminal.last_words(line)
    last_exit.code = code
    sys.exit(code)
