"""Rolling-shutter rectification of a clip, after Forssen and Ringaby (CVPR 2010): every row put where a global shutter would show it.

The motion comes from points that are tracked between frames, each at its own row's time, and is one continuous spline; blur is
neither measured nor removed. Different from the paper: the spline holds rotation vectors; a prior on a hand's motion, in place of
few knots, settles what no point shows; and what points do beyond the path (parallax, things that move) is put right too.
"""

import time
from dataclasses import replace

import numpy as np

from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Trajectory, still
from rsvideo.restoration import clip_motion, scanlines
from rsvideo.restoration.clip_motion import Run
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.rectification import resampled, sources
from rsvideo.restoration.scanlines import View

STILL = 0.05  # px; a frame of which no pixel moves farther is left as it was


def movement(run: Run) -> Movement:
    """The motion that tracked points alone show, in image axes, and what the points do beyond it."""
    if not run.followed.any():
        return Movement.unfollowed(len(run.begins), run.axes)
    path = clip_motion.path_from_tracks(run)
    return replace(clip_motion.movement_of(run, path.spline, run.followed), evidence=clip_motion.evidence(run, path, share=0.0))


def restored(view: View, path: Trajectory | None, *, flow: Flow | None = None) -> FrameResult:
    """What becomes of a frame by rectification alone; one without a path, or that hardly moves, is left as it was."""
    return straightened(view, path, flow=flow)[0]


def straightened(view: View, path: Trajectory | None, *, flow: Flow | None = None) -> tuple[FrameResult, View]:
    """The same, and the frame to go on with: rectified, with a global shutter."""
    started, timing = time.monotonic(), view.camera.timing
    verdict, straight = Verdict.NO_TEXTURE if path is None else Verdict.SHARP, view
    if path is not None and timing.row_time > 0:
        at = sources(path, flow, view.camera)
        _, rows, cols = at.shape
        if max(np.abs(at[0] - np.arange(cols)).max(), np.abs(at[1] - np.arange(rows)[:, None]).max()) > STILL:
            verdict, straight = Verdict.RESTORED, resampled(view, at)
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
