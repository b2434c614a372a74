"""How the points of a scene move from one frame to the next, each observed at its own scanline's time."""

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from rsvideo.restoration.resolution import halved_image

MOST = 400  # points a frame; origin: by trial
FEWEST = 24  # below, a pair of frames shows no motion: a cut, or no texture; origin: by trial
TRACKED = 0.15  # px; how well a point is followed at best
WINDOW = 31  # px; wider than the blur, so that both frames' versions of a point lie inside
LONGEST = 40.0  # px of blur, up to which it still shows; origin: by trial
LEVELS = 4  # of the pyramid: displacements up to about 15 px * 2^4
SMALLEST = 128  # px, the shorter side of the smallest frames in which points are followed; origin: by trial
_WOBBLE = 6.0  # px; how far the scanlines' own motion may lift a point off the homography of the whole frame
_RETURN = 1.0  # px; tracked there and back, a point must come home this closely
_QUALITY = 0.01  # of the strongest corner, below which a corner is too faint (Shi & Tomasi's measure)
_BLOCK = 9  # px, over which a corner is measured
_CLOSEST = 6.0  # px between corners at least
_MARGIN = WINDOW // 4  # px beside the frame's border, where half of a window or more would lie outside; origin: by trial
NEAREST = 5  # points, whose median says how what lies between them moves
_RIGID = 0.4  # of the points that came home, which must fit one homography: fewer are two scenes, or one that moves by itself


@dataclass(frozen=True, kw_only=True, eq=False)
class Tracks:
    """Points that two frames show; (column, row) as observed."""

    before: Float[np.ndarray, "points 2"]
    after: Float[np.ndarray, "points 2"]
    scale: int = 1  # px of the frame to one of the pictures in which they were followed

    @property
    def error(self) -> float:
        """Px, of a point at best."""
        return self.scale * TRACKED

    @property
    def moved(self) -> float:
        """How far the points move, px; the median, 0 without any."""
        return float(np.median(np.linalg.norm(self.after - self.before, axis=1))) if len(self.before) else 0.0

    @property
    def farthest(self) -> float:
        """How far nine in ten points move at most, px; infinite without any."""
        return float(np.percentile(np.linalg.norm(self.after - self.before, axis=1), 90)) if len(self.before) else np.inf

    def enlarged(self, scale: int) -> "Tracks":
        """The points as frames show them that are so many times as large."""
        before, after = (scale * (points + 0.5) - 0.5 for points in (self.before, self.after))
        return Tracks(before=before, after=after, scale=scale * self.scale)


def codes(luminance: Float[np.ndarray, "rows cols"]) -> UInt8[np.ndarray, "rows cols"]:
    """The picture as it is tracked: the root of light, where shadows have contrast too."""
    return np.round(255 * np.sqrt(np.clip(luminance, 0, 1))).astype(np.uint8)


def track(before: UInt8[np.ndarray, "rows cols"], after: UInt8[np.ndarray, "rows cols"], exposed: float = 0.0) -> Tracks:
    """Corners of the first frame found again in the second (Lucas-Kanade) that move as one rigid scene; none at a cut.

    `exposed` is the share of the time from frame to frame in which each of them was exposed. Where the blur that follows is longer than
    a window shows, points are followed in frames of half the size, a quarter or an eighth.
    """
    found, scale = _followed(before, after), 1
    while exposed and min(before.shape) >= 2 * SMALLEST and not 0 < exposed * found.moved <= LONGEST * scale:
        before, after, scale = halved_image(before), halved_image(after), 2 * scale
        coarse = _followed(before, after).enlarged(scale)
        if exposed * coarse.moved > LONGEST:  # what moves less would have been found before: two scenes, at a cut
            found = coarse
    return found


def displaced(links: Sequence[Tracks], places: Float[np.ndarray, "places 2"]) -> Float[np.ndarray, "places 2"]:
    """How far what a first frame shows at these places (column, row) has moved after so many links, px: each as the points near it."""
    at = places.astype(float)
    for link in links:
        nearest = np.argsort(((at[:, None] - link.before) ** 2).sum(axis=-1), axis=1)[:, :NEAREST]
        at = at + np.median((link.after - link.before)[nearest], axis=1)
    return at - places


def _followed(before: UInt8[np.ndarray, "rows cols"], after: UInt8[np.ndarray, "rows cols"]) -> Tracks:
    """Corners of the first frame found again in the second, in these frames."""
    rows, cols = before.shape
    apart = max(_CLOSEST, np.sqrt(rows * cols / MOST) / 2)
    corners = cv2.goodFeaturesToTrack(before, MOST, _QUALITY, apart, blockSize=_BLOCK)
    nothing = np.zeros((0, 2))
    if corners is None:
        return Tracks(before=nothing, after=nothing)
    options = {"winSize": (WINDOW, WINDOW), "maxLevel": LEVELS}
    found, there, _ = cv2.calcOpticalFlowPyrLK(before, after, corners, np.empty_like(corners), **options)
    home, back, _ = cv2.calcOpticalFlowPyrLK(after, before, found, np.empty_like(corners), **options)
    inside = ((found >= _MARGIN) & (found <= np.array([cols, rows]) - 1 - _MARGIN)).all(axis=(1, 2))
    near = (there[:, 0] == 1) & (back[:, 0] == 1) & inside & (np.linalg.norm(home - corners, axis=2)[:, 0] < _RETURN)
    first, second = corners[near, 0], found[near, 0]
    if len(first) < FEWEST:
        return Tracks(before=nothing, after=nothing)
    _, same = cv2.findHomography(first, second, cv2.RANSAC, _WOBBLE)
    kept = np.zeros(len(first), bool) if same is None else same[:, 0] == 1
    if kept.sum() < max(FEWEST, _RIGID * len(first)):
        return Tracks(before=nothing, after=nothing)
    return Tracks(before=first[kept].astype(float), after=second[kept].astype(float))
