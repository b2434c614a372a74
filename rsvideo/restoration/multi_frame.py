"""Successive frames restored along their motion, each with the help of its neighbours."""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Trajectory
from rsvideo.progress import Observer, Progress, ignore
from rsvideo.restoration import search, single_frame
from rsvideo.restoration.fusion import PosedImage, fused
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.scanlines import View, to_scanlines
from rsvideo.restoration.search import Estimator
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.single_frame import Restored, tiled_frame
from rsvideo.restoration.verdict import longest

NEIGHBOURS = 3  # frames on either side that a frame is restored with; origin: by trial
STILL = 0.25  # px that the pose moves within a frame; below, the frame is left as it was
MOVING = 1.0  # px, from which on it is fully restored
TIMES = 33  # at which a frame's path is followed to see how far it leads
ALONE = 0.6  # of a frame's work is done when it is restored by itself


@dataclass(frozen=True, kw_only=True, eq=False)
class _Waiting:
    """A frame restored by itself, until its neighbours are there too."""

    restored: Restored
    image: PosedImage | None  # None where it cannot serve others, nor they it
    share: float  # of the restoration in what is shown


def restored(
    frames: Iterable[Frame],
    movement: Movement,
    camera: Camera,
    settings: Settings,
    *,
    estimate: Estimator = search.estimate,
    observe: Observer = ignore,
) -> Iterator[FrameResult]:
    """Each frame's latent image at the pose of the middle of its interval, with the help of its neighbours.

    A frame without a trajectory in `movement`, which is in image axes, is restored by itself, blindly. A frame that moves by less
    than STILL px is left as it was, and up to MOVING px it is mixed with its restoration, so that nothing flickers. At most
    2 NEIGHBOURS + 1 frames are kept.
    """
    reach = NEIGHBOURS if settings.frames == "together" else 0
    movement = movement.along_scanlines(camera.timing.direction)
    poses = np.vstack([np.zeros((1, movement.steps.shape[1])), np.cumsum(movement.steps[:-1], axis=0)])
    group = np.cumsum([0, *(not t for t in movement.tied[:-1])])
    waiting: dict[int, _Waiting] = {}

    def ready(k: int) -> FrameResult:
        others = [w.image for j, w in waiting.items() if j != k and abs(j - k) <= reach and group[j] == group[k] and w.image]
        done = _with_neighbours(waiting[k], others, settings).result()
        waiting.pop(k - reach, None)
        observe(Progress(stage="restoring", fraction=1.0, frame=done.frame.index))
        return done

    count = 0
    for k, (frame, path) in enumerate(zip(frames, movement.within, strict=True)):
        waiting[k] = _alone(to_scanlines(frame, camera), path, poses[k], settings, estimate)
        observe(Progress(stage="restoring", fraction=ALONE, frame=frame.index))
        count = k + 1
        if k >= reach:
            yield ready(k - reach)
    for k in range(max(0, count - reach), count):
        yield ready(k)


def _alone(view: View, path: Trajectory | None, pose: np.ndarray, settings: Settings, estimate: Estimator) -> _Waiting:
    """The frame restored by itself, along its path if there is one."""
    if path is None:
        return _Waiting(restored=single_frame.restored(view, settings, estimate=estimate), image=None, share=1.0)
    moved = float(np.linalg.norm(np.ptp(path.at(np.linspace(*view.camera.timing.interval, TIMES))[:, :2], axis=0)))
    share = float(np.clip((moved - STILL) / (MOVING - STILL), 0, 1))
    if share == 0:
        alone = Restored(view=view, trajectory=path, latent=view.pixels, verdict=Verdict.SHARP, seconds=0.0)
    else:
        alone = single_frame.restored(view, settings, path=path)
    latent = np.ascontiguousarray(np.clip(alone.latent, 0, 1), np.float32)
    return _Waiting(restored=alone, image=PosedImage(latent=latent, pose=pose, length=longest(view.camera, path)), share=share)


def _with_neighbours(waiting: _Waiting, others: Sequence[PosedImage], settings: Settings) -> Restored:
    """The frame restored with its neighbours."""
    alone, image = waiting.restored, waiting.image
    if image is None or alone.verdict is not Verdict.RESTORED:
        return alone
    started, view = time.monotonic(), alone.view
    latent = fused(tiled_frame(view, alone.trajectory, settings), image, others, view.camera.intrinsics, view.noise)
    latent = view.pixels + np.float32(waiting.share) * (np.clip(latent, 0, 1) - view.pixels)
    return replace(alone, latent=latent, seconds=alone.seconds + time.monotonic() - started)
