"""A frame as a global shutter would show it: every scanline put where the camera pointed at the middle of the frame's interval."""

from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int

from rsvideo.physics.camera import Camera, turned
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scanlines import View

_SAMPLES = 16  # of a row's exposure, over which its pose is averaged
NODES = 16  # px between the columns whose pixels are followed exactly; at 20 px of motion those between are off by 0.001 px
_CLOSE = 1e-3  # px
_ROUNDS = 40  # of the fixed point; a row that moves by 0.5 px while the next is read still needs 10


def rectified(view: View, path: Trajectory, *, flow: Flow | None = None) -> View:
    """The frame as a global shutter shows it at the pose of the middle of its interval (Lanczos, in linear light).

    What lies beyond the frame repeats its outermost pixels, streaked where the frame is moved inwards, and counts as clipped.
    `path` and `flow` are along the scanlines.
    """
    return view if view.camera.timing.row_time == 0 else resampled(view, sources(path, flow, view.camera))


def mixed(
    straight: Float[np.ndarray, "scanlines along channels"],
    latent: Float[np.ndarray, "scanlines along channels"],
    share: Float[np.ndarray, "..."] | np.float32,
) -> Float32[np.ndarray, "scanlines along channels"]:
    """The latent image with a share of 0 to 1, and for the rest the frame rectified along the same path: edges stay single."""
    return np.ascontiguousarray(straight + share * (np.clip(latent, 0, 1) - straight), np.float32)


def scanline_poses(path: Trajectory, camera: Camera) -> Float[np.ndarray, "scanlines axes"]:
    """The mean pose of each scanline's exposure, relative to the pose of the middle of the frame's interval."""
    timing = camera.timing
    return path.at(timing.sample_times(_SAMPLES)).mean(axis=1) - path.at(np.array([timing.middle]))


def read_out(
    image: Float[np.ndarray, "scanlines along channels"], poses: Float[np.ndarray, "scanlines axes"], camera: Camera
) -> Float32[np.ndarray, "scanlines along channels"]:
    """What a rolling shutter without blur reads of a global shutter's image, each scanline at its pose: the inverse of `rectified`."""
    lens = camera.intrinsics
    x, y = np.meshgrid(np.arange(lens.cols, dtype=float), np.arange(lens.rows, dtype=float))
    moved = turned(lens, x, y, np.broadcast_to(poses[:, None], (lens.rows, lens.cols, poses.shape[1])))
    at = (np.stack([x, y], axis=-1) + moved).astype(np.float32)
    pixels = np.asarray(image, np.float32)
    shown = cv2.remap(pixels, at[..., 0], at[..., 1], cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE).reshape(image.shape)
    return np.clip(shown, 0, 1)


def sources(path: Trajectory, flow: Flow | None, camera: Camera) -> Float32[np.ndarray, "scanlines along 2"]:
    """Where the frame shows each pixel of the rectified one.

    Pixel q of the scanline r(q) shows q + w(q; p) with the mean pose p of that scanline's exposure, relative to the pose of the
    middle. Of a rectified pixel X it is q = X + w(X; -p(r(q))) + t(r(q)) u(X), the fixed point of taking r from the last q; t is
    the scanline's time from the middle, and u the velocity of points beyond the path.
    """
    timing, lens, poses = camera.timing, camera.intrinsics, scanline_poses(path, camera)
    columns = nodes(lens.cols)
    x, y = np.meshgrid(columns.astype(float), np.arange(lens.rows, dtype=float))
    at = home = np.stack([x, y], axis=-1)
    drift = _everywhere(flow, columns, lens.rows) if flow else np.zeros((1, 1, 2))
    for _ in range(_ROUNDS):
        scanline = np.clip(at[..., 1], 0, timing.rows - 1)
        pose = np.stack([np.interp(scanline, np.arange(timing.rows), p) for p in poses.T], axis=-1)
        when = scanline * timing.row_time + timing.exposure / 2 - timing.middle
        last, at = at, home + turned(lens, x, y, -pose) + when[..., None] * drift
        if np.abs(at - last).max() < _CLOSE:
            break
    return between(at.astype(np.float32), columns)


def nodes(cols: int) -> Int[np.ndarray, " nodes"]:
    """The columns whose pixels are followed exactly: every NODES px, and the last."""
    return np.unique(np.r_[np.arange(0, cols, NODES), cols - 1])


def between(at: Float32[np.ndarray, "rows nodes 2"], columns: Int[np.ndarray, " nodes"]) -> Float32[np.ndarray, "rows cols 2"]:
    """Places of every column, from those of the nodes by linear interpolation."""
    every = np.arange(columns[-1] + 1)
    low = np.clip(np.searchsorted(columns, every, side="right") - 1, 0, max(len(columns) - 2, 0))
    high = np.minimum(low + 1, len(columns) - 1)
    share = ((every - columns[low]) / np.maximum(columns[high] - columns[low], 1))[:, None].astype(np.float32)
    return at[:, low] + share * (at[:, high] - at[:, low])


def _everywhere(flow: Flow, columns: np.ndarray, rows: int) -> Float[np.ndarray, "rows columns 2"]:
    """The field in these columns, from that of every few rows."""
    some = nodes(rows)
    found = flow.at(np.stack(np.meshgrid(columns, some), axis=-1).reshape(-1, 2).astype(float)).reshape(len(some), -1)
    return np.stack([np.interp(np.arange(rows), some, column) for column in found.T], axis=1).reshape(rows, len(columns), 2)


def resampled(view: View, at: Float[np.ndarray, "rows cols 2"]) -> View:
    """The frame with each pixel taken from its place in `at` (Lanczos, in linear light)."""
    x, y = np.ascontiguousarray(at[..., 0]), np.ascontiguousarray(at[..., 1])
    clipped = view.clipped.astype(np.float32)
    pixels = cv2.remap(view.pixels, x, y, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE).reshape(view.pixels.shape)
    beyond = cv2.remap(clipped, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(1.0,) * 4).reshape(clipped.shape)
    return replace(view, pixels=np.clip(pixels, 0, 1), clipped=beyond > 0)
