"""What is printed black on a board, as rectangles."""

import itertools

import cv2
import numpy as np
from jaxtyping import Float

from calibration.boards.target import APRILGRID_BORDER_BITS, Board, Kind, charuco_board, marker_dictionary

_CHARUCO_BORDER_BITS = 1  # OpenCV's default

Rectangle = tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]  # top left and bottom right corner, metres


def black_rectangles(board: Board) -> list[Rectangle]:
    """The black rectangles that make up the board."""
    cols, rows = board.squares
    if board.kind is Kind.APRILGRID:
        pitch = board.side + board.inner
        dots = [np.array([i, j]) * pitch for j, i in itertools.product(range(rows + 1), range(cols + 1))]
        tags = [_cells(board, n, board.tag(n), board.side, APRILGRID_BORDER_BITS) for n in range(cols * rows)]
        return [(dot, dot + board.inner) for dot in dots] + [cell for cells in tags for cell in cells]
    corners = [np.array([i, j]) * board.side for j, i in itertools.product(range(rows), range(cols)) if (i + j) % 2 == 0]
    rectangles = [(corner, corner + board.side) for corner in corners]
    if board.kind is Kind.CHARUCO:
        made = charuco_board(board, legacy=False)
        for number, quad in zip(np.ravel(made.getIds()).tolist(), made.getObjPoints(), strict=True):
            rectangles += _cells(board, number, np.asarray(quad, float)[0, :2], board.inner, _CHARUCO_BORDER_BITS)
    return rectangles


def _cells(board: Board, number: int, corner: Float[np.ndarray, "2"], side: float, border: int) -> list[Rectangle]:
    """The black runs of one marker."""
    dictionary = marker_dictionary(board)
    cells = dictionary.markerSize + 2 * border
    bits = cv2.aruco.generateImageMarker(dictionary, number, cells, borderBits=border) < 128
    step, rectangles = side / cells, []
    for j, line in enumerate(bits):
        edges = np.flatnonzero(np.diff(np.concatenate([[False], line, [False]]).astype(int)))
        rectangles += [(corner + step * np.array([a, j]), corner + step * np.array([b, j + 1])) for a, b in edges.reshape(-1, 2)]
    return rectangles
