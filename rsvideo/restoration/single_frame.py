"""From one blurred frame to its trajectory and its latent image (Algorithm 1, and what replaces its inner loop)."""

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Literal

import numpy as np

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.luminance import luminance
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Spline, Trajectory, centred, fit, still
from rsvideo.restoration import initialise, psf_fit, sparsity, tracing
from rsvideo.restoration import nonblind as latent_update
from rsvideo.restoration.alternation import PaperSettings, alternate
from rsvideo.restoration.blind_kernel import KernelSettings
from rsvideo.restoration.nonblind import TiledFrame
from rsvideo.restoration.psf_fit import Candidate
from rsvideo.restoration.sparsity import Prior, Scene

WINDOW_COLS = 800  # the motion is estimated from at most so many columns, the ones with most texture
TILED_COLS = 96  # a narrower frame is one tile
TRIAL_COLS = 560  # and candidates are compared on so many
COARSE_REACH = 12.0  # px; blurs longer than this still show at half the resolution
HEATS = ((6, False, 3), (10, True, 3))  # steps, on all columns?, how many candidates go on
COSTLIEST, CHEAPER_ACROSS, DENSER, CONTRAST = 2.3, 3.0, 0.008, 0.4  # see `judge`
EVEN = 0.01  # that f may be higher along the same path backwards, for that to be worth a try
TRUST = 2e-3  # in what is known of a path, against the sparsity of a picture of ENOUGH pixels or more
ENOUGH = 30_000  # of fewer, sparsity tells less
SHORTEST = 1.0  # px; a frame whose path is shorter than this is sharp
SHARP_KERNEL = 2.0  # px; kernels of sharp strips are found about 1.8 px long, for the latent image has hard edges


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a frame is restored. The paper's symbols stand behind the names."""

    motion: Literal["rotation", "shift"] = "rotation"
    degree: int = 4  # P
    start: Literal["kernels", "tracing"] = "kernels"  # the first trajectory: a fit of rendered PSFs, or the paper's tracing
    refinement: Literal["sparsity", "alternation"] = "sparsity"  # latent image eliminated, or the paper's Algorithm 1
    prior: Literal["denoiser", "tv"] = "denoiser"
    samples: int = 30  # K, path samples an exposure; a longer path takes one a pixel
    mu: float = 1e-2  # the alternation's first weight of total variation
    mu_factor: float = 0.7  # tau
    mu_last: float = 1e-3
    mu_final: float = 7e-4  # of the final image, with prior "tv"
    tolerance: float = 0.25  # px, a tile's error at its edge
    candidates: int = 5  # first trajectories that are refined before one is chosen, and up to as many without one of the strips
    trust: float = 0.15  # in the strips' kernels, against the picture's sparsity
    frames: Literal["together", "alone", "cold"] = "together"  # of a clip: with their neighbours, along its path only, or as stills

    def __post_init__(self) -> None:
        if not 1 <= self.degree <= 12:
            raise ValueError(f"degree must lie in [1, 12], got {self.degree}; one frame does not determine more")


@dataclass(frozen=True, kw_only=True, eq=False)
class Iterate:
    """A state of the work that can be shown (the paper's Fig. 5)."""

    stage: str
    fraction: float  # of the whole work, 0 to 1
    trajectory: Trajectory | None
    latent: np.ndarray | None
    values: tuple[float, ...] = ()  # of the objective, step by step


@dataclass(frozen=True, kw_only=True, eq=False)
class Known:
    """A trajectory that is known to some extent."""

    trajectory: Trajectory
    drift: float  # px over the frame's interval, that it may be wrong by
    share: float  # and of its own length

    def along(self, timing: ShutterTiming) -> "Known":
        """The same along the scanlines, for one in image axes."""
        axes = self.trajectory.coefficients.shape[1]
        turn = timing.direction.pose_from_scanlines[:axes, :axes]
        return replace(self, trajectory=self.trajectory.with_coefficients(self.trajectory.coefficients @ turn))


def ignore(_: Iterate) -> None:
    """Watch nothing."""


