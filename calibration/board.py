"""Calibration boards: how people name them, where their corners lie, and how these are found in a picture."""

import enum
import itertools
import re
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from rsvideo.config.yaml import meant, shown

EXAMPLES = "chessboard:9x6:25mm, charuco:5x7:DICT_6X6_250:30mm:22mm or aprilgrid:6x6:30mm:9mm"
FEWEST = 6  # corners of one view
_MOST = 100  # squares or tags along a side
_SMALLEST, _NARROWEST = 24, 20  # px, and how many times as long as wide: a board in less is not to be found, and finders fail on it
_FIND_PX = 1280  # a chessboard is looked for in a picture no longer than that, and refined in the whole one
_WINDOW, _WIDEST = 1 / 3, 16  # half of the window about a corner: part of the distance to the nearest other one, and px
_TAGS = "DICT_APRILTAG_36h11"
_TAG_BORDER = 2  # bits, as kalibr prints them
_TAG_PERIMETER = 0.02  # of the picture's longer side, of the smallest tag
_TAG_BENT = 0.1  # of a tag's side; a corner that is off by more beside the tag's other ones was mistaken
_COUNTS = re.compile(r"(\d{1,4})x(\d{1,4})")
_LENGTH = re.compile(r"(\d{1,6}\.?\d{0,6}|\.\d{1,6})(mm|cm|m|)")
_METRES = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}


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

    def corners(self) -> Float[np.ndarray, "corners 3"]:
        """Where each corner lies on the board, in metres; the index is the corner's number."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """Corners that were found in a picture."""

    numbers: Int[np.ndarray, " n"]
    points: Float[np.ndarray, "n 2"]  # px


def parse(text: str) -> Board:
    """The board that a person names."""
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
    if not (least <= cols <= _MOST and least <= rows <= _MOST):
        raise ValueError(f"{rule}; columns and rows must lie in {least} to {_MOST}")
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
    if (tags := _tags_of(board)) > (held := len(_markers(board).bytesList)):
        raise ValueError(f"{rule}; it takes {tags} markers, {dictionary or _TAGS} has {held}")
    return board


def _metres(rule: str, text: str) -> float:
    if not (found := _LENGTH.fullmatch(text)) or not found[2]:
        raise ValueError(f"{rule}; {shown(text)} must be a length with its unit, such as 25mm")
    if not 1e-3 <= (metres := float(found[1]) * _METRES[found[2]]) <= 10:
        raise ValueError(f"{rule}; {shown(text)} must lie in 1 mm to 10 m")
    return metres


def _dictionary(text: str) -> str:
    names = [name for name in dir(cv2.aruco) if name.startswith("DICT_")]
    found = {name.upper(): name for name in names}.get(text.upper())
    if not found:
        raise ValueError(f"there is no dictionary of markers named {shown(text)}{meant(text, names)}; OpenCV has DICT_6X6_250 and others")
    return found


def _tags_of(board: Board) -> int:
    match board.kind:
        case Kind.CHESSBOARD:
            return 0
        case Kind.CHARUCO:
            return board.cols * board.rows // 2
        case Kind.APRILGRID:
            return board.cols * board.rows


def _markers(board: Board) -> cv2.aruco.Dictionary:
    return cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, board.dictionary or _TAGS))


def _charuco(board: Board, *, legacy: bool) -> cv2.aruco.CharucoBoard:
    made = cv2.aruco.CharucoBoard((board.cols, board.rows), float(board.side), float(board.inner), _markers(board))
    made.setLegacyPattern(legacy)
    return made


Shape = tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]  # top left and bottom right corner, metres


def black(board: Board) -> list[Shape]:
    """The black rectangles that make up the board."""
    cols, rows = board.squares
    if board.kind is Kind.APRILGRID:
        pitch = board.side + board.inner
        dots = [np.array([i, j]) * pitch for j, i in itertools.product(range(rows + 1), range(cols + 1))]
        tags = [_cells(board, n, board.tag(n), board.side, _TAG_BORDER) for n in range(cols * rows)]
        return [(dot, dot + board.inner) for dot in dots] + [cell for cells in tags for cell in cells]
    corners = [np.array([i, j]) * board.side for j, i in itertools.product(range(rows), range(cols)) if (i + j) % 2 == 0]
    shapes = [(corner, corner + board.side) for corner in corners]
    if board.kind is Kind.CHARUCO:
        made = _charuco(board, legacy=False)
        for number, quad in zip(np.ravel(made.getIds()).tolist(), made.getObjPoints(), strict=True):
            shapes += _cells(board, number, np.asarray(quad, float)[0, :2], board.inner, 1)
    return shapes


def _cells(board: Board, number: int, corner: Float[np.ndarray, "2"], side: float, border: int) -> list[Shape]:
    """The black runs of one marker."""
    dictionary = _markers(board)
    cells = dictionary.markerSize + 2 * border
    bits = cv2.aruco.generateImageMarker(dictionary, number, cells, borderBits=border) < 128
    step, shapes = side / cells, []
    for j, line in enumerate(bits):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(int)))
        shapes += [(corner + step * np.array([a, j]), corner + step * np.array([b, j + 1])) for a, b in edges.reshape(-1, 2)]
    return shapes


def find(board: Board, grey: UInt8[np.ndarray, "rows cols"]) -> Seen | None:
    """The board's corners in a picture, or None where it is not to be seen."""
    if min(grey.shape) < _SMALLEST or max(grey.shape) > _NARROWEST * min(grey.shape):
        return None
    match board.kind:
        case Kind.CHESSBOARD:
            seen = _find_chessboard(board, grey)
        case Kind.CHARUCO:
            seen = _find_charuco(board, grey)
        case Kind.APRILGRID:
            seen = _find_tags(board, grey)
    if seen is None or len(seen.numbers) < FEWEST:
        return None
    at = board.corners()[seen.numbers, :2]
    flat = np.linalg.matrix_rank(at - at.mean(axis=0), tol=0.1 * board.side) < 2  # all on one line
    inside = ((seen.points > 0) & (seen.points < np.array(grey.shape[::-1]) - 1)).all()
    return seen if inside and not flat else None


