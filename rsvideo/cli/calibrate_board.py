"""rsvideo calibrate board: a target to print."""

import enum
from pathlib import Path
from typing import Annotated

from typer import Option

from rsvideo.cli.calibrate_profile import Overwrite
from rsvideo.cli.terminal import say
from rsvideo.cli.validate import refusing

BOARD = "chessboard:9x6:25mm (inner corners, side of a square), charuco:5x7:DICT_6X6_250:30mm:22mm or aprilgrid:6x6:30mm:9mm."
BoardName = Annotated[str, Option("--board", metavar="BOARD", help=BOARD)]


class Paper(enum.StrEnum):
    """Sheets that printers take."""

    A4 = "A4"
    A3 = "A3"
    A2 = "A2"
    A1 = "A1"
    A0 = "A0"
    LETTER = "letter"


def board(
    output: Annotated[Path, Option("-o", "--output", metavar="FILE", help="Where to draw it: .pdf, .svg, or .png at 10 px a mm.")],
    name: BoardName = "chessboard:9x6:25mm",
    paper: Annotated[Paper, Option(help="The sheet it is printed on.")] = Paper.A4,
    overwrite: Overwrite = False,
) -> None:
    """Draw a board to print at 100 %, glue to something flat, and film."""
    with refusing():
        import calibration

        calibration.board(output, name, paper=paper.value, overwrite=overwrite)
    say(f"drawn: {output}; print it at 100 % and check the ruler, then: rsvideo calibrate lens VIEWS --board {name}")