def restore(
    frame: Frame,
    timing: ShutterTiming,
    intrinsics: Intrinsics,
    settings: Settings,
    *,
    timing_source: str = "explicit",
    trajectory: Trajectory | None = None,
    start: "Known | None" = None,
    observe: Callable[[Iterate], None] = ignore,
) -> FrameResult:
    """The latent image of `frame` at the pose of the middle of its interval, blind unless a trajectory is given.

    What is known of the trajectory, as a gyroscope's word, can be given as the `start` of the blind method in place of its own.
    Trajectories, given and returned, are in image axes. Where the verdict is not RESTORED the latent image is the frame's own.
    """
    started = time.monotonic()
    direction = timing.direction
    view = along_scanlines(frame, timing, intrinsics)
    turn = direction.pose_from_scanlines
    verdict = Verdict.RESTORED
    path: Trajectory | None = None
    values: tuple[float, ...] = ()
    if trajectory is not None:
        axes = trajectory.coefficients.shape[1]
        path = trajectory.with_coefficients(trajectory.coefficients @ turn[:axes, :axes])
    elif (scene := _scene(view, settings)).gradient_power < max(1e-7, 8 * scene.noise**2):
        verdict = Verdict.NO_TEXTURE
    else:
        states = estimate(scene, settings) if start is None else corrected(scene, start.along(timing), settings)
        for iterate in states:
            path, values = iterate.trajectory, iterate.values
            observe(iterate)
        assert path is not None
        verdict = judge(scene, path)
    axes = 2 if path is None else path.coefficients.shape[1]
    path = still(timing.interval, degree=settings.degree, axes=axes) if path is None else centred(path, timing.middle)
    latent = frame.pixels
    if verdict is Verdict.RESTORED:
        steps = latent_update.deblur(
            tiled_frame(view, path, settings),
            prior=settings.prior,
            mu=settings.mu_final if settings.prior == "tv" else 5e-4,
            noise=view.noise,
        )
        for step, image in enumerate(steps):
            latent = image
            fraction = 0.75 + 0.25 * min(step / latent_update.SPLITTINGS, 1)
            observe(Iterate(stage="latent image", fraction=fraction, trajectory=path, latent=direction.image(latent)))
        latent = np.ascontiguousarray(direction.image(latent))
    return FrameResult(
        frame=frame,
        timing=timing,
        timing_source=timing_source,
        trajectory=path.with_coefficients(path.coefficients @ turn[:axes, :axes].T),
        latent=latent,
        verdict=verdict,
        seconds=time.monotonic() - started,
        convergence=values,
    )


