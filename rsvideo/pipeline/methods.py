"""How frames are treated by each method, with the same light, the same noise and the same final solver."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rsvideo.baselines import gyro, nonuniform, rectify, stitch, uniform
from rsvideo.config.method import Method
from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.paper import estimate as paper
from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Trajectory, still
from rsvideo.pipeline.gyro_alignment import Gyro
from rsvideo.progress import Observer, Progress, ignore
from rsvideo.restoration import clip_motion, exposure, multi_frame, search, single_frame, stabilised
from rsvideo.restoration.clip_motion import Followed, Run
from rsvideo.restoration.estimate import Estimator
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scanlines import View, to_scanlines
from rsvideo.restoration.settings import Settings


@dataclass(frozen=True, kw_only=True, eq=False)
class Treatment:
    """A method and all that steers it."""

    method: Method
    settings: Settings
    block_rows: int | None  # of stitch; None is a third of the frame
    gyro: Gyro | None  # of the methods that need one
    camera: Camera
    timing_source: str  # where the timing comes from, for the record
    exposure_shown: bool = False  # by the clip's blur: it is that, or what is stated agrees with it
    readout_guessed: bool = False  # nobody states it, and the clip shows not even a likely one
    exposure_doubtful: bool = False  # whether blur may show that it is another one than is believed
    exposure_spread: float | None = None  # in its logarithm, by which that of a part of a clip may differ; None: it is stated
    bits: float = math.inf  # of a clip: `Stream.bits`

    @property
    def estimate(self) -> Estimator:
        """How a trajectory is found from one frame: as in the paper where one of its steps is chosen."""
        return paper.estimate if paper.chosen(self.settings) else search.estimate


def photograph(treatment: Treatment, frame: Frame, trajectory: Trajectory | None, observe: Observer = ignore) -> FrameResult:
    """What becomes of one frame by itself; `trajectory` is the motion where it is given, in image axes."""
    view = to_scanlines(frame, treatment.camera)
    if treatment.method not in (Method.RSVIDEO, Method.GYRO, Method.GYRO_REFINE):
        return _with_source(treatment, _single(treatment, view, None, None))
    start = None
    if treatment.gyro is not None:
        trajectory = treatment.gyro.within(treatment.camera)
    if treatment.method is Method.GYRO_REFINE and trajectory is not None:
        trajectory, start = None, gyro.first(trajectory)
    result = single_frame.restore(
        view, treatment.settings, trajectory=trajectory, start=start, estimate=treatment.estimate, observe=observe
    )
    return _with_source(treatment, result)


def movement(treatment: Treatment, frames: Iterable[Frame], begins: Float[np.ndarray, " frames"], observe: Observer = ignore) -> Movement:
    """How the camera moved in successive frames that begin at `begins`, as far as the method needs it, in image axes."""
    if treatment.method is Method.GYRO and treatment.gyro:
        return treatment.gyro.movement(begins, treatment.camera)
    if treatment.method is Method.GYRO_REFINE and treatment.gyro:
        run = _gathered(treatment, frames, observe)
        return treatment.gyro.refined(run).of_pictures(run.pictures)
    if treatment.method.rectifies:
        run = _gathered(treatment, frames, observe, blur=False)
        return rectify.movement(run).of_pictures(run.pictures)
    if treatment.method is Method.RSVIDEO and treatment.settings.frames != "cold":
        run = run_of(treatment, frames, observe)
        if not run.followed.any():
            return clip_motion.movement(run).of_pictures(run.pictures)
        found = exposure.followed(run) if treatment.exposure_doubtful else Followed.of(run)
        along = clip_motion.movement_along if run.camera.timing.readout else stabilised.movement
        return along(found).of_pictures(run.pictures)
    return Movement.unfollowed(len(begins), 3)


def run_of(treatment: Treatment, frames: Iterable[Frame], observe: Observer = ignore) -> Run:
    """Successive frames as their motion is estimated, exposed as they show where nobody states it."""
    run = _gathered(treatment, frames, observe)
    return run if treatment.exposure_spread is None else exposure.of_each(run, treatment.exposure_spread)


def _gathered(treatment: Treatment, frames: Iterable[Frame], observe: Observer, *, blur: bool = True) -> Run:
    run = clip_motion.gather(frames, treatment.camera, treatment.settings, observe, blur=blur)
    return replace(run, exposure_shown=treatment.exposure_shown, readout_guessed=treatment.readout_guessed, bits=treatment.bits)


def run(treatment: Treatment, frames: Iterable[Frame], moving: Movement, observe: Observer = ignore) -> Iterator[FrameResult]:
    """What becomes of successive frames whose motion is `moving`, in order."""
    camera, settings = treatment.camera, treatment.settings
    if treatment.method in (Method.RSVIDEO, Method.GYRO, Method.GYRO_REFINE):
        results = multi_frame.restored(frames, moving, camera, settings, estimate=treatment.estimate, observe=observe)
        yield from (_with_source(treatment, result) for result in results)
        return
    moving = moving.along_scanlines(camera.timing.direction)
    for frame, taken, path, evidence in zip(frames, moving.cameras(camera), moving.within, moving.beside, strict=True):
        yield _with_source(treatment, _single(treatment, to_scanlines(frame, taken), path, evidence and evidence.flow))
        observe(Progress(stage="restoring", fraction=1.0, frame=frame.index))


def untouched(
    treatment: Treatment,
    frame: Frame,
    verdict: Verdict,
    trajectory: Trajectory | None = None,
    *,
    camera: Camera | None = None,
    seconds: float = 0.0,
) -> FrameResult:
    """The frame as it came, at rest unless a trajectory is given, and taken by the treatment's camera unless another is."""
    timing = (camera or treatment.camera).timing
    path = trajectory or still(timing.interval, degree=1, axes=3)
    result = FrameResult(frame=frame, timing=timing, trajectory=path, latent=frame.pixels, verdict=verdict, seconds=seconds)
    return _with_source(treatment, result)


def _with_source(treatment: Treatment, result: FrameResult) -> FrameResult:
    """The result with what its record holds besides: solvers do not ask where a timing comes from."""
    return replace(result, timing_source=treatment.timing_source)


def _single(treatment: Treatment, view: View, path: Trajectory | None, flow: Flow | None) -> FrameResult:
    """What becomes of a frame by one of the baselines; `path` and `flow` are along the scanlines."""
    settings = treatment.settings
    match treatment.method:
        case Method.VIDSTAB:
            return untouched(treatment, view.source, Verdict.RESTORED)  # which it was before it came here
        case Method.UNIFORM | Method.VIDSTAB_UNIFORM:
            return uniform.restored(view, settings)
        case Method.NONUNIFORM:
            return nonuniform.restored(view, settings)
        case Method.STITCH:
            return stitch.restored(view, settings, block_rows=treatment.block_rows)
        case Method.RECTIFY:
            return rectify.restored(view, path, flow=flow)
        case Method.RECTIFY_UNIFORM | Method.RECTIFY_NONUNIFORM:
            rectified, straight = rectify.straightened(view, path, flow=flow)
            method = uniform if treatment.method is Method.RECTIFY_UNIFORM else nonuniform
            sharp = method.restored(straight, settings)
            seconds = rectified.seconds + sharp.seconds
            if sharp.verdict is not Verdict.RESTORED:
                return replace(rectified, seconds=seconds)
            return replace(sharp, trajectory=rectified.trajectory, seconds=seconds)
        case _:
            return untouched(treatment, view.source, Verdict.UNTOUCHED)
