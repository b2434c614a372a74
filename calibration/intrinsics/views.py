"""Pictures in which a board was found: from photographs and from a clip."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from calibration.boards.detect import Corners, find
from calibration.boards.target import Board
from calibration.sources import by_name
from rsvideo.config.files import UnreadableError
from rsvideo.stills import still
from rsvideo.video import decode
from rsvideo.video.stream import Picture, Stream

MOST_SEARCHED = 240  # of a clip's pictures, evenly spread; searching more finds the same views again
_CONTRAST = (0.05, 0.95)  # quantiles of the board's picture that stand for black and white
_STEEPEST = 0.97  # quantile of the slopes that stands for edges: not the highest, which is noise
_FLATTEST = 1e-3  # codes a pixel; keeps the width of no edge finite
_LEAST_PEAK = 1e-6  # a black picture divides by this
_SOBEL = 1 / 8  # makes OpenCV's Sobel filter a derivative per pixel
_FLOW_WINDOW, _FLOW_LEVELS = (15, 15), 3  # px, and halvings: follows displacements of up to about 60 px between frames
_FOLLOWED = 0.5  # of the corners must be followed for their speed to count


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """One picture of the board."""

    name: str
    corners: Corners  # as observed
    object_points: Float[np.ndarray, "n 3"]  # metres, where these corners lie on the board
    outline: tuple[tuple[float, float], tuple[float, float]]  # metres, from the board's first corner to its last
    rows: int
    cols: int
    edge_width: float  # px, of the edges between black and white
    speed: float | None = None  # px/s at which its corners move, where that can be measured
    weight: float = 1.0  # of its squared residuals


@dataclass(frozen=True, kw_only=True)
class Refused:
    """A picture that is not used, and why."""

    name: str
    reason: str


def from_photographs(files: Sequence[Path], board: Board) -> Iterator[View | Refused]:
    """Each photograph as a view, or the reason why it is none; one that cannot be read ends all only where it is the only one."""
    for name, path in by_name(files).items():
        try:
            grey = _grey(still.read(path).codes.samples)
        except UnreadableError as error:
            if len(files) == 1:
                raise
            yield Refused(name=name, reason=str(error))
            continue
        corners = find(board, grey)
        yield _view(name, grey, board, corners) if corners else Refused(name=name, reason="the board was not found")


def from_clip(stream: Stream, board: Board) -> Iterator[View | Refused]:
    """Pictures evenly spread over a clip, each with the speed of its corners towards the next picture."""
    step = max(1, -(-stream.frames // MOST_SEARCHED))
    last: tuple[View, UInt8[np.ndarray, "rows cols"], float] | None = None
    for picture in decode.pictures(stream):
        if last is not None:
            view, before, when = last
            yield replace(view, speed=_speed(view, before, _luma(picture), picture.time - when))
            last = None
        if picture.index % step or 0 < picture.index == stream.frames - 1:  # the last one has no next to tell its motion by
            continue
        grey = _luma(picture)
        if corners := find(board, grey):
            last = _view(_frame(picture.index), grey, board, corners), grey, picture.time
        else:
            yield Refused(name=_frame(picture.index), reason="the board was not found")
    if last is not None:
        yield last[0]


def _view(name: str, grey: UInt8[np.ndarray, "rows cols"], board: Board, corners: Corners) -> View:
    points = board.object_points()
    first, last = points.min(axis=0)[:2], points.max(axis=0)[:2]
    return View(
        name=name,
        corners=corners,
        object_points=points[corners.numbers],
        outline=((float(first[0]), float(first[1])), (float(last[0]), float(last[1]))),
        rows=grey.shape[0],
        cols=grey.shape[1],
        edge_width=_edge_width(grey, corners),
    )


def _edge_width(grey: UInt8[np.ndarray, "rows cols"], corners: Corners) -> float:
    """How wide the board's edges are, in px: its contrast by its steepest slopes."""
    x, y, width, height = cv2.boundingRect(corners.points.astype(np.float32))
    part = grey[max(y, 0) : y + height + 1, max(x, 0) : x + width + 1].astype(np.float32)
    slopes = np.hypot(cv2.Sobel(part, cv2.CV_32F, 1, 0, scale=_SOBEL), cv2.Sobel(part, cv2.CV_32F, 0, 1, scale=_SOBEL))
    low, high = np.quantile(part, _CONTRAST)
    return float((high - low) / max(float(np.quantile(slopes, _STEEPEST)), _FLATTEST))


def _speed(view: View, before: UInt8[np.ndarray, "rows cols"], after: UInt8[np.ndarray, "rows cols"], seconds: float) -> float | None:
    """How fast the corners move, px/s; None where they cannot be followed."""
    start = np.ascontiguousarray(view.corners.points.reshape(-1, 1, 2), np.float32)
    end, found, _ = cv2.calcOpticalFlowPyrLK(before, after, start, np.empty_like(start), winSize=_FLOW_WINDOW, maxLevel=_FLOW_LEVELS)
    followed = np.ravel(found) == 1
    if seconds <= 0 or followed.mean() < _FOLLOWED:
        return None
    return float(np.median(np.linalg.norm((end - start)[followed], axis=-1))) / seconds


def _grey(samples: np.ndarray) -> UInt8[np.ndarray, "rows cols"]:
    eight = (samples >> 8).astype(np.uint8) if samples.dtype == np.uint16 else samples
    return cv2.cvtColor(eight, cv2.COLOR_RGB2GRAY) if eight.shape[2] == 3 else np.ascontiguousarray(eight[..., 0])


def _luma(picture: Picture) -> UInt8[np.ndarray, "rows cols"]:
    """Y, or the first colour, stretched to 8 bits."""
    plane = picture.planes[0]
    if plane.dtype == np.uint8:
        return np.ascontiguousarray(plane)
    top = max(float(plane.max()), _LEAST_PEAK)
    return np.clip(plane.astype(np.float32) * (255 / top), 0, 255).astype(np.uint8)


def _frame(index: int) -> str:
    return f"frame {index}"