def tiled_frame(view: "View", path: Trajectory, settings: Settings) -> TiledFrame:
    """The frame with its blur along `path`, which is 0 where the latent image is wanted."""
    return latent_update.tiled(
        view.frame.pixels,
        view.frame.clipped,
        path,
        view.intrinsics,
        view.timing,
        samples=max(settings.samples, math.ceil(longest(view.timing, path))),
        tolerance=settings.tolerance,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A frame as if it had been read from top to bottom."""

    frame: Frame
    timing: ShutterTiming
    intrinsics: Intrinsics
    noise: float  # in linear light


def intrinsics_along(intrinsics: Intrinsics, timing: ShutterTiming) -> Intrinsics:
    """The camera of the frame turned so that its scanlines run from top to bottom."""
    way, c = timing.direction, intrinsics
    if way in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT):
        c = Intrinsics(fx=c.fy, fy=c.fx, cx=c.cy, cy=c.cx, rows=c.cols, cols=c.rows)
    if way in (Direction.BOTTOM_TO_TOP, Direction.RIGHT_TO_LEFT):
        c = replace(c, cy=c.rows - 1 - c.cy)
    return c


def along_scanlines(frame: Frame, timing: ShutterTiming, intrinsics: Intrinsics) -> View:
    """The frame as if it had been read from top to bottom."""
    way = timing.direction
    pixels = np.ascontiguousarray(way.scanlines(frame.pixels), np.float32)
    return View(
        frame=Frame(pixels=pixels, clipped=np.ascontiguousarray(way.scanlines(frame.clipped)), time=frame.time, index=frame.index),
        timing=replace(timing, direction=Direction.TOP_TO_BOTTOM),
        intrinsics=intrinsics_along(intrinsics, timing),
        noise=max(sparsity.noise_level(luminance(pixels)) * (math.sqrt(1.8) if pixels.shape[2] == 3 else 1.0), 1e-3),
    )


def observed(frame: Frame, timing: ShutterTiming, intrinsics: Intrinsics, settings: Settings) -> Scene:
    """What the trajectory of a frame is estimated from, along its scanlines."""
    return _scene(along_scanlines(frame, timing, intrinsics), settings)


def _scene(view: View, settings: Settings) -> Scene:
    grey = luminance(view.frame.pixels)
    white = max(float(np.percentile(grey, 99.5)), 1e-3)
    normalised = np.minimum(grey / white, 1).astype(np.float32)
    valid = ~(view.frame.clipped.any(axis=2) | (grey >= white))
    return Scene(
        frame=normalised,
        valid=valid.astype(np.float32),
        timing=view.timing,
        intrinsics=view.intrinsics,
        samples=min(settings.samples, 24),
        tiles=int(np.clip(round(grey.shape[1] / 120), 2, 6)) if grey.shape[1] >= TILED_COLS else 1,
        noise=sparsity.noise_level(normalised),
    )


def windowed(scene: Scene, cols: int) -> Scene:
    """The `cols` columns with most texture, where the frame is wider than that."""
    if scene.frame.shape[1] <= cols:
        return scene
    power = np.abs(np.diff(scene.frame, axis=1)).sum(axis=0)
    total = np.convolve(power, np.ones(cols - 1), "valid")
    first = int(np.argmax(total))
    part = slice(first, first + cols)
    c = replace(scene.intrinsics, cx=scene.intrinsics.cx - first, cols=cols)
    return replace(scene, frame=np.ascontiguousarray(scene.frame[:, part]), valid=np.ascontiguousarray(scene.valid[:, part]), intrinsics=c)


def estimate(scene: Scene, settings: Settings) -> Iterator[Iterate]:
    """The trajectory, coarse to fine; the last iterate is the answer."""
    part, trial = windowed(scene, WINDOW_COLS), windowed(scene, TRIAL_COLS)
    kernels = KernelSettings()
    found = initialise.strip_kernels(part.frame, part.timing, kernels, parts=1)
    yield Iterate(stage="strip kernels", fraction=0.15, trajectory=still(part.timing.interval, degree=1, axes=2), latent=None)
    if sum(psf_fit.length(s.kernel) < SHARP_KERNEL for s in found) >= min(2, len(found)):
        return
    dense = max(part.samples, math.ceil(psf_fit.reach(found)))
    part, trial = (replace(s, samples=dense) for s in (part, trial))
    fits = list(initialise.candidates(found, part.timing, part.intrinsics, degree=settings.degree, most=settings.candidates))
    starts = [start for start in fits if not beyond(scene, start.trajectory)]
    if not starts:
        yield Iterate(stage="candidate paths", fraction=0.75, trajectory=fits[0].trajectory, latent=None)
        return
    if settings.start == "tracing":
        traced = tracing.trace(found, part.timing, degree=settings.degree)
        starts = [replace(starts[0], trajectory=traced)]
    if settings.refinement == "alternation":
        yield from _alternated(part, starts[0].trajectory, settings)
        return
    turning = settings.motion == "rotation"
    halves = initialise.strip_kernels(part.frame, part.timing, kernels, parts=2) if turning else []
    long = psf_fit.reach(found) > COARSE_REACH
    coarse = sparsity.halved(trial) if long else trial

    def runners(starts: list[Candidate], most: int) -> list[_Runner]:
        if turning:
            starts = initialise.with_roll(starts, found, halves, part.timing, part.intrinsics, degree=settings.degree)
        ready = [_Runner(start=start, trajectory=start.trajectory).ahead(coarse, settings.trust, 1) for start in starts]
        return sorted(ready, key=lambda r: r.value)[:most]

    def told_apart(r: _Runner) -> float:
        return r.value + (r.sparsity(coarse) if long else 0) + 0.05 * math.log(sparsity.energy(part, r.trajectory))

    running = runners(starts, 4)
    for i, (steps, wide, most) in enumerate(HEATS):
        yield Iterate(stage="candidate paths", fraction=0.3 + 0.1 * i, trajectory=running[0].trajectory, latent=None)
        running = sorted((r.ahead(part if wide else trial, settings.trust, steps) for r in running), key=lambda r: r.value)[:most]
    winner = min(running, key=told_apart)
    back = still(part.timing.interval, degree=settings.degree, axes=2).with_coefficients(-winner.trajectory.coefficients[:, :2])
    how = {"degree": settings.degree, "stiffness": winner.start.stiffness, "keep": 1}
    rival = runners(psf_fit.fit(found, part.timing, part.intrinsics, start=back, **how), 1)[0]
    yield Iterate(stage="the same path backwards", fraction=0.6, trajectory=rival.trajectory, latent=None)
    if rival.sparsity(trial) - winner.sparsity(trial) < EVEN:
        winner = min(winner, rival.ahead(part, settings.trust, HEATS[-1][0]), key=told_apart)
    best = sparsity.refine(part, winner.trajectory, winner.prior(settings.trust), ridge=part.ridge, steps=8)
    yield Iterate(stage="path", fraction=0.75, trajectory=best.trajectory, latent=None, values=best.values)


def corrected(scene: Scene, start: Known, settings: Settings) -> Iterator[Iterate]:
    """The known trajectory, and a polynomial beside it as far as it may be wrong, found by the picture's sparsity."""
    given = start.trajectory
    t = np.linspace(*scene.timing.interval, 129)
    first = fit(still(scene.timing.interval, degree=settings.degree, axes=given.coefficients.shape[1]), t, given.at(t))
    poses = first.at(t)
    length = float(np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1).sum())
    unit = np.array([1, 1, 1 / scene.intrinsics.fx])[: poses.shape[1]]
    spread = 0.35 * (start.drift + start.share * length) * np.tile(unit, settings.degree)
    part = windowed(scene, WINDOW_COLS)
    weight = TRUST * max(1.0, ENOUGH / part.frame.size)
    prior = Prior(mean=first.coefficients[1:], curvature=np.diag(spread**-2), weight=weight)
    part = replace(part, samples=max(part.samples, math.ceil(longest(part.timing, first))))
    yield Iterate(stage="path", fraction=0.1, trajectory=given, latent=None)
    best = sparsity.refine(part, first, prior, ridge=part.ridge, steps=16)
    finer = Spline(t0=t[0], t1=t[-1], coefficients=np.zeros((max(64, len(given.coefficients)), poses.shape[1])))
    t = np.linspace(*scene.timing.interval, 4 * len(finer.coefficients))
    path = fit(finer, t, given.at(t) + best.trajectory.at(t) - first.at(t))
    yield Iterate(stage="path", fraction=0.75, trajectory=path, latent=None, values=best.values)


