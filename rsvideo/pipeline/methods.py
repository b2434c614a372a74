"""How frames are treated by each method, with the same light, the same noise and the same final solver."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rsvideo.baselines import gyro, nonuniform, rectify, stitch, uniform
from rsvideo.config.method import Method
from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Trajectory, still
from rsvideo.pipeline.gyro_alignment import Gyro
from rsvideo.restoration import multi_frame, single_frame
from rsvideo.restoration.multi_frame import Movement
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.single_frame import Iterate, Settings


@dataclass(frozen=True, kw_only=True, eq=False)
class Treatment:
    """A method and all that steers it."""

    method: Method
    settings: Settings
    block_rows: int | None  # of stitch; None is a third of the frame
    gyro: Gyro | None  # of the methods that need one
    timing: ShutterTiming
    timing_source: str
    intrinsics: Intrinsics
    noise: Noise | None = None  # of the sensor; None is measured in each frame


def photograph(asked: Treatment, frame: Frame, trajectory: Trajectory | None, observe: Callable[[Iterate], None]) -> FrameResult:
    """What becomes of one frame by itself; `trajectory` is the motion where it is known."""
    if asked.method in (Method.RSVIDEO, Method.GYRO, Method.GYRO_REFINE):
        start = None
        if asked.gyro is not None:
            trajectory = asked.gyro.within(asked.timing, asked.intrinsics)
        if asked.method is Method.GYRO_REFINE and trajectory is not None:
            trajectory, start = None, gyro.first(trajectory)
        return single_frame.restore(
            frame,
            asked.timing,
            asked.intrinsics,
            asked.settings,
            timing_source=asked.timing_source,
            trajectory=trajectory,
            start=start,
            noise=asked.noise,
            observe=observe,
        )
    return _single(asked, frame, None, None)


def movement(asked: Treatment, frames: Iterable[Frame], begins: Float[np.ndarray, " frames"], observe: Callable[[int], None]) -> Movement:
    """How the camera moved in successive frames that begin at `begins`, as far as the method asks; `observe` is told of each taken in."""
    if asked.method is Method.GYRO and asked.gyro:
        return asked.gyro.movement(begins, asked.timing, asked.intrinsics)
    if asked.method is Method.GYRO_REFINE and asked.gyro:
        return asked.gyro.refined(multi_frame.seen(frames, asked.timing, asked.intrinsics, asked.settings, observe))
    if asked.method.rectifies:
        return rectify.movement(frames, asked.timing, asked.intrinsics, asked.settings, observe)
    if asked.method is Method.RSVIDEO and asked.settings.frames != "cold":
        return multi_frame.movement(frames, asked.timing, asked.intrinsics, asked.settings, observe)
    return multi_frame.unknown(len(begins), 3)


def run(asked: Treatment, frames: Iterable[Frame], moving: Movement, observe: Callable[[int, float], None]) -> Iterator[FrameResult]:
    """What becomes of successive frames whose motion is `moving`, in order."""
    if asked.method in (Method.RSVIDEO, Method.GYRO, Method.GYRO_REFINE):
        yield from multi_frame.restored(
            frames, moving, asked.timing, asked.intrinsics, asked.settings, timing_source=asked.timing_source, observe=observe
        )
        return
    for frame, way, flow in zip(frames, moving.within, moving.flows or [None] * len(moving.within), strict=True):
        yield _single(asked, frame, way, flow)
        observe(frame.index, 1.0)


def untouched(asked: Treatment, frame: Frame, verdict: Verdict) -> FrameResult:
    """The frame as it came."""
    return FrameResult(
        frame=frame,
        timing=asked.timing,
        timing_source=asked.timing_source,
        trajectory=still(asked.timing.interval, degree=1, axes=3),
        latent=frame.pixels,
        verdict=verdict,
        seconds=0.0,
    )


def _single(asked: Treatment, frame: Frame, way: Trajectory | None, flow: Flow | None) -> FrameResult:
    timing, camera, settings, source = asked.timing, asked.intrinsics, asked.settings, asked.timing_source
    match asked.method:
        case Method.VIDSTAB:
            return untouched(asked, frame, Verdict.RESTORED)  # which it was before it came here
        case Method.UNIFORM | Method.VIDSTAB_UNIFORM:
            return uniform.restored(frame, timing, settings, timing_source=source)
        case Method.NONUNIFORM:
            return nonuniform.restored(frame, timing, camera, settings, timing_source=source)
        case Method.STITCH:
            return stitch.restored(frame, timing, settings, block_rows=asked.block_rows, timing_source=source)
        case Method.RECTIFY:
            return rectify.restored(frame, way, timing, camera, flow=flow, timing_source=source)
        case Method.RECTIFY_UNIFORM | Method.RECTIFY_NONUNIFORM:
            straight, seen = rectify.straightened(frame, way, timing, camera, flow=flow, timing_source=source)
            after = Method.UNIFORM if asked.method is Method.RECTIFY_UNIFORM else Method.NONUNIFORM
            sharp = _single(replace(asked, method=after, timing=rectify.after(timing)), seen, None, None)
            if sharp.verdict is not Verdict.RESTORED:
                return replace(straight, seconds=straight.seconds + sharp.seconds)
            return replace(sharp, frame=frame, timing=timing, trajectory=straight.trajectory, seconds=straight.seconds + sharp.seconds)
        case _:
            return untouched(asked, frame, Verdict.UNTOUCHED)
