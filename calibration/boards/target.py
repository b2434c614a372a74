"""Calibration boards: how people name them, and where their corners lie."""

import enum
import re
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from rsvideo.config.yaml import meant, shown

EXAMPLES = "chessboard:9x6:25mm, charuco:5x7:DICT_6X6_250:30mm:22mm or aprilgrid:6x6:30mm:9mm"
APRILGRID_BORDER_BITS = 2  # about each tag, as kalibr prints them
_APRILGRID_DICTIONARY = "DICT_APRILTAG_36h11"  # kalibr's
_MOST_COUNT = 100  # squares or tags along a side; more are a slip
_LENGTH_M = (1e-3, 10.0)  # of a square or a tag; beyond, the unit is a slip
_COUNTS = re.compile(r"(\d{1,4})x(\d{1,4})")
_LENGTH = re.compile(r"(\d{1,6}\.?\d{0,6}|\.\d{1,6})(mm|cm|m|)")
_METRES_PER_UNIT = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


class Kind(enum.StrEnum):
    """The families of boards."""

    CHESSBOARD = "chessboard"
    CHARUCO = "charuco"  # a chessboard whose white squares hold markers
    APRILGRID = "aprilgrid"  # kalibr's: tags with small squares between their corners


@dataclass(frozen=True, kw_only=True)
class Board:
    """One board. Its x runs right and its y down, from the top left corner."""

    kind: Kind
    cols: int  # inner corners of a chessboard, squares of a ChArUco board, tags of a grid
    rows: int
    side: float  # metres, of a square or a tag
    inner: float = 0.0  # metres, of a ChArUco board's markers; or between two tags
    dictionary: str = ""

    @property
    def squares(self) -> tuple[int, int]:
        """Columns and rows of squares, or of tags."""
        return (self.cols + 1, self.rows + 1) if self.kind is Kind.CHESSBOARD else (self.cols, self.rows)

    @property
    def extent(self) -> tuple[float, float]:
        """Width and height in metres of all that is printed."""
        cols, rows = self.squares
        if self.kind is Kind.APRILGRID:
            return cols * (self.side + self.inner) + self.inner, rows * (self.side + self.inner) + self.inner
        return cols * self.side, rows * self.side

    def object_points(self) -> Float[np.ndarray, "corners 3"]:
        """Where each corner lies on the board, in metres, z = 0; the index is the corner's number."""
        if self.kind is Kind.APRILGRID:
            corners = np.array([(0, 0), (1, 0), (1, 1), (0, 1)]) * self.side  # top left, then clockwise
            at = np.concatenate([corners + self.tag(number) for number in range(self.cols * self.rows)])
        else:
            cols, rows = self.squares
            y, x = np.mgrid[1:rows, 1:cols]
            at = self.side * np.stack([x.ravel(), y.ravel()], axis=1)
        return np.concatenate([at, np.zeros((len(at), 1))], axis=1).astype(float)

    def tag(self, number: int) -> Float[np.ndarray, "2"]:
        """The top left corner of a tag; they are counted from the bottom left, row by row."""
        up, across = divmod(number, self.cols)
        pitch = self.side + self.inner
        return np.array([self.inner + across * pitch, self.inner + (self.rows - 1 - up) * pitch])


def parse(text: str) -> Board:
    """The board that a person names, such as one of EXAMPLES; a name that is none raises a ValueError that says what is wrong."""
    rule = f"board must be one such as {EXAMPLES}, got {shown(text)}"
    name, _, rest = text.strip().partition(":")
    parts = rest.split(":") if rest else []
    if name not in set(Kind):
        raise ValueError(rule + meant(name, list(Kind)))
    kind, dictionary = Kind(name), ""
    if kind is Kind.CHARUCO and len(parts) > 1:
        dictionary = _dictionary(parts.pop(1))
    wanted = {Kind.CHESSBOARD: 2, Kind.CHARUCO: 3, Kind.APRILGRID: 3}[kind]
    if len(parts) != wanted:
        raise ValueError(f"{rule}; {kind} takes {wanted + (kind is Kind.CHARUCO)} parts after its name")
    if not (counts := _COUNTS.fullmatch(parts[0])):
        raise ValueError(f"{rule}; {shown(parts[0])} must be columns x rows, such as 9x6")
    cols, rows = int(counts[1]), int(counts[2])
    least = 3 if kind is Kind.CHESSBOARD else 2
    if not (least <= cols <= _MOST_COUNT and least <= rows <= _MOST_COUNT):
        raise ValueError(f"{rule}; columns and rows must lie in {least} to {_MOST_COUNT}")
    side = _metres(rule, parts[1])
    inner = 0.0
    if kind is Kind.APRILGRID:  # kalibr gives the gap as a part of the tag
        gap = re.fullmatch(r"0?\.\d{1,6}", parts[2])
        inner = side * float(parts[2]) if gap else _metres(rule, parts[2])
    elif kind is Kind.CHARUCO:
        inner = _metres(rule, parts[2])
    if kind is not Kind.CHESSBOARD and not 0 < inner < side:
        raise ValueError(f"{rule}; {'markers are smaller than their squares' if kind is Kind.CHARUCO else 'gaps are narrower than tags'}")
    board = Board(kind=kind, cols=cols, rows=rows, side=side, inner=inner, dictionary=dictionary)
    if (tags := _marker_count(board)) > (held := len(marker_dictionary(board).bytesList)):
        raise ValueError(f"{rule}; it takes {tags} markers, {dictionary or _APRILGRID_DICTIONARY} has {held}")
    return board


def _metres(rule: str, text: str) -> float:
    if not (found := _LENGTH.fullmatch(text)) or not found[2]:
        raise ValueError(f"{rule}; {shown(text)} must be a length with its unit, such as 25mm")
    least, most = _LENGTH_M
    if not least <= (metres := float(found[1]) * _METRES_PER_UNIT[found[2]]) <= most:
        raise ValueError(f"{rule}; {shown(text)} must lie in 1 mm to 10 m")
    return metres


def _dictionary(text: str) -> str:
    names = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    found = {name.upper(): name for name in names}.get(text.upper())
    if not found:
        raise ValueError(f"there is no dictionary of markers named {shown(text)}{meant(text, names)}; OpenCV has DICT_6X6_250 and others")
    return found


def _marker_count(board: Board) -> int:
    match board.kind:
        case Kind.CHESSBOARD:
            return 0
        case Kind.CHARUCO:
            return board.cols * board.rows // 2
        case Kind.APRILGRID:
            return board.cols * board.rows


def marker_dictionary(board: Board) -> cv2.aruco.Dictionary:
    """OpenCV's dictionary of the markers on a board."""
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary or _APRILGRID_DICTIONARY))


def charuco_board(board: Board, *, legacy: bool) -> cv2.aruco.CharucoBoard:
    """OpenCV's ChArUco board; `legacy` is the pattern that it printed before 4.6, whose first black square lies elsewhere."""
    made = cv2.aruco.CharucoBoard((board.cols, board.rows), float(board.side), float(board.inner), marker_dictionary(board))
    made.setLegacyPattern(legacy)
    return made
