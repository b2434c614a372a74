"""Successive frames restored along their motion, each with the help of its neighbours."""

import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Trajectory
from rsvideo.progress import Observer, Progress, ignore
from rsvideo.restoration import nonblind, search, single_frame
from rsvideo.restoration.estimate import Estimator
from rsvideo.restoration.extent import beyond, longest
from rsvideo.restoration.fusion import Fused, PosedImage, fused, helpful
from rsvideo.restoration.movement import Evidence, Movement, groups
from rsvideo.restoration.predicted_blur import confirmed
from rsvideo.restoration.rectification import Share, displaced, straightened
from rsvideo.restoration.resolution import too_long
from rsvideo.restoration.scanlines import View, to_scanlines
from rsvideo.restoration.scene import scene_of
from rsvideo.restoration.settings import Device, Settings
from rsvideo.restoration.single_frame import Restored, tiled_frame
from rsvideo.restoration.trust import LONG, UNCHECKED, agreement, borne_out, confirmation, observed, trust

STILL = 0.25  # px that the pose moves within a frame; below, the frame is left as it was
MOVING = 1.0  # px, from which on it is fully restored
TIMES = 33  # at which a frame's path is followed to see how far it leads
LEAST_SHARE = 0.02  # of the restoration, over the frame; less is not worth the work
SHARP_ENOUGH = 6.0  # px of blur, up to which a frame that is rectified only serves its neighbours
ALONE = 0.6  # of a frame's work is done when it is restored by itself