def _find_chessboard(board: Board, grey: UInt8[np.ndarray, "rows cols"]) -> Seen | None:
    scale = min(1.0, _FIND_PX / max(grey.shape))
    small = cv2.resize(grey, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA) if scale < 1 else grey
    size = (board.cols, board.rows)
    quick = cv2.CALIB_CB_ADAPTIVE_THRESH | cv2.CALIB_CB_NORMALIZE_IMAGE | cv2.CALIB_CB_FAST_CHECK
    found, points = cv2.findChessboardCorners(small, size, flags=quick)
    if not found:
        found, points = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_NORMALIZE_IMAGE)
    if not found:
        return None
    scale = small.shape[1] / grey.shape[1]
    points = (points.reshape(-1, 2).astype(float) + 0.5) / scale - 0.5
    windows = _WINDOW * _spacing(points.reshape(board.rows, board.cols, 2)).ravel()
    return Seen(numbers=np.arange(len(points)), points=_refined(grey, points, windows))


def _find_charuco(board: Board, grey: UInt8[np.ndarray, "rows cols"]) -> Seen | None:
    found = None
    for legacy in (False, True):  # the pattern that OpenCV printed before 4.6 has its first black square elsewhere
        points, numbers = cv2.aruco.CharucoDetector(_charuco(board, legacy=legacy)).detectBoard(grey)[:2]
        if numbers is not None and len(numbers) > (len(found.numbers) if found else 0):
            found = Seen(numbers=np.ravel(numbers).astype(int), points=np.asarray(points, float).reshape(-1, 2))
    return found


def _find_tags(board: Board, grey: UInt8[np.ndarray, "rows cols"]) -> Seen | None:
    how = cv2.aruco.DetectorParameters()
    how.markerBorderBits = _TAG_BORDER
    how.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR  # by the tag's sides, since the small squares at its corners draw it out
    how.minMarkerPerimeterRate = _TAG_PERIMETER
    quads, numbers, _ = cv2.aruco.ArucoDetector(_markers(board), how).detectMarkers(grey)
    if not quads:
        return None
    ours = [(int(n), np.asarray(q, float).reshape(4, 2)) for n, q in zip(np.ravel(numbers), quads, strict=True)]
    ours = [(n, quad) for n, quad in ours if n < board.cols * board.rows]
    if len(ours) < 4:
        return None
    # Which corner of a tag is which follows from where the tags stand, so that no convention of the tags' own is needed.
    centres = np.array([board.tag(n) + board.side / 2 for n, _ in ours])
    homography, _ = cv2.findHomography(centres, np.array([quad.mean(axis=0) for _, quad in ours]))
    if homography is None:
        return None
    corners = board.corners()[:, :2]
    kept, points = [], []
    for n, quad in ours:
        of = np.arange(4 * n, 4 * n + 4)
        expected = cv2.perspectiveTransform(corners[of][None], homography)[0]
        nearest = np.argmin(np.linalg.norm(quad[None] - expected[:, None], axis=2), axis=1)
        if len(set(nearest.tolist())) == 4:
            kept.append(of)
            points.append(quad[nearest])
    if not kept:
        return None
    sides = np.array([np.linalg.norm(np.roll(quad, 1, axis=0) - quad, axis=1).min() for quad in points])
    windows = 0.5 * np.repeat(sides, 4) * board.inner / board.side  # within the small squares
    numbers, refined = np.concatenate(kept), _refined(grey, np.concatenate(points), windows)
    whole, _ = cv2.findHomography(corners[numbers], refined, cv2.RANSAC, float(_TAG_BENT * sides.mean()))
    if whole is None:
        return None
    off = (refined - cv2.perspectiveTransform(corners[numbers][None], whole)[0]).reshape(-1, 4, 2)
    off -= np.median(off, axis=1, keepdims=True)  # a lens displaces a tag's corners alike
    sound = np.repeat(np.abs(off).max(axis=(1, 2)) < _TAG_BENT * sides, 4)
    return Seen(numbers=numbers[sound], points=refined[sound])


def _spacing(grid: Float[np.ndarray, "rows cols 2"]) -> Float[np.ndarray, "rows cols"]:
    """How far each corner is from its nearest neighbour along rows and columns."""
    nearest = np.full(grid.shape[:2], np.inf)
    for axis in (0, 1):
        apart = np.linalg.norm(np.diff(grid, axis=axis), axis=2)
        ends = [(0, 0), (0, 0)]
        for side in ((1, 0), (0, 1)):
            ends[axis] = side
            nearest = np.minimum(nearest, np.pad(apart, ends, constant_values=np.inf))
    return nearest


def _refined(
    grey: UInt8[np.ndarray, "rows cols"], points: Float[np.ndarray, "n 2"], windows: Float[np.ndarray, " n"]
) -> Float[np.ndarray, "n 2"]:
    """Corners to a fraction of a pixel, each by its own window; a wider one tells more until it reaches the next corner."""
    halves = np.clip(np.floor(windows), 2, _WIDEST).astype(int)
    until = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)
    refined = points.copy()
    for half in np.unique(halves).tolist():
        start = np.ascontiguousarray(points[halves == half].reshape(-1, 1, 2), np.float32)
        refined[halves == half] = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), until).reshape(-1, 2)
    return refined
