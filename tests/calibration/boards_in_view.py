"""Pictures of a board held before a camera, and clips of them."""

from collections.abc import Sequence
from pathlib import Path

import av
import cv2
import numpy as np

from calibration import sheet
from calibration.board import Board

ROWS, COLS, FOCAL = 240, 320, 300.0
_PX_PER_MM = 4


def picture(board: Board, turn: Sequence[float], middle: Sequence[float], blur: float = 0.0) -> np.ndarray:
    """What a pinhole camera sees of the board, turned by a rotation vector, its middle at `middle` metres."""
    sheet_px = np.frombuffer(sheet.draw(board, "", kind="png", dpi=25.4 * _PX_PER_MM), np.uint8)
    paper = np.asarray(cv2.imdecode(sheet_px, cv2.IMREAD_GRAYSCALE))
    rows, cols = paper.shape
    metres = np.array([[1e-3 / _PX_PER_MM, 0, -0.5e-3 * cols / _PX_PER_MM], [0, 1e-3 / _PX_PER_MM, -0.5e-3 * rows / _PX_PER_MM], [0, 0, 1]])
    R = cv2.Rodrigues(np.array(turn, float))[0]
    C = np.array([[FOCAL, 0, COLS / 2 - 0.5], [0, FOCAL, ROWS / 2 - 0.5], [0, 0, 1]])
    H = C @ np.stack([R[:, 0], R[:, 1], np.array(middle, float)], axis=1) @ metres
    fine = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1]])  # four by four samples a pixel
    seen = cv2.warpPerspective(paper, fine @ H, (4 * COLS, 4 * ROWS), flags=cv2.INTER_AREA, borderValue=128)
    seen = cv2.resize(seen, (COLS, ROWS), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(seen, (0, 0), blur) if blur else seen


def clip(path: Path, pictures: Sequence[np.ndarray], rate: int = 25) -> Path:
    """A clip without loss."""
    with av.open(str(path), "w") as file:
        video = file.add_stream("ffv1", rate=rate)
        video.width, video.height, video.pix_fmt = COLS, ROWS, "gray"
        for one in pictures:
            file.mux(video.encode(av.VideoFrame.from_ndarray(one, "gray")))
        file.mux(video.encode())
    return path
