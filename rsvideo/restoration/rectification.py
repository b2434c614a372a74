"""A frame as a global shutter would show it: every scanline put where the camera pointed at the middle of the frame's interval."""

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int

from rsvideo.physics.camera import Camera, turned
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration import device_frame
from rsvideo.restoration.nodes import NODES, between, nodes
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scanlines import View
from rsvideo.restoration.settings import Device

LAMP = 0.9  # of white, in linear light: as bright as that


class Share(NamedTuple):
    """A latent image, and how much of it is shown."""

    latent: Float[np.ndarray, "scanlines along channels"]
    share: Float[np.ndarray, "..."] | np.float32  # 0 to 1, of all pixels, or (scanlines, along, 1)
    reach: int = 0  # px from the borders within which it is `held`
    lamp: float = LAMP


_SAMPLES = 16  # of a row's exposure, over which its pose is averaged
_FEW_ROWS = 256  # of which pixels are followed on a GPU, at least; those between are off by 0.01 px where a hand shakes 10 px at 100 Hz
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


def held(
    latent: Float[np.ndarray, "scanlines along channels"],
    straight: Float[np.ndarray, "scanlines along channels"],
    reach: int,
    lamp: float = LAMP,
) -> Float[np.ndarray, "scanlines along channels"]:
    """A latent image which, less than `reach` px from a border and from a lamp, is nowhere darker than all that the rectified frame has
    within `reach` px.

    The blur there has mixed in what lies beyond the frame, which no data show: beside a lamp it would come out black.
    """
    if not reach:
        return latent
    window, latent = np.ones((2 * reach + 1,) * 2, np.uint8), latent.copy()
    for side in range(4):
        inner, shown = (np.rot90(image, side)[: 2 * reach] for image in (latent, straight))
        near = np.ascontiguousarray(shown)
        least, most = (extreme(near, window).reshape(near.shape)[:reach] for extreme in (cv2.erode, cv2.dilate))
        inner[:reach] = np.where(most >= lamp, np.maximum(inner[:reach], least), inner[:reach])
    return latent


