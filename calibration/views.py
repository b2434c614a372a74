"""Which pictures of a board to calibrate on: the sharp, still and varied ones; of each other one, why not."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

from calibration.board import Board, Seen, find
from rsvideo.config.files import UnreadableError
from rsvideo.config.media import CLIP_SUFFIXES
from rsvideo.stills import still
from rsvideo.video import decode
from rsvideo.video.stream import Picture, Stream

MOST_VIEWS = 40  # more add time and little else
MOST_LOOKED_AT = 240  # of a clip's pictures
_BLURRED = 1.6  # edges that many times as wide as the sharpest views' are blurred
_ALIKE_IN_CLIP, _ALIKE = 0.06, 0.005  # how near the board's corners may be, as part of the picture; photographs are taken on purpose
_MOST_SHEAR, _NO_SHEAR = 1.0, 0.3  # px by which motion may shift a board's rows against each other; less than the latter does no harm
_STILLS = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf"}


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """One picture of the board."""

    name: str
    seen: Seen
    at: Float[np.ndarray, "n 3"]  # metres, where the corners lie on the board
    outline: tuple[tuple[float, float], tuple[float, float]]  # metres, from the board's first corner to its last
    rows: int
    cols: int
    edge: float  # px, how wide the board's edges are
    speed: float | None = None  # px/s at which its corners move, where that can be seen
    weight: float = 1.0  # of its squared residuals


@dataclass(frozen=True, kw_only=True)
class Refused:
    """A picture that is not used, and why."""

    name: str
    why: str


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """The views of one camera mode."""

    views: tuple[View, ...]
    refused: tuple[Refused, ...]
    rows: int
    cols: int
    clip: bool
    notes: tuple[str, ...] = ()


def is_clip(path: Path) -> bool:
    """Whether a file is taken for a clip, not for a photograph."""
    return path.suffix.lower() in CLIP_SUFFIXES


def photographs(paths: Sequence[Path]) -> tuple[Path, ...]:
    """The files, and the photographs in each folder among them."""
    found = [sorted(f for f in p.iterdir() if f.suffix.lower() in _STILLS) if p.is_dir() else [p] for p in paths]
    return tuple(path for some in found for path in some)


def named(paths: Sequence[Path]) -> dict[str, Path]:
    """Files by their names, or by their whole paths where names repeat."""
    names = [path.name for path in paths]
    return {path.name if names.count(path.name) == 1 else str(path): path for path in paths}


def of_photographs(paths: Sequence[Path], board: Board) -> Iterator[View | Refused]:
    """Each photograph as a view, or the reason why it is none; one that cannot be read ends all only where it is the only one."""
    for name, path in named(paths).items():
        try:
            grey = _grey(still.read(path).codes.samples)
        except UnreadableError as error:
            if len(paths) == 1:
                raise
            yield Refused(name=name, why=str(error))
            continue
        seen = find(board, grey)
        yield _view(name, grey, board, seen) if seen else Refused(name=name, why="the board was not found")


def of_clip(stream: Stream, board: Board) -> Iterator[View | Refused]:
    """Pictures evenly spread over a clip, each with the speed of its corners towards the next picture."""
    step = max(1, -(-stream.frames // MOST_LOOKED_AT))
    last: tuple[View, UInt8[np.ndarray, "rows cols"], float] | None = None
    for picture in decode.pictures(stream):
        if last is not None:
            view, before, when = last
            yield replace(view, speed=_speed(view, before, _luma(picture), picture.time - when))
            last = None
        if picture.index % step or 0 < picture.index == stream.frames - 1:  # the last one has no next to tell its motion by
            continue
        grey = _luma(picture)
        if seen := find(board, grey):
            last = _view(_frame(picture.index), grey, board, seen), grey, picture.time
        else:
            yield Refused(name=_frame(picture.index), why="the board was not found")
    if last is not None:
        yield last[0]


def chosen(found: Sequence[View | Refused], *, clip: bool, readout: float | None) -> Taken:
    """The views to calibrate on. `readout` in seconds is that of the rolling shutter, where it is known."""
    refused = [one for one in found if isinstance(one, Refused)]
    views = [one for one in found if isinstance(one, View)]
    if not views:
        raise UnreadableError(
            f"the board was found in none of {len(found)} pictures; is --board what was filmed, and sharp and whole in them?"
        )
    sizes = [(view.rows, view.cols) for view in views]
    rows, cols = max(set(sizes), key=sizes.count)
    sharp = float(np.quantile([view.edge for view in views], 0.2))
    outlines = {view.name: _outline(view) / max(view.rows, view.cols) for view in views}
    kept: list[View] = []
    for view in sorted(views, key=lambda view: (view.edge * (1 + (view.speed or 0) / (100 * cols)), view.name)):
        view, why = _moving(view, readout)
        if (view.rows, view.cols) != (rows, cols):
            why = f"it is {view.cols} x {view.rows}, the others {cols} x {rows}; another size is another mode"
        elif view.edge > _BLURRED * sharp:
            why = f"blurred: its edges are {view.edge:.1f} px wide, those of the sharp views {sharp:.1f} px"
        elif not why and kept:
            apart = [float(np.linalg.norm(outlines[view.name] - outlines[other.name], axis=1).mean()) for other in kept]
            if min(apart) < (_ALIKE_IN_CLIP if clip else _ALIKE):
                why = f"much like {kept[int(np.argmin(apart))].name}, which is sharper"
            elif len(kept) >= MOST_VIEWS:
                why = f"{MOST_VIEWS} views are enough"
        if why:
            refused.append(Refused(name=view.name, why=why))
        else:
            kept.append(view)
    order = {one.name: number for number, one in enumerate(found)}
    return Taken(
        views=tuple(sorted(kept, key=lambda view: order[view.name])),
        refused=tuple(sorted(refused, key=lambda one: order[one.name])),
        rows=rows,
        cols=cols,
        clip=clip,
        notes=_notes(kept, clip=clip, readout=readout),
    )


def coverage(views: Sequence[View], rows: int, cols: int) -> float:
    """The part of the picture in which any view has a corner."""
    return float(fields(views, rows, cols).mean())


def fields(views: Sequence[View], rows: int, cols: int) -> Bool[np.ndarray, "9 12"]:
    """Whether any view has a corner there, in equal parts of the picture."""
    seen = np.zeros((9, 12), bool)
    points = np.concatenate([view.seen.points for view in views]) / (cols, rows)
    x, y = np.clip((points * (12, 9)).astype(int), 0, (11, 8)).T
    seen[y, x] = True
    return seen


def _moving(view: View, readout: float | None) -> tuple[View, str]:
    """The view weighted for its motion, or why it is refused.

    A board that moves v px/s is sheared by v * readout * (its height / the picture's) between its first row and its last. Spread evenly,
    that is an error of shear / sqrt(12), beside which corners are known to a fifth of a pixel.
    """
    if not readout or view.speed is None:
        return view, ""
    height = float(np.ptp(view.seen.points[:, 1]))
    shear = view.speed * readout * height / view.rows
    if shear > _MOST_SHEAR:
        return view, f"in motion: the rolling shutter shifted its last row by {shear:.1f} px against its first"
    weight = 1.0 if shear < _NO_SHEAR else 0.2**2 / (0.2**2 + shear**2 / 12)
    return replace(view, weight=weight), ""


def _notes(views: Sequence[View], *, clip: bool, readout: float | None) -> tuple[str, ...]:
    notes = []
    if light := [view.name for view in views if view.weight < 1]:
        notes.append(f"{len(light)} views moved while they were read and count for less: {', '.join(light[:5])}")
    if readout is None and clip:
        notes.append("no --readout is given, so a moving board was not told from a still one; hold it still, or give the readout")
    if readout and not clip:
        notes.append("photographs do not show how fast the board moved; they are taken to be still")
    return tuple(notes)


def _view(name: str, grey: UInt8[np.ndarray, "rows cols"], board: Board, seen: Seen) -> View:
    corners = board.corners()
    first, last = corners.min(axis=0)[:2], corners.max(axis=0)[:2]
    return View(
        name=name,
        seen=seen,
        at=corners[seen.numbers],
        outline=((float(first[0]), float(first[1])), (float(last[0]), float(last[1]))),
        rows=grey.shape[0],
        cols=grey.shape[1],
        edge=_edge(grey, seen),
    )


def _edge(grey: UInt8[np.ndarray, "rows cols"], seen: Seen) -> float:
    """How wide the board's edges are, in px: its contrast by its steepest slopes."""
    x, y, width, height = cv2.boundingRect(seen.points.astype(np.float32))
    part = grey[max(y, 0) : y + height + 1, max(x, 0) : x + width + 1].astype(np.float32)
    slopes = np.hypot(cv2.Sobel(part, cv2.CV_32F, 1, 0, scale=1 / 8), cv2.Sobel(part, cv2.CV_32F, 0, 1, scale=1 / 8))
    low, high = np.quantile(part, [0.05, 0.95])
    return float((high - low) / max(float(np.quantile(slopes, 0.97)), 1e-3))


def _speed(view: View, before: UInt8[np.ndarray, "rows cols"], after: UInt8[np.ndarray, "rows cols"], seconds: float) -> float | None:
    """How fast the corners move, px/s; None where they cannot be followed."""
    start = np.ascontiguousarray(view.seen.points.reshape(-1, 1, 2), np.float32)
    end, found, _ = cv2.calcOpticalFlowPyrLK(before, after, start, np.empty_like(start), winSize=(15, 15), maxLevel=3)
    followed = np.ravel(found) == 1
    if seconds <= 0 or followed.mean() < 0.5:
        return None
    return float(np.median(np.linalg.norm((end - start)[followed], axis=-1))) / seconds


def _outline(view: View) -> Float[np.ndarray, "4 2"]:
    """Where the corners of the whole board stand, in px, even if only part of it was found."""
    homography, _ = cv2.findHomography(view.at[:, :2], view.seen.points)
    if homography is None:
        return np.zeros((4, 2))
    (left, top), (right, bottom) = view.outline
    return cv2.perspectiveTransform(np.array([[(left, top), (right, top), (right, bottom), (left, bottom)]], float), homography)[0]


def _grey(samples: np.ndarray) -> UInt8[np.ndarray, "rows cols"]:
    eight = (samples >> 8).astype(np.uint8) if samples.dtype == np.uint16 else samples
    return cv2.cvtColor(eight, cv2.COLOR_RGB2GRAY) if eight.shape[2] == 3 else np.ascontiguousarray(eight[..., 0])


def _luma(picture: Picture) -> UInt8[np.ndarray, "rows cols"]:
    """Y, or the first colour, stretched to 8 bits."""
    plane = picture.planes[0]
    if plane.dtype == np.uint8:
        return np.ascontiguousarray(plane)
    top = max(float(plane.max()), 1e-6)
    return np.clip(plane.astype(np.float32) * (255 / top), 0, 255).astype(np.uint8)


def _frame(index: int) -> str:
    return f"frame {index}"
