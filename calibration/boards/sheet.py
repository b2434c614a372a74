"""Boards on paper: a PDF that is to scale when it is printed at 100 %."""

import io
from pathlib import Path

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from calibration.boards.pattern import black_rectangles
from calibration.boards.target import Board, parse
from calibration.output import file_format
from rsvideo.config.files import write_whole
from rsvideo.config.yaml import meant

PAPERS_MM = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
}
FORMATS = ("pdf", "png", "svg")
_MARGIN_MM, _FOOT_MM = 8.0, 14.0  # what printers leave white, and room for the ruler
_RULER_MM, _TICK_MM, _LONG_TICK_EVERY_MM = 100, 10, 50
_INCH_MM = 25.4
_PNG_DPI = 254.0  # 10 px a mm


def board(file: Path | str, name: str = "chessboard:9x6:25mm", *, paper: str = "A4", overwrite: bool = False) -> Board:
    """Draw a board to print at 100 %, glue to something flat, and photograph.

    Args:
        file: Where to draw it; the suffix names the format: .pdf, .svg, or .png at 10 px a mm.
        name: The board: `chessboard:9x6:25mm` (inner corners, side of a square), `charuco:5x7:DICT_6X6_250:30mm:22mm`
            (squares, dictionary, sides of squares and markers) or `aprilgrid:6x6:30mm:9mm` (tags, side of a tag, gap).
        paper: The sheet: A4, A3, A2, A1, A0 or letter.
        overwrite: Whether to replace a file that exists.

    Returns:
        The board, whose `object_points()` are its corners, in metres.

    Raises:
        ValueError: `name` is no board, it does not fit the paper, or the suffix is none of the formats.
        FileExistsError: `file` exists, and `overwrite` is false.

    Examples:
        >>> import tempfile, pathlib, calibration
        >>> file = pathlib.Path(tempfile.mkdtemp()) / "board.svg"
        >>> target = calibration.board(file, "chessboard:6x5:25mm")
        >>> target.object_points().shape  # 6 x 5 inner corners, in metres
        (30, 3)
        >>> file.exists()
        True
    """
    file = Path(file)
    kind = file_format(file, FORMATS, overwrite=overwrite)
    target = parse(name)
    write_whole({file: draw(target, name, paper=paper, kind=kind)})
    return target


def draw(board: Board, name: str, *, paper: str = "A4", kind: str = "pdf", dpi: float = _PNG_DPI) -> bytes:
    """The file that prints `board`, with its `name` and a ruler of 100 mm below; `dpi` counts for PNG alone."""
    if paper not in PAPERS_MM:
        raise ValueError(f"paper must be one of {', '.join(PAPERS_MM)}, got {paper[:40]!r}{meant(paper, PAPERS_MM)}")
    width, height = (1e3 * side for side in board.extent)
    sheet = _sheet_for(width, height, paper)
    left, top = (sheet[0] - width) / 2, (sheet[1] - _FOOT_MM - height) / 2
    with matplotlib.rc_context({"svg.hashsalt": "rsvideo", "pdf.fonttype": 42}):
        figure = Figure(figsize=(sheet[0] / _INCH_MM, sheet[1] / _INCH_MM))
        page = figure.add_axes((0, 0, 1, 1))
        page.set(xlim=(0, sheet[0]), ylim=(sheet[1], 0))
        page.axis("off")
        corners = [1e3 * np.array([a, (b[0], a[1]), b, (a[0], b[1])]) + (left, top) for a, b in black_rectangles(board)]
        page.add_collection(PolyCollection(corners, facecolor="black", edgecolor="none", antialiased=False))
        _draw_ruler(page, sheet, name)
        file = io.BytesIO()
        figure.savefig(file, format=kind, dpi=dpi, metadata={"CreationDate": None} if kind == "pdf" else {})
    return file.getvalue()


def _draw_ruler(page: Axes, sheet: tuple[float, float], name: str) -> None:
    """A ruler by which a person checks the scale, and the board's name."""
    x, y = (sheet[0] - _RULER_MM) / 2, sheet[1] - _MARGIN_MM
    page.plot([x, x + _RULER_MM], [y, y], "k", lw=0.6)
    for tick in range(0, _RULER_MM + 1, _TICK_MM):
        page.plot([x + tick] * 2, [y, y - (3 if tick % _LONG_TICK_EVERY_MM == 0 else 2)], "k", lw=0.6)
    page.text(sheet[0] / 2, y - 4, f"{name}    print at 100 %: this ruler is {_RULER_MM} mm long", ha="center", va="bottom", fontsize=8)


def _sheet_for(width: float, height: float, paper: str) -> tuple[float, float]:
    """The sheet's width and height in mm, turned so that the board fits."""
    short, long = PAPERS_MM[paper]
    sheet = min(((short, long), (long, short)), key=lambda size: (not _fits(size, width, height), size[0]))
    if not _fits(sheet, width, height):
        room = f"{long - 2 * _MARGIN_MM:.0f} x {short - 2 * _MARGIN_MM - _FOOT_MM:.0f}"
        raise ValueError(
            f"the board must fit into {room} mm of {paper}, it is {width:.0f} x {height:.0f} mm; smaller squares, or a larger --paper?"
        )
    return sheet


def _fits(sheet: tuple[float, float], width: float, height: float) -> bool:
    return width <= sheet[0] - 2 * _MARGIN_MM and height <= sheet[1] - 2 * _MARGIN_MM - _FOOT_MM
