"""Rolling-shutter rectification of a clip, after Forssen and Ringaby (CVPR 2010): every row put where a global shutter would show it.

The motion comes from points that are tracked between frames, each at its own row's time, and is one continuous spline; blur is
neither measured nor removed. Different from the paper: the spline holds rotation vectors; a prior on a hand's motion, in place of
few knots, settles what no point shows; and what points do beyond the path (parallax, things that move) is put right too.
"""

import time
from collections.abc import Iterable
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float, Float32

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Camera, turned
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Trajectory, still
from rsvideo.progress import Observer, ignore
from rsvideo.restoration import clip_motion, scanlines
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scanlines import View
from rsvideo.restoration.settings import Settings

STILL = 0.05  # px; a frame of which no pixel moves farther is left as it was
_SAMPLES = 16  # of a row's exposure, over which its pose is averaged
_NODES = 16  # px between the columns whose pixels are followed exactly; at 20 px of motion those between are off by 0.001 px
_CLOSE = 1e-3  # px
_ROUNDS = 40  # of the fixed point; a row that moves by 0.5 px while the next is read still needs 10


def movement(frames: Iterable[Frame], camera: Camera, settings: Settings, observe: Observer = ignore) -> Movement:
    """The motion that tracked points alone show, in image axes, and what the points do beyond it."""
    run = clip_motion.gather(frames, camera, settings, observe, blur=False)
    if not run.followed.any():
        return Movement.unfollowed(len(run.begins), run.axes)
    path = clip_motion.path_from_tracks(run)
    return replace(clip_motion.movement_of(run, path.spline, run.followed), flows=clip_motion.flows_beside(run, path))


def rectified(view: View, path: Trajectory, *, flow: Flow | None = None) -> View:
    """The frame as a global shutter shows it at the pose of the middle of its interval (Lanczos, in linear light).

    What lies beyond the frame repeats its outermost pixels, streaked where the frame is moved inwards, and counts as clipped.
    `path` and `flow` are along the scanlines.
    """
    return view if view.camera.timing.row_time == 0 else _resampled(view, _sources(path, flow, view.camera))


def restored(view: View, path: Trajectory | None, *, flow: Flow | None = None) -> FrameResult:
    """What becomes of a frame by rectification alone; one without a path, or that hardly moves, is left as it was."""
    return straightened(view, path, flow=flow)[0]


def straightened(view: View, path: Trajectory | None, *, flow: Flow | None = None) -> tuple[FrameResult, View]:
    """The same, and the frame to go on with: rectified, with a global shutter."""
    started, timing = time.monotonic(), view.camera.timing
    verdict, straight = Verdict.NO_TEXTURE if path is None else Verdict.SHARP, view
    if path is not None and timing.row_time > 0:
        sources = _sources(path, flow, view.camera)
        rows, cols = sources.shape[:2]
        if max(np.abs(sources[..., 0] - np.arange(cols)).max(), np.abs(sources[..., 1] - np.arange(rows)[:, None]).max()) > STILL:
            verdict, straight = Verdict.RESTORED, _resampled(view, sources)
    result = scanlines.result(
        view,
        trajectory=still(timing.interval, degree=1, axes=2) if path is None else path,
        verdict=verdict,
        latent=straight.pixels if verdict is Verdict.RESTORED else None,
        seconds=time.monotonic() - started,
    )
    return result, replace(straight, camera=replace(view.camera, timing=after(timing)))


def after(timing: ShutterTiming) -> ShutterTiming:
    """The shutter of rectified frames: all rows at once, for as long as before."""
    return replace(timing, row_time=0.0)


def _sources(path: Trajectory, flow: Flow | None, camera: Camera) -> Float32[np.ndarray, "scanlines along 2"]:
    """Where the frame shows each pixel of the rectified one.

    Pixel q of the scanline r(q) shows q + w(q; p) with the mean pose p of that scanline's exposure, relative to the pose of the
    middle. Of a rectified pixel X it is q = X + w(X; -p(r(q))) + t(r(q)) u(X), the fixed point of taking r from the last q; t is
    the scanline's time from the middle, and u the velocity of points beyond the path.
    """
    timing, lens = camera.timing, camera.intrinsics
    poses = path.at(timing.sample_times(_SAMPLES)).mean(axis=1) - path.at(np.array([timing.middle]))
    columns = np.unique(np.r_[np.arange(0, lens.cols, _NODES), lens.cols - 1])
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
    every = np.arange(lens.cols)
    low = np.clip(np.searchsorted(columns, every, side="right") - 1, 0, max(len(columns) - 2, 0))
    high = np.minimum(low + 1, len(columns) - 1)
    share = ((every - columns[low]) / np.maximum(columns[high] - columns[low], 1))[:, None]
    return ((1 - share) * at[:, low] + share * at[:, high]).astype(np.float32)


def _everywhere(flow: Flow, columns: np.ndarray, rows: int) -> Float[np.ndarray, "rows columns 2"]:
    """The field in these columns, from that of every few rows."""
    some = np.unique(np.r_[np.arange(0, rows, _NODES), rows - 1])
    nodes = flow.at(np.stack(np.meshgrid(columns, some), axis=-1).reshape(-1, 2).astype(float)).reshape(len(some), -1)
    return np.stack([np.interp(np.arange(rows), some, column) for column in nodes.T], axis=1).reshape(rows, len(columns), 2)


def _resampled(view: View, sources: Float[np.ndarray, "rows cols 2"]) -> View:
    """The frame with each pixel taken from its place in `sources` (Lanczos, in linear light)."""
    x, y = np.ascontiguousarray(sources[..., 0]), np.ascontiguousarray(sources[..., 1])
    clipped = view.clipped.astype(np.float32)
    pixels = cv2.remap(view.pixels, x, y, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE).reshape(view.pixels.shape)
    beyond = cv2.remap(clipped, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(1.0,) * 4).reshape(clipped.shape)
    return replace(view, pixels=np.clip(pixels, 0, 1), clipped=beyond > 0)