def straightened(
    view: View,
    path: Trajectory | None,
    *,
    flow: Flow | None = None,
    moved: float = 1.0,
    device: Device = "cpu",
    latent: Share | None = None,
) -> Float32[np.ndarray, "scanlines along channels"]:
    """The frame, `moved` of it (0 to 1) rectified along a path if there is one, and mixed with a latent image by its share."""
    lens, pixels = view.camera.intrinsics, view.pixels
    if view.camera.timing.row_time == 0:
        path = None
    if device == "cuda":
        step = max(1, lens.rows // _FEW_ROWS)
        rows, columns = nodes(lens.rows, step), nodes(lens.cols)
        drift = None if path is None else _followed(path, flow, view.camera, rows, columns) - _grid(rows, columns)
        return device_frame.straightened(pixels, drift, (step, NODES), moved, latent)
    if path is not None:
        pixels = pixels + np.float32(moved) * (_lanczos(pixels, *sources(path, flow, view.camera)) - pixels)
    return pixels if latent is None else mixed(pixels, held(latent.latent, pixels, latent.reach, latent.lamp), latent.share)


def scanline_poses(path: Trajectory, camera: Camera) -> Float[np.ndarray, "scanlines axes"]:
    """The mean pose of each scanline's exposure, relative to the pose of the middle of the frame's interval."""
    timing = camera.timing
    return path.at(timing.sample_times(_SAMPLES)).mean(axis=1) - path.at(np.array([timing.middle]))


def read_out(
    image: Float[np.ndarray, "scanlines along channels"],
    poses: Float[np.ndarray, "scanlines axes"],
    camera: Camera,
    flow: Flow | None = None,
) -> Float32[np.ndarray, "scanlines along channels"]:
    """What a rolling shutter without blur reads of a global shutter's image, each scanline at its pose: the inverse of `rectified`."""
    timing = camera.timing
    when = timing.row_start() + timing.exposure / 2 - timing.middle
    drift = flow and flow.everywhere(nodes(camera.intrinsics.cols), camera.intrinsics.rows)
    return _lanczos(np.asarray(image, np.float32), *sampled_at(poses, when, camera, drift))


def displaced(
    path: Trajectory, camera: Camera, flow: Flow | None = None
) -> Callable[[Float[np.ndarray, "rows cols"]], Float[np.ndarray, "rows cols"]]:
    """How a path, and a field of velocities beside it, displace the scanlines of a picture that they do not blur."""
    poses = scanline_poses(path, camera)
    return lambda image: read_out(image[..., None], poses, camera, flow)[..., 0]


def sampled_at(
    poses: Float[np.ndarray, "scanlines axes"],
    when: Float[np.ndarray, " scanlines"],
    camera: Camera,
    drift: Float[np.ndarray, "scanlines nodes 2"] | None,
) -> Float32[np.ndarray, "2 scanlines along"]:
    """Where a global shutter's image is sampled by scanlines, each at its pose, so many seconds from the middle of the frame's interval:
    the columns, and the rows. `drift` is the field beside the path, at every few columns."""
    lens, columns = camera.intrinsics, nodes(camera.intrinsics.cols)
    home = _grid(np.arange(lens.rows), columns)
    at = home + turned(lens, home[..., 0], home[..., 1], np.broadcast_to(poses[:, None], (*home.shape[:2], poses.shape[1])))
    if drift is not None:
        at = at - when[:, None, None] * drift
    return between(at.astype(np.float32), columns)


def sources(path: Trajectory, flow: Flow | None, camera: Camera) -> Float32[np.ndarray, "2 scanlines along"]:
    """Where the frame shows each pixel of the rectified one: its column, and its row.

    Pixel q of the scanline r(q) shows q + w(q; p) with the mean pose p of that scanline's exposure, relative to the pose of the
    middle. Of a rectified pixel X it is q = X + w(X; -p(r(q))) + t(r(q)) u(X), the fixed point of taking r from the last q; t is
    the scanline's time from the middle, and u the velocity of points beyond the path.
    """
    columns = nodes(camera.intrinsics.cols)
    return between(_followed(path, flow, camera, np.arange(camera.intrinsics.rows), columns).astype(np.float32), columns)


def _followed(
    path: Trajectory, flow: Flow | None, camera: Camera, rows: Int[np.ndarray, " rows"], columns: Int[np.ndarray, " columns"]
) -> Float[np.ndarray, "rows columns 2"]:
    """The same of the pixels in these rows and columns."""
    timing, lens, poses = camera.timing, camera.intrinsics, scanline_poses(path, camera)
    at = home = _grid(rows, columns)
    x, y = home[..., 0], home[..., 1]
    drift = flow.everywhere(columns, lens.rows)[rows] if flow else np.zeros((1, 1, 2))
    for _ in range(_ROUNDS):
        scanline = np.clip(at[..., 1], 0, timing.rows - 1)
        pose = np.stack([np.interp(scanline, np.arange(timing.rows), p) for p in poses.T], axis=-1)
        when = scanline * timing.row_time + timing.exposure / 2 - timing.middle
        last, at = at, home + turned(lens, x, y, -pose) + when[..., None] * drift
        if np.abs(at - last).max() < _CLOSE:
            break
    return at


def _grid(rows: Int[np.ndarray, " rows"], columns: Int[np.ndarray, " columns"]) -> Float[np.ndarray, "rows columns 2"]:
    return np.stack(np.meshgrid(columns.astype(float), rows.astype(float)), axis=-1)


def resampled(view: View, at: Float[np.ndarray, "2 rows cols"]) -> View:
    """The frame with each pixel taken from its place in `at` (Lanczos, in linear light)."""
    clipped, (x, y) = view.clipped.astype(np.float32), at
    beyond = cv2.remap(clipped, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(1.0,) * 4).reshape(clipped.shape)
    return replace(view, pixels=_lanczos(view.pixels, x, y), clipped=beyond > 0)


def _lanczos(image: np.ndarray, x: Float[np.ndarray, "rows cols"], y: Float[np.ndarray, "rows cols"]) -> np.ndarray:
    shown = cv2.remap(image, x, y, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE).reshape(image.shape)
    return np.clip(shown, 0, 1)
