"""Graphics over a picture: captions, logos, time stamps, bars, and whatever else is fixed to the camera.

They stay in place while the scene moves. No camera's motion has blurred or displaced them, so what is done to the scene would bend and
double them, and their corners would pretend that the camera stands still. So they are taken off before the motion is found, and laid
over the result as they were.

A pixel stays from one picture to another where its code changes by less than it would if the gradients about it had moved by a fraction
of a pixel. Single pixels of a scene may do so; whole neighbourhoods do not, in pictures that are far apart, between which the scene moves.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, starmap

import cv2
import numpy as np
from jaxtyping import Bool, Float, Float32, UInt8
from scipy.ndimage import binary_fill_holes, distance_transform_edt

from rsvideo.frame import Frame, FrameResult
from rsvideo.physics.luminance import luminance
from rsvideo.restoration.tracks import codes

PICTURES = 16  # of a run, evenly spread, that are compared, each with the next, and with that half the run behind it
FEWEST = 7  # pairs of neighbours among them between which the scene moves, or nothing is found
STAYS, MOVES = 0.04, 0.25  # (0.2 px)^2 and (0.5 px)^2: change of code^2 over gradient^2 up to which, and from which on, a place does
TEXTURE = 60.0  # codes^2 / px^2, of the gradients about a place, below which it tells nothing; origin: by trial
FIRM = 0.03  # of the pixels that stay of a graphic, those that have to stay with all about them; 0.02 to 0.05 do alike
LEAST_FIRM = 4  # px, the same
OFTEN = 0.5  # of the pairs of neighbours, in which a pixel of graphics stays: a clock's digits change
MOSTLY = 0.8  # of the distant pairs, in which a part of graphics stays with all about it; and of pictures, whose bars are equally high
CELLS, MOVING_CELLS = 3, 0.7  # a side of the grid over the picture; of its cells in which anything moves or much stays, those that move
LARGE = 0.2  # of a cell, with texture, which may stay though little of its scene moves
INSET = 1 / 4  # of the picture, which a frame that stays may enclose as a picture of its own; more is the scene, in a frame
MOST = 1 / 3  # of the picture, covered by graphics; else the camera stands still, and something moves before it
_LEAST = 0.01  # of a cell moves, or it tells nothing
_WIDE, _ABOUT = 9, 5  # px: what is compared to tell whether the scene moves, and whether a place stays
_LETTERS = 1 / 45  # of the picture's shorter side, by which parts of one caption are apart; origin: by trial
_RIM = 3  # px about graphics, of their smooth edges and of what the codec rings
_BLACK, _EVEN = 24, 3  # codes of a bar at most; px by which its height may differ


@dataclass(frozen=True, kw_only=True, eq=False)
class Lifted:
    """What was taken off a frame."""

    pixels: Float[np.ndarray, "covered channels"]
    clipped: Bool[np.ndarray, "covered channels"]


class Overlay:
    """Where graphics lie over all pictures of a run."""

    def __init__(self, covered: Bool[np.ndarray, "rows cols"]) -> None:
        self.covered = covered
        nearest = np.asarray(distance_transform_edt(covered, return_distances=False, return_indices=True))[:, covered]
        depth = np.linalg.norm(nearest - np.nonzero(covered), axis=0)
        self._opacity = np.minimum(depth / _RIM, 1).astype(np.float32)[:, None]  # they are laid over the result with soft edges
        self._nearest = tuple(nearest)  # pixel of the scene

    @property
    def share(self) -> float:
        """Of the picture."""
        return float(self.covered.mean())

    @classmethod
    def of(cls, frames: Iterable[Frame]) -> "Overlay | None":
        """Those of successive frames; None where nothing stays while the scene moves, or where so much does that the camera may rest."""
        pictures = [codes(luminance(frame.pixels)) for frame in frames]
        if len(pictures) <= FEWEST:
            return None
        covered = _covered([pictures[k] for k in spread(len(pictures))])
        return cls(covered) if covered.any() and not covered.all() else None

    def cleared(self, frame: Frame) -> Frame:
        """The frame without them: the scene about them goes on there, and counts as unobserved."""
        pixels, clipped = frame.pixels.copy(), frame.clipped.copy()
        pixels[self.covered] = pixels[self._nearest]
        clipped[self.covered] = True
        return replace(frame, pixels=pixels, clipped=clipped)

    def lifted(self, frame: Frame) -> Lifted:
        """What `cleared` takes off."""
        return Lifted(pixels=frame.pixels[self.covered], clipped=frame.clipped[self.covered])

    def over(self, result: FrameResult, graphics: Lifted) -> FrameResult:
        """What became of a frame that was cleared, with its graphics over it as they were."""
        pixels, clipped = result.frame.pixels.copy(), result.frame.clipped.copy()
        pixels[self.covered], clipped[self.covered] = graphics.pixels, graphics.clipped
        frame = replace(result.frame, pixels=pixels, clipped=clipped)
        if not result.verdict.changed:
            return replace(result, frame=frame, latent=pixels, overlaid=self.share)
        latent = result.latent.copy()
        latent[self.covered] += self._opacity * (graphics.pixels - latent[self.covered])
        return replace(result, frame=frame, latent=latent, overlaid=self.share)


def spread(count: int) -> list[int]:
    """Which pictures of a run of so many are compared."""
    return np.linspace(0, count - 1, min(PICTURES, count)).round().astype(int).tolist()


def _covered(pictures: Sequence[UInt8[np.ndarray, "rows cols"]]) -> Bool[np.ndarray, "rows cols"]:
    """Where graphics lie over pictures of 8 bits."""
    covered = _bars(pictures)
    inside = np.ix_(~covered.all(axis=1), ~covered.all(axis=0))
    if covered.all():
        return covered
    inner = [picture[inside] for picture in pictures]
    stays, firm = np.zeros((2, *inner[0].shape), np.uint8)
    moving = 0
    for pair in starmap(_Pair.of, pairwise(map(_Picture.of, inner))):
        stays, moving = stays + (pair.moving & pair.single), moving + pair.moving
    if moving < FEWEST:
        return np.zeros_like(covered)
    distant = inner[len(inner) // 2 :]  # by then what is far away has moved, too
    for pair in map(_Pair.of, map(_Picture.of, inner), map(_Picture.of, distant)):
        firm = firm + pair.firm
    graphics = _together(np.greater_equal(stays, OFTEN * moving), np.greater_equal(firm, MOSTLY * len(distant)))
    if graphics.mean() <= MOST:
        covered[inside] |= graphics
    return covered


def _together(stays: Bool[np.ndarray, "rows cols"], firm: Bool[np.ndarray, "rows cols"]) -> Bool[np.ndarray, "rows cols"]:
    """Whole graphics, of pixels that stay, and of those among them that do with all about them."""
    reach = 2 * round(_LETTERS * min(stays.shape)) + 1
    joined = cv2.morphologyEx(stays.astype(np.uint8), cv2.MORPH_CLOSE, np.ones((reach, reach), np.uint8))
    count, labels = cv2.connectedComponents(joined)
    parts = np.asarray(labels, np.intp)
    sure, size = (np.bincount(parts[each], minlength=count) for each in (firm, stays))
    whole = sure >= np.maximum(LEAST_FIRM, FIRM * size)
    whole[0] = False
    return _with_insets(cv2.dilate(whole[parts].astype(np.uint8), np.ones((2 * _RIM + 1, 2 * _RIM + 1), np.uint8)) > 0)


def _with_insets(graphics: Bool[np.ndarray, "rows cols"]) -> Bool[np.ndarray, "rows cols"]:
    """Graphics, and what they enclose: a picture in the picture, whose scene is another one, or the inside of a letter."""
    enclosed = np.asarray(binary_fill_holes(graphics), bool) & ~graphics
    count, labels = cv2.connectedComponents(enclosed.astype(np.uint8))
    parts = np.asarray(labels, np.intp)
    size = np.bincount(parts[enclosed], minlength=count)
    return graphics | (enclosed & (size <= INSET * graphics.size)[parts])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Picture:
    """A picture's codes, and the squares of their gradients, in the mean over small and over wide windows."""

    codes: Float32[np.ndarray, "rows cols"]
    slope: Float32[np.ndarray, "rows cols"]  # codes^2 / px^2, as the next
    texture: Float32[np.ndarray, "rows cols"]

    @classmethod
    def of(cls, picture: UInt8[np.ndarray, "rows cols"]) -> "_Picture":
        codes = picture.astype(np.float32)
        squares = (cv2.Sobel(codes, -1, 1, 0, ksize=1) ** 2 + cv2.Sobel(codes, -1, 0, 1, ksize=1) ** 2) / 4
        return cls(codes=codes, slope=_mean(squares, _ABOUT), texture=_mean(squares, _WIDE))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """What stays from one picture to the next."""

    moving: bool  # most of the scene does not
    single: Bool[np.ndarray, "rows cols"]  # pixels
    firm: Bool[np.ndarray, "rows cols"]  # with all about them

    @classmethod
    def of(cls, first: _Picture, second: _Picture) -> "_Pair":
        change = (second.codes - first.codes) ** 2
        texture = (first.texture + second.texture) / 2
        moved = (texture > TEXTURE) & (_mean(change, _WIDE) > MOVES * texture)
        least = np.minimum(first.slope, second.slope)
        allowed = np.where(least > TEXTURE, STAYS * least, 0)
        firm = _mean(change, _ABOUT) < allowed
        gone, kept = (cv2.resize(each.astype(np.float32), (CELLS, CELLS), interpolation=cv2.INTER_AREA) for each in (moved, firm))
        moving = (gone > _LEAST) & ((gone > kept) | (kept < LARGE))
        counted = moving | (kept >= LARGE)
        enough = bool(counted.any()) and float(moving[counted].mean()) >= MOVING_CELLS
        return cls(moving=enough, single=change < allowed, firm=firm)


def _mean(image: Float32[np.ndarray, "rows cols"], side: int) -> Float32[np.ndarray, "rows cols"]:
    return cv2.boxFilter(image, -1, (side, side))


def _bars(pictures: Sequence[UInt8[np.ndarray, "rows cols"]]) -> Bool[np.ndarray, "rows cols"]:
    """Black bars along the sides, equally high in most pictures."""
    out = np.zeros(pictures[0].shape, bool)
    for turns in range(4):
        dark = np.array([(np.rot90(picture, turns) <= _BLACK).all(axis=1) for picture in pictures])
        heights = np.where(dark.all(axis=1), dark.shape[1], np.argmin(dark, axis=1))
        height = int(np.median(heights))
        if height > _EVEN and np.mean(abs(heights - height) <= _EVEN) >= MOSTLY:
            np.rot90(out, turns)[: height + _RIM] = True
    return out
