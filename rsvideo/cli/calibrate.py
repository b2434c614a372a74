"""rsvideo calibrate: measures a camera with things that people have at home, and writes what it finds into its profile."""

import typer

from rsvideo.cli.calibrate_board import board
from rsvideo.cli.calibrate_lens import lens
from rsvideo.cli.calibrate_lensfun import lensfun
from rsvideo.cli.calibrate_readout import readout
from rsvideo.cli.calibrate_response import response
from rsvideo.cli.calibrate_show import convert, schema, show

calibrate = typer.Typer(add_completion=False, rich_markup_mode=None, no_args_is_help=True)
for command in (board, lens, readout, response, show, convert, lensfun, schema):
    calibrate.command()(command)


@calibrate.callback()
def group() -> None:
    """Measure a camera: print a board, film it, and get a profile that --camera takes in every command."""