def _alternated(scene: Scene, start: Trajectory, settings: Settings) -> Iterator[Iterate]:
    """The paper's Algorithm 1 from `start`."""
    paper = PaperSettings(K=settings.samples, mu_0=settings.mu, tau=settings.mu_factor, mu_min=settings.mu_last)
    states = alternate(scene.frame, timing=scene.timing, intrinsics=scene.intrinsics, start=start, settings=paper)
    total = 1 + math.ceil(math.log(settings.mu_last / settings.mu) / math.log(settings.mu_factor))
    for step, state in enumerate(islice(states, total)):
        fraction = min(0.15 + 0.6 * (step + 1) / total, 0.75)
        yield Iterate(stage="alternation", fraction=fraction, trajectory=state.trajectory, latent=state.sharp)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Runner:
    """A candidate on its way: the lowest value so far wins."""

    start: Candidate
    trajectory: Trajectory
    value: float = math.inf  # sparsity, the prior, and how badly the strips' kernels are explained

    def prior(self, trust: float) -> Prior:
        return Prior(mean=self.start.trajectory.coefficients[1:], curvature=self.start.curvature, weight=trust)

    def sparsity(self, scene: Scene) -> float:
        return sparsity.objective(scene, self.trajectory, 3 * scene.ridge)[0]

    def ahead(self, scene: Scene, trust: float, steps: int) -> "_Runner":
        refined = sparsity.refine(scene, self.trajectory, self.prior(trust), ridge=3 * scene.ridge, steps=steps)
        return replace(self, trajectory=refined.trajectory, value=refined.value + trust * self.start.energy)


def longest(timing: ShutterTiming, path: Trajectory) -> float:
    """The largest extent in px of any scanline's path."""
    poses = path.at(timing.sample_times(16)[:: max(1, timing.rows // 32)])[..., :2]
    return float(np.linalg.norm(poses.max(axis=1) - poses.min(axis=1), axis=-1).max())


def beyond(scene: Scene, path: Trajectory) -> bool:
    """Whether the path leads over more than half the frame: no hand's does, and kernels that ask for it describe the picture."""
    poses = path.at(np.linspace(*scene.timing.interval, 65))[:, :2]
    return float(np.ptp(poses, axis=0).max()) > 0.5 * min(scene.frame.shape)


def judge(scene: Scene, path: Trajectory) -> Verdict:
    """Whether restoring along `path` will help.

    Deblurring trades blur for contrast, so the energy of Eq. (8) rises over that of the frame taken as sharp: by a factor
    of 1.3 to 1.9 along most true paths; beyond `COSTLIEST` the frame holds detail that no blur along the path can have left,
    unless across the path it would rise `CHEAPER_ACROSS` times as far again.
    And the latent image's edges are hardly ever less sparse than the frame's own (by `DENSER`), but where restoring across
    the path makes them far less sparse still: otherwise the strips' kernels described the picture and not its blur.
    """
    if beyond(scene, path):
        return Verdict.UNEXPLAINED
    part = windowed(scene, WINDOW_COLS)
    rest = path.with_coefficients(0 * path.coefficients)
    if longest(part.timing, path) < SHORTEST:
        return Verdict.SHARP
    energy, turned = sparsity.energy(part, path), sparsity.turned(path)
    if energy > COSTLIEST * sparsity.energy(part, rest) and sparsity.energy(part, turned) < CHEAPER_ACROSS * energy:
        return Verdict.UNEXPLAINED
    moving, steady, across = (sparsity.objective(part, p, 3 * part.ridge)[0] for p in (path, rest, turned))
    return Verdict.UNEXPLAINED if moving - steady > DENSER + CONTRAST * (across - moving) else Verdict.RESTORED