@dataclass(frozen=True, kw_only=True, eq=False)
class _Waiting:
    """A frame restored by itself, until its neighbours are there too."""

    restored: Restored | None = None  # None once it is done
    evidence: Evidence | None = None  # None of a motion that was given, which is followed whatever the neighbours show
    image: PosedImage | None = None  # None where it cannot serve others, nor they it
    moved: float = 1.0  # as in `_Judged`
    share: Float[np.ndarray, "..."] | float = 1.0  # of the restoration in what is shown, of all pixels or (rows, cols, 1)
    own: Float[np.ndarray, "rows cols"] | None = None  # of the restoration, the share that the frame's own data grant; None: all of it
    noise: float = 0.0  # of the frame, as its blur's model leaves it
    draft: bool = False  # whether the image is one

    def mixed(
        self, latent: Float[np.ndarray, "rows cols channels"], device: Device, *, draft: bool = False
    ) -> Float[np.ndarray, "rows cols channels"]:
        """The restoration as far as it is trusted, else the frame rectified, which is made anew: to keep it would take more memory.

        Of a draft the mean with others loses what is wrong along the borders; else it is held there.
        """
        assert self.restored is not None
        share = np.float32(self.share) if self.own is None else np.float32(self.share) * self.own[..., None]
        view, path = self.restored.view, self.restored.trajectory
        shown = Share(latent, share, reach=0 if draft else int(longest(view.camera, path)) + 1)
        return _straight(view, path, self.evidence, self.moved, device, shown)


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
    than STILL px is left as it was, and up to MOVING px it is mixed with what becomes of it, so that nothing flickers. A motion
    that was estimated is followed as far as `trust` says; elsewhere the frame is rectified only. A motion that is given is followed
    as it is. A picture that repeats the frame tells nothing new, and does not help. At most 2 n + 1 frames are kept, n the neighbours
    on either side.
    """
    reach = settings.effort.neighbours if settings.frames == "together" else 0
    movement = movement.along_scanlines(camera.timing.direction)
    poses = np.vstack([np.zeros((1, movement.steps.shape[1])), np.cumsum(movement.steps[:-1], axis=0)])
    group = groups(movement.tied)
    waiting: dict[int, _Waiting] = {}

    def ready(k: int) -> FrameResult:
        near = [j for j in waiting if abs(j - k) <= reach and group[j] == group[k] and (poses[j] != poses[k]).any()]
        others = [image for j in near if (image := waiting[j].image)]
        started = time.monotonic()
        alone = _with_neighbours(waiting[k], others, settings)
        done = replace(alone, seconds=alone.seconds + time.monotonic() - started).result()
        waiting[k] = _Waiting(image=waiting[k].image)  # others need no more of it
        waiting.pop(k - reach, None)
        observe(Progress(stage="restoring", fraction=1.0, frame=done.frame.index))
        return done

    count = 0
    paths = zip(frames, movement.cameras(camera), movement.within, movement.beside, strict=True)
    for k, (frame, taken, path, evidence) in enumerate(paths):
        view = to_scanlines(frame, taken)
        if path is None:
            waiting[k] = _Waiting(restored=single_frame.restored(view, settings, estimate=estimate))
        else:
            waiting[k] = _alone(view, path, evidence, poses[k], settings, draft=reach > 0)
        observe(Progress(stage="restoring", fraction=ALONE, frame=frame.index))
        count = k + 1
        if k >= reach:
            yield ready(k - reach)
    for k in range(max(0, count - reach), count):
        yield ready(k)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Judged:
    """How far a frame is restored along its path."""

    verdict: Verdict
    moved: float  # 0 to 1: how much of what becomes of the frame is shown, by how far it moves
    length: float  # px of its blur
    share: Float[np.ndarray, "rows cols 1"] | float = 0.0  # of the restoration, by what bears the path out


def verdicts(frames: Iterable[Frame], movement: Movement, camera: Camera, settings: Settings) -> Iterator[Verdict | None]:
    """What `restored` will answer of each frame, without its work, unless its neighbours show otherwise.

    None of a frame without a trajectory, which is judged by that work.
    """
    movement = movement.along_scanlines(camera.timing.direction)
    paths = zip(frames, movement.cameras(camera), movement.within, movement.beside, strict=True)
    for frame, taken, path, evidence in paths:
        yield None if path is None else _judged(to_scanlines(frame, taken), path, evidence, settings).verdict


def _judged(view: View, path: Trajectory, evidence: Evidence | None, settings: Settings) -> _Judged:
    """Without evidence the path was given, and is followed as it is."""
    reach = np.ptp(path.at(np.linspace(*view.camera.timing.interval, TIMES))[:, :2], axis=0)
    moved = float(np.clip((np.linalg.norm(reach) - STILL) / (MOVING - STILL), 0, 1))
    length = longest(view.camera, path)
    if beyond(view.camera, path):
        return _Judged(verdict=Verdict.UNEXPLAINED, moved=moved, length=length)
    if moved == 0:
        return _Judged(verdict=Verdict.SHARP, moved=moved, length=length)
    share = 1.0
    if evidence:
        scene = scene_of(view, settings, evidence.flow)
        if evidence.seeming is not None:
            scene = replace(scene, camera=scene.camera.exposed(evidence.seeming))
        led = evidence.focused or path
        followed = trust(scene, led, length, evidence.certainty, evidence.exposure_shown)[..., None] if evidence.share else 0.0
        share = evidence.share * followed
    if np.mean(share) < LEAST_SHARE:
        verdict = Verdict.DISAGREES if length > LONG and not (evidence and evidence.share) else Verdict.STRAIGHTENED
        return _Judged(verdict=_undeblurred(view, verdict), moved=moved, length=length)
    return _Judged(verdict=Verdict.RESTORED, moved=moved, length=length, share=share)


def _undeblurred(view: View, verdict: Verdict) -> Verdict:
    """The verdict of a frame that is straightened only, or left where there is nothing to straighten."""
    return Verdict.LEFT if view.camera.timing.row_time == 0 else verdict


def _alone(view: View, path: Trajectory, evidence: Evidence | None, pose: np.ndarray, settings: Settings, *, draft: bool) -> _Waiting:
    """The frame restored by itself, along its path; as a `draft` where its neighbours are to help."""
    started = time.monotonic()
    judged = _judged(view, path, evidence, settings)
    verdict, length, moved = judged.verdict, judged.length, judged.moved
    left = Restored(view=view, trajectory=path, latent=view.pixels, verdict=verdict, seconds=0.0)
    if verdict is Verdict.UNEXPLAINED:
        return _Waiting(restored=left)
    if verdict is Verdict.SHARP:
        return _Waiting(restored=left, image=PosedImage(latent=view.pixels, pose=pose, length=length))
    if verdict.straightened or verdict is Verdict.LEFT:
        straight = _straight(view, path, evidence, moved, settings.device)
        done = replace(left, latent=straight, seconds=time.monotonic() - started)
        return _Waiting(restored=done, image=PosedImage(latent=straight, pose=pose, length=length) if length < SHARP_ENOUGH else None)
    share = np.asarray(np.float32(moved) * judged.share, np.float16)
    draft = draft and settings.splittings > 0 and not too_long(view, length)
    return _drafted(view, path, evidence, pose, settings, moved=moved, share=share, draft=draft)


def _drafted(
    view: View,
    path: Trajectory,
    evidence: Evidence | None,
    pose: np.ndarray,
    settings: Settings,
    *,
    moved: float,
    share: Float[np.ndarray, "..."],
    draft: bool,
) -> _Waiting:
    """A frame that is restored, by itself so far."""
    started, length = time.monotonic(), longest(view.camera, path)
    noise = single_frame.model_noise(view, _error(evidence, length))
    how = replace(settings, quality="draft") if draft else settings
    alone = single_frame.restored(view, how, path=path, noise=noise, flow=evidence and evidence.flow, coverage=evidence is not None)
    waiting = _Waiting(
        restored=alone,
        evidence=evidence,
        moved=moved,
        share=share,
        own=None if alone.covered is None else observed(alone.covered).astype(np.float16),
        noise=noise,
        draft=draft,
    )
    image = PosedImage(latent=waiting.mixed(alone.latent, settings.device, draft=draft), pose=pose, length=length)
    return replace(waiting, restored=replace(alone, latent=image.latent, covered=None, seconds=time.monotonic() - started), image=image)


def _error(evidence: Evidence | None, length: float) -> float:
    """How far a path whose blur is `length` px long may be off, px; one that was given is not."""
    return min(evidence.error, length) if evidence else 0.0


def _straight(
    view: View, path: Trajectory, evidence: Evidence | None, moved: float, device: Device, latent: Share | None = None
) -> Float[np.ndarray, "rows cols channels"]:
    """The frame rectified, as far as its path is certain and as it moves, but for the share of a latent image; along a path that was
    given it is restored only."""
    if not evidence:
        return straightened(view, None, device=device, latent=latent)
    followed = path.with_coefficients(evidence.certainty * path.coefficients)
    flow = evidence.flow and evidence.flow.times(evidence.certainty)
    return straightened(view, followed, flow=flow, moved=moved, device=device, latent=latent)


def _fused(waiting: _Waiting, others: Sequence[PosedImage], settings: Settings) -> Fused | None:
    """A frame that is restored, with its neighbours; None where none helps."""
    alone, image = waiting.restored, waiting.image
    if alone is None or image is None or alone.verdict is not Verdict.RESTORED or too_long(alone.view, image.length):
        return None
    if not (others := helpful(image, others)):
        return None
    view, evidence = alone.view, waiting.evidence
    flow = evidence and evidence.flow
    frame = tiled_frame(view, alone.trajectory, settings, flow)
    still = displaced(alone.trajectory, view.camera, flow) if evidence and image.length > UNCHECKED else None
    error = _error(evidence, image.length)
    return fused(frame, image, others, view.camera.intrinsics, view.noise, error, own=waiting.own, displaced=still)


def _with_neighbours(waiting: _Waiting, others: Sequence[PosedImage], settings: Settings) -> Restored:
    """The frame restored with its neighbours; straightened only where none agrees, or where its blur is not what its path predicts."""
    alone, image, verdict = waiting.restored, waiting.image, Verdict.RESTORED
    assert alone is not None
    if image is None or alone.verdict is not Verdict.RESTORED:
        return alone
    view = alone.view
    if both := _fused(waiting, others, settings):
        frame, latent = both.frame, both.solved()
        latent = frame.to_host(nonblind.finished(frame, latent, waiting.noise) if settings.splittings else latent)
        if evidence := waiting.evidence:
            agreed = np.float32(1.0)
            if both.predicted:
                found = confirmed(both.predicted)
                agreed = confirmation(found, image.length, evidence.blur_certainty)
                if evidence.exposure_shown:  # or a wrong exposure would be taken for a wrong path
                    evidence = replace(evidence, certainty=evidence.certainty * borne_out(found, image.length))
            agreed = agreed * agreement(both.explained, both.shown, both.astray, evidence.certainty)
            waiting = replace(waiting, evidence=evidence, share=waiting.share * agreed[..., None], own=both.support)
            if np.mean(waiting.share, dtype=np.float32) < LEAST_SHARE:
                verdict = _undeblurred(view, Verdict.STRAIGHTENED)
    elif waiting.draft:
        flow = waiting.evidence and waiting.evidence.flow
        latent = single_frame.restored(view, settings, path=alone.trajectory, noise=waiting.noise, flow=flow).latent
    else:
        return alone
    return replace(alone, latent=waiting.mixed(latent, settings.device), verdict=verdict)
