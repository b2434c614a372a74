"""Boards on paper: a PDF that is to scale when it is printed at 100 %."""

import io

import matplotlib
import numpy as np
from matplotlib.collections import PolyCollection
from matplotlib.figure import Figure

from calibration.board import Board, black
from rsvideo.config.yaml import meant

PAPERS = {
    "A4": (210.0, 297.0),
    "A3": (297.0, 420.0),
    "A2": (420.0, 594.0),
    "A1": (594.0, 841.0),
    "A0": (841.0, 1189.0),
    "letter": (215.9, 279.4),
}
FORMATS = ("pdf", "png", "svg")
_MARGIN, _FOOT = 8.0, 14.0  # mm: what printers leave white, and room for the ruler
_INCH = 25.4  # mm


def draw(board: Board, name: str, *, paper: str = "A4", kind: str = "pdf", dpi: float = 254) -> bytes:
    """The file that prints `board`, with its `name` and a ruler of 100 mm below; `dpi` counts for PNG alone."""
    if paper not in PAPERS:
        raise ValueError(f"paper must be one of {', '.join(PAPERS)}, got {paper[:40]!r}{meant(paper, PAPERS)}")
    width, height = (1e3 * side for side in board.extent)
    short, long = PAPERS[paper]
    sheet = min(((short, long), (long, short)), key=lambda size: (not _fits(size, width, height), size[0]))
    if not _fits(sheet, width, height):
        room = f"{long - 2 * _MARGIN:.0f} x {short - 2 * _MARGIN - _FOOT:.0f}"
        raise ValueError(
            f"the board must fit into {room} mm of {paper}, it is {width:.0f} x {height:.0f} mm; smaller squares, or a larger --paper?"
        )
    left, top = (sheet[0] - width) / 2, (sheet[1] - _FOOT - height) / 2
    with matplotlib.rc_context({"svg.hashsalt": "rsvideo", "pdf.fonttype": 42}):
        figure = Figure(figsize=(sheet[0] / _INCH, sheet[1] / _INCH))
        page = figure.add_axes((0, 0, 1, 1))
        page.set(xlim=(0, sheet[0]), ylim=(sheet[1], 0))
        page.axis("off")
        corners = [1e3 * np.array([a, (b[0], a[1]), b, (a[0], b[1])]) + (left, top) for a, b in black(board)]
        page.add_collection(PolyCollection(corners, facecolor="black", edgecolor="none", antialiased=False))
        x, y = (sheet[0] - 100) / 2, sheet[1] - _MARGIN
        page.plot([x, x + 100], [y, y], "k", lw=0.6)
        for tick in range(0, 101, 10):
            page.plot([x + tick] * 2, [y, y - (3 if tick % 50 == 0 else 2)], "k", lw=0.6)
        page.text(sheet[0] / 2, y - 4, f"{name}    print at 100 %: this ruler is 100 mm long", ha="center", va="bottom", fontsize=8)
        file = io.BytesIO()
        figure.savefig(file, format=kind, dpi=dpi, metadata={"CreationDate": None} if kind == "pdf" else {})
    return file.getvalue()


def _fits(sheet: tuple[float, float], width: float, height: float) -> bool:
    return width <= sheet[0] - 2 * _MARGIN and height <= sheet[1] - 2 * _MARGIN - _FOOT
