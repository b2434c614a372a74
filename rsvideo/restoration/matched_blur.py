"""Points followed once more, in windows that are blurred alike.

A point observes the path at the centre of its scanline's PSF. Where two frames are blurred differently, the windows that resemble each
other most are not those with the centres of their PSFs in the same place. But convolution commutes,

    k' * (k * l) = k * (k' * l),

so each window is blurred with the PSF that a path predicts of the other frame, and then both show the same (after Jin, Favaro & Cipolla,
Visual tracking in the presence of motion blur, CVPR 2005). Of the second frame's window, scanlines are displaced as the path says.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import cv2
import numpy as np
from jaxtyping import Float, Float32, UInt8

from rsvideo.physics.camera import Intrinsics, lever, turned
from rsvideo.physics.psf import psfs_from_traces
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Spline
from rsvideo.restoration.point_equations import NODES
from rsvideo.restoration.resolution import halved_image
from rsvideo.restoration.tracks import FEWEST, LONGEST, WINDOW, Tracks

FARTHEST = 2.0  # px from where a point was followed to before; what is found farther away is another one
_INSTANTS = 48  # of an exposure, that a PSF is drawn from
_ROUNDS = 4  # of the fixed point that says where the second frame shows a scanline's scene
_STEPS = 6  # of Gauss-Newton
_SPARE = 4  # px about a window, into which it may move
_FLAT = 1e-3  # of the normal matrix, added to its diagonal: codes without texture

_Points = Float[np.ndarray, "points 2"]
_Windows = Float32[np.ndarray, "points side side"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Exposed:
    """A frame as it is tracked, and the path that it was exposed along."""

    picture: UInt8[np.ndarray, "rows cols"]
    path: Spline
    opens: float  # s of the path, when the first scanline does
    timing: ShutterTiming
    intrinsics: Intrinsics

    def poses(self, rows: Float[np.ndarray, " n"]) -> Float[np.ndarray, "n instants axes"]:
        """Of scanlines, at instants of their exposures."""
        within = self.timing.exposure * (np.arange(_INSTANTS) + 0.5) / _INSTANTS
        return self.path.at(self.opens + rows[:, None] * self.timing.row_time + within)

    @cached_property
    def means(self) -> Float[np.ndarray, "scanlines axes"]:
        """The mean pose of every few scanlines."""
        return self.poses(self._nodes).mean(axis=1)

    @property
    def _nodes(self) -> Float[np.ndarray, " scanlines"]:
        return np.linspace(0, self.timing.rows - 1, NODES)

    def scene(self, at: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """How far from a pixel the place lies that it shows of the scene, at the mean pose of its scanline."""
        pose = np.stack([np.interp(at[..., 1], self._nodes, mean) for mean in self.means.T], axis=-1)
        return turned(self.intrinsics, at[..., 0], at[..., 1], pose)

    def traces(self, points: _Points) -> Float[np.ndarray, "points instants 2"]:
        """What the light of each point draws during its exposure, about the centre."""
        poses = self.poses(points[:, 1])
        levers = lever(self.intrinsics, points[:, 0], points[:, 1], poses.shape[-1])
        return np.einsum("nca,nia->nic", levers, poses - poses.mean(axis=1, keepdims=True))


def followed_again(tracks: Tracks, first: Exposed, second: Exposed) -> Tracks:
    """The points of two frames, each anew where it shows best in the second one, in pictures of the size in which it was followed before.

    What is found too far from there is left out. Where points are too few or that leaves too few, or where a PSF is longer than windows
    show, all remain as they were.
    """
    if len(tracks.before) < FEWEST:
        return tracks
    scale = tracks.scale
    traces = first.traces(tracks.before) / scale, second.traces(tracks.after) / scale
    reach = max(float(np.abs(trace).max()) for trace in traces)
    if reach > LONGEST:
        return tracks
    half = 1 + math.ceil(reach)
    side = WINDOW + 2 * (_SPARE + half)
    lean = _lean(tracks, first, second, side)
    shown = _cut(first, tracks.before, np.zeros_like(lean), scale), _cut(second, tracks.after, lean, scale)
    one, other = (
        np.stack([cv2.filter2D(window, -1, psf) for window, psf in zip(windows, psfs_from_traces(each, half), strict=True)])
        for windows, each in zip(shown, reversed(traces), strict=True)
    )
    moved = _displacements(one[:, half:-half, half:-half], other[:, half:-half, half:-half])
    near = np.abs(moved).max(axis=1) < FARTHEST
    if near.sum() < FEWEST:
        return tracks
    return replace(tracks, before=tracks.before[near], after=(tracks.after + scale * moved)[near])


def _lean(tracks: Tracks, first: Exposed, second: Exposed, side: int) -> Float[np.ndarray, "points side 2"]:
    """How far the second frame displaces each scanline of a window against the middle one, px, if the first displaces none."""
    up = np.stack([np.zeros(side), tracks.scale * (np.arange(side) - side // 2)], axis=-1)
    there, here = tracks.before[:, None] + up, tracks.after[:, None] + up
    scene = there + first.scene(there)
    at = here
    for _ in range(_ROUNDS):
        at = scene - second.scene(at)
    apart = at - here
    return apart - apart[:, side // 2 : side // 2 + 1]


def _cut(frame: Exposed, points: _Points, lean: Float[np.ndarray, "points side 2"], scale: int) -> _Windows:
    """The window about each point in a picture so many times as small, its scanlines displaced by `lean`, which is in px of the frame."""
    picture, small = frame.picture, 1
    while small < scale:
        picture, small = halved_image(picture), 2 * small
    side = lean.shape[1]
    middle = ((points + 0.5) / scale - 0.5)[:, None] + lean / scale
    away = np.arange(side) - side // 2
    x = middle[..., 0, None] + away
    y = np.broadcast_to((middle[..., 1] + away)[..., None], x.shape)
    x, y = (np.ascontiguousarray(each.reshape(len(points), -1), np.float32) for each in (x, y))
    return cv2.remap(picture.astype(np.float32), x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).reshape(-1, side, side)


def _displacements(one: _Windows, other: _Windows) -> _Points:
    """By how many px each window of `other` is to be moved to be like that of `one` (Gauss-Newton)."""
    side = one.shape[1] - 2 * _SPARE
    inner, middle = np.s_[:, _SPARE:-_SPARE, _SPARE:-_SPARE], one.shape[1] // 2
    both = (one + other) / 2
    slopes = np.stack([np.gradient(both, axis=axis)[inner] for axis in (2, 1)], axis=1)
    normal = np.einsum("naij,nbij->nab", slopes, slopes) + _FLAT * np.eye(2)
    moved = np.zeros((len(one), 2))
    for _ in range(_STEPS):
        shown = [cv2.getRectSubPix(window, (side, side), at) for window, at in zip(other, middle + moved, strict=True)]
        step = np.linalg.solve(normal, np.einsum("naij,nij->na", slopes, one[inner] - shown)[..., None])[..., 0]
        moved = np.clip(moved + step, -FARTHEST, FARTHEST)
    return moved
