"""What a pinhole camera sees of a board that is held before it: the twin of `detect`, for tests and examples."""

from collections.abc import Iterator, Sequence

import cv2
import numpy as np
from jaxtyping import UInt8

from calibration.boards import sheet
from calibration.boards.target import Board, parse

_PAPER_PX_PER_MM = 4
_SAMPLES = 4  # a pixel, along each axis
_GREY = 128  # of what is beside the paper
_INCH_MM = 25.4
_TURNS = 0.5  # radians to either side, about each axis
_CENTRES = ((-0.18, -0.09, 1.0), (0.18, 0.09, 1.25))  # of the working distance: where the board's middle is


def photograph(
    board: Board,
    turn: Sequence[float],
    centre: Sequence[float],
    *,
    focal_px: float = 300.0,
    rows: int = 240,
    cols: int = 320,
    blur: float = 0.0,
) -> UInt8[np.ndarray, "rows cols"]:
    """A photograph of the printed board, in 8 bits, by a camera without distortion whose principal point is the picture's middle.

    `turn` is the board's rotation vector in radians, `centre` where its middle is, in metres (x right, y down, z ahead); `blur` is the
    standard deviation of a Gaussian, in px.
    """
    png = np.frombuffer(sheet.draw(board, "", kind="png", dpi=_INCH_MM * _PAPER_PX_PER_MM), np.uint8)
    paper = np.asarray(cv2.imdecode(png, cv2.IMREAD_GRAYSCALE))
    px = 1e-3 / _PAPER_PX_PER_MM  # metres
    metres_from_paper = np.array([[px, 0, -0.5 * px * paper.shape[1]], [0, px, -0.5 * px * paper.shape[0]], [0, 0, 1]])
    R = cv2.Rodrigues(np.array(turn, float))[0]
    K = np.array([[focal_px, 0, (cols - 1) / 2], [0, focal_px, (rows - 1) / 2], [0, 0, 1]])
    H = K @ np.stack([R[:, 0], R[:, 1], np.array(centre, float)], axis=1) @ metres_from_paper
    edge = (_SAMPLES - 1) / 2  # the middle of a pixel, in samples
    fine = np.array([[_SAMPLES, 0, edge], [0, _SAMPLES, edge], [0, 0, 1]])
    sampled = cv2.warpPerspective(paper, fine @ H, (_SAMPLES * cols, _SAMPLES * rows), flags=cv2.INTER_AREA, borderValue=_GREY)
    picture = cv2.resize(sampled, (cols, rows), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(picture, (0, 0), blur) if blur else picture


def photographs(
    name: str, count: int, *, focal_px: float, rows: int = 240, cols: int = 320, seed: int = 1
) -> Iterator[UInt8[np.ndarray, "rows cols"]]:
    """Photographs of a board, named as in `target.parse`, that fills about half of the picture and is tilted to all sides.

    Examples:
        >>> from calibration.boards.render import photographs
        >>> [picture.shape for picture in photographs("chessboard:6x5:25mm", 2, focal_px=300.0)]
        [(240, 320), (240, 320)]
    """
    board, rng = parse(name), np.random.default_rng(seed)
    distance = 2 * focal_px * max(board.extent[0] / cols, board.extent[1] / rows)
    for _ in range(count):
        turn, centre = rng.uniform(-_TURNS, _TURNS, 3), distance * rng.uniform(*_CENTRES)
        yield photograph(board, turn.tolist(), centre.tolist(), focal_px=focal_px, rows=rows, cols=cols)
