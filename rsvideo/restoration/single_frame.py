"""From one blurred frame to its trajectory and its latent image."""

import math
import time
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float

from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics.luminance import luminance
from rsvideo.physics.trajectory import Trajectory, centred, still
from rsvideo.progress import Observer, Progress, ignore
from rsvideo.restoration import device_frame, doubtful, nonblind, resolution, scanlines, search, undirected
from rsvideo.restoration.blurred_frame import BlurredFrame
from rsvideo.restoration.correction import ApproximatePath, corrected
from rsvideo.restoration.estimate import ESTIMATED, Estimator
from rsvideo.restoration.extent import longest
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scanlines import View
from rsvideo.restoration.scene import gradient_power, halved_until_textured, scene_of
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.verdict import judge


@dataclass(frozen=True, kw_only=True, eq=False)
class Restored:
    """What became of a frame, along its scanlines."""

    view: View
    trajectory: Trajectory
    latent: Float[np.ndarray, "rows cols channels"]  # the frame's own pixels where it was left as it was
    verdict: Verdict
    seconds: float
    convergence: tuple[float, ...] = ()
    covered: Float[np.ndarray, "rows cols"] | None = None  # of each latent pixel's light, the part observed; None: not wanted, or left

    def result(self) -> FrameResult:
        """The same in the stored frame's axes."""
        return scanlines.result(
            self.view,
            trajectory=self.trajectory,
            verdict=self.verdict,
            latent=self.latent if self.verdict.changed else None,
            seconds=self.seconds,
            convergence=self.convergence,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Found:
    """A trajectory, and whether to follow it."""

    trajectory: Trajectory
    verdict: Verdict
    values: tuple[float, ...] = ()
    part: float = 1.0  # of the restoration along it that is shown


def restore(
    view: View,
    settings: Settings,
    *,
    trajectory: Trajectory | None = None,
    start: ApproximatePath | None = None,
    estimate: Estimator = search.estimate,
    observe: Observer = ignore,
) -> FrameResult:
    """The latent image of a frame at the pose of the middle of its interval, blind unless a trajectory is given.

    An approximate trajectory, as from a gyroscope, can be the `start` of the blind method in place of its own.
    Trajectories, given and returned, are in image axes. Where the verdict is not `deblurred` the latent image is the frame's own.
    """
    path = None if trajectory is None else scanlines.path_along_scanlines(trajectory, view.direction)
    begin = None if start is None else start.along_scanlines(view.direction)
    return restored(view, settings, path=path, start=begin, estimate=estimate, observe=observe).result()


def restored(
    view: View,
    settings: Settings,
    *,
    path: Trajectory | None = None,
    noise: float | None = None,
    flow: Flow | None = None,
    start: ApproximatePath | None = None,
    estimate: Estimator = search.estimate,
    coverage: bool = False,
    observe: Observer = ignore,
) -> Restored:
    """What `restore` answers, all along the scanlines; `noise` counts in place of the view's own, if given.

    With `coverage` the answer also says how much of each latent pixel's light was observed.
    """
    started, timing = time.monotonic(), view.camera.timing
    found = _found(view, settings, start, estimate, observe) if path is None else _Found(trajectory=path, verdict=Verdict.RESTORED)
    path, latent, verdict, covered = centred(found.trajectory, timing.middle), view.pixels, found.verdict, None
    if verdict.deblurred and resolution.too_long(view, longest(view.camera, path)):
        half = {"path": resolution.halved_path(path), "noise": None if noise is None else noise / 2, "flow": flow and flow.scaled(0.5)}
        smaller = restored(resolution.halved(view), settings, **half, coverage=coverage, observe=observe)
        latent = resolution.doubled(smaller.latent, view.pixels)
        if smaller.covered is not None:
            covered = cv2.resize(smaller.covered, latent.shape[1::-1], interpolation=cv2.INTER_LINEAR)
    elif verdict.deblurred:
        frame = tiled_frame(view, path, settings, flow)
        images = nonblind.deblur(frame, settings, view.noise if noise is None else noise)
        for step, image in enumerate(images):
            latent, done = image, step / max(settings.splittings, 1)
            observe(Progress(stage="latent image", fraction=ESTIMATED + (1 - ESTIMATED) * done))
        latent, covered = frame.to_host(latent), frame.covered() if coverage else None
    if verdict is Verdict.UNDIRECTED:
        read = undirected.read(view, path, latent)
        latent, verdict = (read.latent, verdict) if read.worth else (view.pixels, Verdict.UNEXPLAINED)
    elif verdict.deblurred and found.part < 1:
        latent = doubtful.restored(view, path, latent, found.part)
    seconds = time.monotonic() - started
    return Restored(view=view, trajectory=path, latent=latent, verdict=verdict, seconds=seconds, convergence=found.values, covered=covered)


def _found(view: View, settings: Settings, start: ApproximatePath | None, estimate: Estimator, observe: Observer) -> _Found:
    """The trajectory that the picture shows; none in a frame without texture."""
    scene = scene_of(view, settings)
    shown = halved_until_textured(scene)
    if shown is None:
        rest = still(view.camera.timing.interval, degree=settings.degree, axes=2)
        return _Found(trajectory=rest, verdict=Verdict.NO_TEXTURE)
    last = None
    for last in estimate(shown, settings) if start is None else corrected(scene, start, settings):
        observe(Progress(stage=last.stage, fraction=last.fraction))
    assert last is not None  # an estimator yields at least once
    verdict = judge(scene, last.trajectory, last.evidence)
    part = doubtful.share(verdict, longest(view.camera, last.trajectory)) if last.evidence else 1.0
    return _Found(trajectory=last.trajectory, verdict=verdict, values=last.values, part=part)


def model_noise(view: View, error: float) -> float:
    """The noise that the model of the blur leaves: the sensor's, and what a path that is off by `error` px makes of the gradients."""
    return float(np.hypot(view.noise, error * np.sqrt(gradient_power(luminance(view.pixels)))))


def tiled_frame(view: View, path: Trajectory, settings: Settings, flow: Flow | None = None) -> BlurredFrame:
    """The frame with its blur along `path`, which is 0 where the latent image is wanted."""
    tiled = device_frame.tiled if settings.device == "cuda" else nonblind.tiled
    return tiled(
        view.pixels,
        view.clipped,
        path,
        view.camera,
        samples=max(settings.samples, math.ceil(longest(view.camera, path))),
        tolerance=settings.tolerance,
        flow=flow,
    )
