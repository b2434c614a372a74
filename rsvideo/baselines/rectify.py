"""Rolling-shutter rectification of a clip, after Forssen and Ringaby (CVPR 2010): every row put where a global shutter had seen it.

The motion comes from points that are tracked between frames, each at its own row's time, and is one continuous spline; blur is
neither looked at nor removed. Different from the paper: the spline holds rotation vectors; a prior on a hand's motion, in place of
few knots, says what no point tells; and what points do beyond the path (parallax, things that move) is put right too.
"""

import time
from collections.abc import Callable, Iterable
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float, Float32

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Intrinsics, turned
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Trajectory, still
from rsvideo.restoration import multi_frame
from rsvideo.restoration.multi_frame import Movement
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.single_frame import Settings, intrinsics_along

STILL = 0.05  # px; a frame of which no pixel moves farther is left as it was
_SAMPLES = 16  # of a row's exposure
_NODES = 16  # px between the columns whose pixels are followed exactly; at 20 px of motion those between are off by 0.001 px
_CLOSE = 1e-3  # px
_ROUNDS = 40  # of the fixed point; a row that moves by 0.5 px while the next is read still needs 10


def movement(
    frames: Iterable[Frame], timing: ShutterTiming, intrinsics: Intrinsics, settings: Settings, observe: Callable[[int], None]
) -> Movement:
    """The motion that tracked points alone show; `observe` is told of each frame taken in."""
    run = multi_frame.seen(frames, timing, intrinsics, settings, observe, blur=False)
    if not run.known.any():
        return multi_frame.unknown(len(run.begins), run.axes)
    path = multi_frame.tracked(run)
    return replace(multi_frame.told(path.spline, run.begins, timing, run.known, run.tied), flows=multi_frame.own(run, path))


def rectified(frame: Frame, way: Trajectory, timing: ShutterTiming, intrinsics: Intrinsics, *, flow: Flow | None = None) -> Frame:
    """The frame as a global shutter had seen it at the pose of the middle of its interval (Lanczos, in linear light).

    What lies beyond the frame repeats its outermost pixels, streaked where the frame is moved inwards, and counts as clipped.
    """
    if timing.row_time == 0:
        return frame
    return _resampled(frame, _sources(way, flow, timing, intrinsics), timing.direction)


def restored(
    frame: Frame,
    way: Trajectory | None,
    timing: ShutterTiming,
    intrinsics: Intrinsics,
    *,
    flow: Flow | None = None,
    timing_source: str = "explicit",
) -> FrameResult:
    """What becomes of a frame by rectification alone; one without a way, or that hardly moves, is left as it was."""
    return straightened(frame, way, timing, intrinsics, flow=flow, timing_source=timing_source)[0]


def straightened(
    frame: Frame, way: Trajectory | None, timing: ShutterTiming, intrinsics: Intrinsics, *, flow: Flow | None, timing_source: str
) -> tuple[FrameResult, Frame]:
    """The same, and the frame to go on with, which knows where it is clipped."""
    started = time.monotonic()
    verdict, seen = Verdict.NO_TEXTURE if way is None else Verdict.SHARP, frame
    if way is not None and timing.row_time > 0:
        sources = _sources(way, flow, timing, intrinsics)
        rows, cols = sources.shape[:2]
        if max(np.abs(sources[..., 0] - np.arange(cols)).max(), np.abs(sources[..., 1] - np.arange(rows)[:, None]).max()) > STILL:
            verdict, seen = Verdict.RESTORED, _resampled(frame, sources, timing.direction)
    result = FrameResult(
        frame=frame,
        timing=timing,
        timing_source=timing_source,
        trajectory=still(timing.interval, degree=1, axes=2) if way is None else way,
        latent=seen.pixels,
        verdict=verdict,
        seconds=time.monotonic() - started,
    )
    return result, seen


def after(timing: ShutterTiming) -> ShutterTiming:
    """The shutter of rectified frames: all rows at once, for as long as before."""
    return replace(timing, row_time=0.0)


def _sources(way: Trajectory, flow: Flow | None, timing: ShutterTiming, intrinsics: Intrinsics) -> Float32[np.ndarray, "scanlines along 2"]:
    """Where the frame, along its scanlines, shows each pixel of the rectified one.

    Pixel q of the scanline r(q) shows q + w(q; p) with the mean pose p of that scanline's exposure, relative to the pose of the
    middle. Of a rectified pixel X it is q = X + w(X; -p(r(q))) + t(r(q)) u(X), the fixed point of taking r from the last q; t is
    the scanline's time from the middle, and u the velocity that points have of their own.
    """
    camera = intrinsics_along(intrinsics, timing)
    axes = way.coefficients.shape[1]
    turn = timing.direction.pose_from_scanlines[:axes, :axes]
    poses = (way.at(timing.sample_times(_SAMPLES)).mean(axis=1) - way.at(np.array([timing.middle]))) @ turn
    columns = np.unique(np.r_[np.arange(0, camera.cols, _NODES), camera.cols - 1])
    x, y = np.meshgrid(columns.astype(float), np.arange(camera.rows, dtype=float))
    at = home = np.stack([x, y], axis=-1)
    own = _everywhere(flow, columns, camera.rows) if flow else np.zeros((1, 1, 2))
    for _ in range(_ROUNDS):
        scanline = np.clip(at[..., 1], 0, timing.rows - 1)
        pose = np.stack([np.interp(scanline, np.arange(timing.rows), p) for p in poses.T], axis=-1)
        when = scanline * timing.row_time + timing.exposure / 2 - timing.middle
        last, at = at, home + turned(camera, x, y, -pose) + when[..., None] * own
        if np.abs(at - last).max() < _CLOSE:
            break
    every = np.arange(camera.cols)
    low = np.clip(np.searchsorted(columns, every, side="right") - 1, 0, max(len(columns) - 2, 0))
    high = np.minimum(low + 1, len(columns) - 1)
    share = ((every - columns[low]) / np.maximum(columns[high] - columns[low], 1))[:, None]
    return ((1 - share) * at[:, low] + share * at[:, high]).astype(np.float32)


def _everywhere(flow: Flow, columns: np.ndarray, rows: int) -> Float[np.ndarray, "rows columns 2"]:
    """The field in these columns, from that of every few rows."""
    some = np.unique(np.r_[np.arange(0, rows, _NODES), rows - 1])
    nodes = flow.at(np.stack(np.meshgrid(columns, some), axis=-1).reshape(-1, 2).astype(float)).reshape(len(some), -1)
    return np.stack([np.interp(np.arange(rows), some, column) for column in nodes.T], axis=1).reshape(rows, len(columns), 2)


def _resampled(frame: Frame, sources: Float[np.ndarray, "scanlines along 2"], direction: Direction) -> Frame:
    pixels = np.ascontiguousarray(direction.scanlines(frame.pixels), np.float32)
    clipped = np.ascontiguousarray(direction.scanlines(frame.clipped), np.float32)
    x, y = np.ascontiguousarray(sources[..., 0]), np.ascontiguousarray(sources[..., 1])
    seen = cv2.remap(pixels, x, y, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REPLICATE).reshape(pixels.shape)
    beyond = cv2.remap(clipped, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_CONSTANT, borderValue=(1.0,) * 4).reshape(clipped.shape)
    return replace(
        frame,
        pixels=np.ascontiguousarray(direction.image(np.clip(seen, 0, 1))),
        clipped=np.ascontiguousarray(direction.image(beyond > 0)),
    )
