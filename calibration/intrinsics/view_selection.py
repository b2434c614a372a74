"""Which views of a board to calibrate on: the sharp, still and varied ones; of each other one, why not."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np
from jaxtyping import Bool, Float

from calibration.intrinsics.views import Refused, View
from rsvideo.config.files import UnreadableError

MOST_VIEWS = 40  # more add time and little else
_SHARP = 0.2  # quantile of the edges' widths that sharp views have
_BLURRED = 1.6  # edges that many times as wide as the sharp views' are blurred
_MOTION_PENALTY = 100  # picture widths a second; that fast a view counts as if its edges were twice as wide
_SIMILAR_IN_CLIP, _SIMILAR = 0.06, 0.005  # mean distance of the boards' corners, as part of the picture; photographs are taken on purpose
_MOST_SHEAR, _LEAST_SHEAR = 1.0, 0.3  # px by which motion may shift a board's rows against each other; less than the latter is harmless
_CORNER_STD = 0.2  # px, of a corner that is found in a sharp view
_FIELDS = (9, 12)  # rows and columns of equal parts of the picture, in which corners are counted
_NAMES = 5  # views that a note names


@dataclass(frozen=True, kw_only=True, eq=False)
class Selection:
    """The views of one camera mode."""

    views: tuple[View, ...]
    refused: tuple[Refused, ...]
    rows: int
    cols: int
    clip: bool
    notes: tuple[str, ...] = ()


def select(found: Sequence[View | Refused], *, clip: bool, readout: float | None) -> Selection:
    """The views to calibrate on. `readout` in seconds is that of the rolling shutter; None where it is not given."""
    refused = [one for one in found if isinstance(one, Refused)]
    views = [one for one in found if isinstance(one, View)]
    if not views:
        raise UnreadableError(
            f"the board was found in none of {len(found)} pictures; is --board what was filmed, and sharp and whole in them?"
        )
    sizes = [(view.rows, view.cols) for view in views]
    rows, cols = max(set(sizes), key=sizes.count)
    sharp = float(np.quantile([view.edge_width for view in views], _SHARP))
    outlines = {view.name: _outline(view) / max(view.rows, view.cols) for view in views}
    kept: list[View] = []
    for view in sorted(views, key=lambda view: (view.edge_width * (1 + (view.speed or 0) / (_MOTION_PENALTY * cols)), view.name)):
        view, reason = _weighted_by_motion(view, readout)
        reason = _unfit(view, rows, cols, sharp) or reason or _superfluous(view, kept, outlines, clip=clip)
        if reason:
            refused.append(Refused(name=view.name, reason=reason))
        else:
            kept.append(view)
    order = {one.name: number for number, one in enumerate(found)}
    return Selection(
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
    down, across = _FIELDS
    covered = np.zeros(_FIELDS, bool)
    points = np.concatenate([view.corners.points for view in views]) / (cols, rows)
    x, y = np.clip((points * (across, down)).astype(int), 0, (across - 1, down - 1)).T
    covered[y, x] = True
    return covered


def _unfit(view: View, rows: int, cols: int, sharp: float) -> str:
    """Why the view by itself is refused, if it is."""
    if (view.rows, view.cols) != (rows, cols):
        return f"it is {view.cols} x {view.rows}, the others {cols} x {rows}; another size is another mode"
    if view.edge_width > _BLURRED * sharp:
        return f"blurred: its edges are {view.edge_width:.1f} px wide, those of the sharp views {sharp:.1f} px"
    return ""


def _superfluous(view: View, kept: Sequence[View], outlines: dict[str, np.ndarray], *, clip: bool) -> str:
    """Why the view is refused beside those that are kept, if it is."""
    if not kept:
        return ""
    distances = [float(np.linalg.norm(outlines[view.name] - outlines[other.name], axis=1).mean()) for other in kept]
    if min(distances) < (_SIMILAR_IN_CLIP if clip else _SIMILAR):
        return f"much like {kept[int(np.argmin(distances))].name}, which is sharper"
    return f"{MOST_VIEWS} views are enough" if len(kept) >= MOST_VIEWS else ""


def _weighted_by_motion(view: View, readout: float | None) -> tuple[View, str]:
    """The view weighted for its motion, or why it is refused.

    A board that moves v px/s is sheared by v * readout * (its height / the picture's) between its first row and its last. Spread evenly,
    that is an error of shear / sqrt(12), beside which corners are found to a fifth of a pixel.
    """
    if not readout or view.speed is None:
        return view, ""
    height = float(np.ptp(view.corners.points[:, 1]))
    shear = view.speed * readout * height / view.rows
    if shear > _MOST_SHEAR:
        return view, f"in motion: the rolling shutter shifted its last row by {shear:.1f} px against its first"
    weight = 1.0 if shear < _LEAST_SHEAR else _CORNER_STD**2 / (_CORNER_STD**2 + shear**2 / 12)
    return replace(view, weight=weight), ""


def _notes(views: Sequence[View], *, clip: bool, readout: float | None) -> tuple[str, ...]:
    notes = []
    if light := [view.name for view in views if view.weight < 1]:
        notes.append(f"{len(light)} views moved while they were read and count for less: {', '.join(light[:_NAMES])}")
    if readout is None and clip:
        notes.append("no --readout is given, so a moving board was not told from a still one; hold it still, or give the readout")
    if readout and not clip:
        notes.append("photographs do not show how fast the board moved; they are taken to be still")
    return tuple(notes)


def _outline(view: View) -> Float[np.ndarray, "4 2"]:
    """Where the corners of the whole board stand, in px, even if only part of it was found."""
    homography, _ = cv2.findHomography(view.object_points[:, :2], view.corners.points)
    if homography is None:
        return np.zeros((4, 2))
    (left, top), (right, bottom) = view.outline
    return cv2.perspectiveTransform(np.array([[(left, top), (right, top), (right, bottom), (left, bottom)]], float), homography)[0]
