"""Pictures of a board held before a camera, and clips of them."""

from collections.abc import Sequence
from pathlib import Path

import av
import numpy as np

from calibration.boards.render import photograph
from calibration.boards.target import Board

ROWS, COLS, FOCAL = 240, 320, 300.0


def picture(board: Board, turn: Sequence[float], middle: Sequence[float], blur: float = 0.0) -> np.ndarray:
    """What a pinhole camera sees of the board, turned by a rotation vector, its middle at `middle` metres."""
    return photograph(board, turn, middle, focal_px=FOCAL, rows=ROWS, cols=COLS, blur=blur)


def clip(path: Path, pictures: Sequence[np.ndarray], rate: int = 25) -> Path:
    """A clip without loss."""
    with av.open(str(path), "w") as file:
        video = file.add_stream("ffv1", rate=rate)
        video.width, video.height, video.pix_fmt = COLS, ROWS, "gray"
        for one in pictures:
            file.mux(video.encode(av.VideoFrame.from_ndarray(one, "gray")))
        file.mux(video.encode())
    return path
