"""A board's corners, found in a picture to a fraction of a pixel."""

from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Int, UInt8

from calibration.boards.target import APRILGRID_BORDER_BITS, Board, Kind, charuco_board, marker_dictionary

FEWEST_CORNERS = 6  # of one view; fewer do not fix a pose together with a check of it
_SHORTEST_PX, _MOST_ELONGATED = 24, 20  # the picture's shorter side, and long side over short one: beyond, OpenCV's finders fail
_SEARCH_PX = 1280  # the longer side of the picture in which a chessboard is searched; its corners are refined in the whole one
_WINDOW_PART, _WIDEST_WINDOW_PX = 1 / 3, 16  # half of the window about a corner: part of the distance to the next corner, and at most
_NARROWEST_WINDOW_PX = 2
_FEWEST_TAGS = 4  # for a homography through their centres
_TAG_PERIMETER = 0.02  # of the smallest tag, as part of the picture's longer side
_MISTAKEN = 0.1  # of a tag's side; a corner that lies farther off, beside the tag's other corners, belongs to something else
_REFINE_UNTIL = (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 40, 1e-3)  # steps, px
_COLLINEAR = 0.1  # of a square's side; corners that deviate less from a line do not span the board


@dataclass(frozen=True, kw_only=True, eq=False)
class Corners:
    """Corners that were found in a picture: image points, in OpenCV's words."""

    numbers: Int[np.ndarray, " n"]  # of the corners on the board
    points: Float[np.ndarray, "n 2"]  # (x, y) in px; the centre of the top-left pixel is (0, 0)


def find(board: Board, grey: UInt8[np.ndarray, "rows cols"]) -> Corners | None:
    """The board's corners in a picture, or None where they are too few, all on one line, or at the very edge."""
    if min(grey.shape) < _SHORTEST_PX or max(grey.shape) > _MOST_ELONGATED * min(grey.shape):
        return None
    match board.kind:
        case Kind.CHESSBOARD:
            corners = _find_chessboard(board, grey)
        case Kind.CHARUCO:
            corners = _find_charuco(board, grey)
        case Kind.APRILGRID:
            corners = _find_tags(board, grey)
    if corners is None or len(corners.numbers) < FEWEST_CORNERS:
        return None
    at = board.object_points()[corners.numbers, :2]
    on_a_line = np.linalg.matrix_rank(at - at.mean(axis=0), tol=_COLLINEAR * board.side) < 2
    inside = ((corners.points > 0) & (corners.points < np.array(grey.shape[::-1]) - 1)).all()
    return corners if inside and not on_a_line else None


def _find_chessboard(board: Board, grey: UInt8[np.ndarray, "rows cols"]) -> Corners | None:
    scale = min(1.0, _SEARCH_PX / max(grey.shape))
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
    windows = _WINDOW_PART * _spacing(points.reshape(board.rows, board.cols, 2)).ravel()
    return Corners(numbers=np.arange(len(points)), points=_refined(grey, points, windows))


def _find_charuco(board: Board, grey: UInt8[np.ndarray, "rows cols"]) -> Corners | None:
    found = None
    for legacy in (False, True):
        points, numbers = cv2.aruco.CharucoDetector(charuco_board(board, legacy=legacy)).detectBoard(grey)[:2]
        if numbers is not None and len(numbers) > (len(found.numbers) if found else 0):
            found = Corners(numbers=np.ravel(numbers).astype(int), points=np.asarray(points, float).reshape(-1, 2))
    return found


def _find_tags(board: Board, grey: UInt8[np.ndarray, "rows cols"]) -> Corners | None:
    how = cv2.aruco.DetectorParameters()
    how.markerBorderBits = APRILGRID_BORDER_BITS
    how.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_CONTOUR  # by the tag's sides, since the small squares at its corners draw it out
    how.minMarkerPerimeterRate = _TAG_PERIMETER
    quads, numbers, _ = cv2.aruco.ArucoDetector(marker_dictionary(board), how).detectMarkers(grey)
    if not quads:
        return None
    ours = [(int(n), np.asarray(q, float).reshape(4, 2)) for n, q in zip(np.ravel(numbers), quads, strict=True)]
    ours = [(n, quad) for n, quad in ours if n < board.cols * board.rows]
    if len(ours) < _FEWEST_TAGS:
        return None
    # Which corner of a tag is which follows from where the tags stand, so that no convention of the tags' own is needed.
    centres = np.array([board.tag(n) + board.side / 2 for n, _ in ours])
    homography, _ = cv2.findHomography(centres, np.array([quad.mean(axis=0) for _, quad in ours]))
    if homography is None:
        return None
    corners = board.object_points()[:, :2]
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
    whole, _ = cv2.findHomography(corners[numbers], refined, cv2.RANSAC, float(_MISTAKEN * sides.mean()))
    if whole is None:
        return None
    off = (refined - cv2.perspectiveTransform(corners[numbers][None], whole)[0]).reshape(-1, 4, 2)
    off -= np.median(off, axis=1, keepdims=True)  # a lens displaces a tag's corners alike
    sound = np.repeat(np.abs(off).max(axis=(1, 2)) < _MISTAKEN * sides, 4)
    return Corners(numbers=numbers[sound], points=refined[sound])


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
    halves = np.clip(np.floor(windows), _NARROWEST_WINDOW_PX, _WIDEST_WINDOW_PX).astype(int)
    refined = points.copy()
    for half in np.unique(halves).tolist():
        start = np.ascontiguousarray(points[halves == half].reshape(-1, 1, 2), np.float32)
        refined[halves == half] = cv2.cornerSubPix(grey, start, (half, half), (-1, -1), _REFINE_UNTIL).reshape(-1, 2)
    return refined
