"""The trajectory of one frame from the kernels of its strips: candidates that explain them, and a race that one of them wins."""

import math
from collections.abc import Generator, Iterator
from dataclasses import dataclass, replace

from rsvideo.physics.trajectory import Trajectory, still
from rsvideo.restoration import initialise, psf_fit
from rsvideo.restoration.blind_kernel import KernelSettings
from rsvideo.restoration.energy import energy
from rsvideo.restoration.estimate import ESTIMATED, Estimate
from rsvideo.restoration.extent import beyond
from rsvideo.restoration.psf_fit import Candidate, Strip
from rsvideo.restoration.refinement import Prior, refine
from rsvideo.restoration.scene import TRIAL_COLS, Scene, halved, windowed
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.sparsity import objective

LONG_KERNEL = 12.0  # px; the paths of longer kernels run at half the resolution first
SHARP_KERNEL = 2.0  # px; kernels of sharp strips are found about 1.8 px long, for the latent image has hard edges
SHARP_STRIPS = 2  # with such a kernel make a frame sharp
FIRST_STEPS = 1  # of L-BFGS, by which all candidates run before the best FINALISTS are chosen
FINALISTS = 4  # candidates that run the heats
HEATS = ((6, False, 3), (10, True, 3))  # steps, on all columns?, how many candidates go on; origin: by trial
LAST_STEPS = 8  # of the winner alone, with the milder ridge
ENERGY = 0.05  # weight of the energy's logarithm beside f, in the end; chosen on the cases in the README
EVEN = 0.01  # by how much f may be higher along the winner's path run backwards for that path to be tried
KERNELS, RACE, HEAT, BACKWARDS = 0.15, 0.3, 0.1, 0.6  # of a frame's work: after the kernels, at the race's start, a heat, after all


@dataclass(frozen=True, kw_only=True, eq=False)
class FirstPaths:
    """What the strips' kernels show of the trajectory."""

    part: Scene  # the columns with most texture, sampled as finely as the blur needs
    strips: list[Strip]
    candidates: list[Candidate]  # that stay within the frame; those without roll, best first


def estimate(scene: Scene, settings: Settings) -> Iterator[Estimate]:
    """The trajectory, coarse to fine; the last estimate is the answer."""
    first = yield from first_paths(scene, settings)
    if first is not None:
        yield from race(scene, first, settings)


def first_paths(scene: Scene, settings: Settings) -> Generator[Estimate, None, FirstPaths | None]:
    """Paths that explain the strips' kernels; None where the frame is sharp or no path is credible, which the last estimate shows."""
    part = windowed(scene)
    timing = part.camera.timing
    strips = initialise.strip_kernels(part.frame, timing, KernelSettings(), parts=1)
    yield Estimate(stage="strip kernels", fraction=KERNELS, trajectory=still(timing.interval, degree=1, axes=2))
    if sum(psf_fit.length(s.kernel) < SHARP_KERNEL for s in strips) >= min(SHARP_STRIPS, len(strips)):
        return None
    part = replace(part, samples=max(part.samples, math.ceil(psf_fit.reach(strips))))
    fits = list(initialise.candidates(strips, part.camera, degree=settings.degree, most=settings.candidates))
    candidates = [candidate for candidate in fits if not beyond(scene.camera, candidate.trajectory)]
    if not candidates:
        yield Estimate(stage="candidate paths", fraction=ESTIMATED, trajectory=fits[0].trajectory)
        return None
    return FirstPaths(part=part, strips=strips, candidates=candidates)


def race(scene: Scene, first: FirstPaths, settings: Settings) -> Iterator[Estimate]:
    """The candidates refined in heats, in which the worse ones drop out; the winner against its own path backwards; then refined alone."""
    course = _Course.of(scene, first, settings)
    running = course.entered(first.candidates)[:FINALISTS]
    for i, (steps, wide, most) in enumerate(HEATS):
        yield Estimate(stage="candidate paths", fraction=RACE + HEAT * i, trajectory=running[0].trajectory)
        where = course.part if wide else course.trial
        running = sorted((r.ahead(where, settings.trust, steps) for r in running), key=lambda r: r.value)[:most]
    winner = min(running, key=course.score)
    rival = course.backwards(winner)
    yield Estimate(stage="the same path backwards", fraction=BACKWARDS, trajectory=rival.trajectory)
    if rival.sparsity(course.trial) - winner.sparsity(course.trial) < EVEN:
        winner = min(winner, rival.ahead(course.part, settings.trust, HEATS[-1][0]), key=course.score)
    part = course.part
    best = refine(part, winner.trajectory, winner.prior(settings.trust), ridge=part.ridge, steps=LAST_STEPS)
    yield Estimate(stage="path", fraction=ESTIMATED, trajectory=best.trajectory, values=best.values)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Runner:
    """A candidate in the race: the lowest value so far wins."""

    start: Candidate
    trajectory: Trajectory
    value: float = math.inf  # sparsity, the prior, and how badly the strips' kernels are explained

    def prior(self, trust: float) -> Prior:
        return Prior(mean=self.start.trajectory.coefficients[1:], curvature=self.start.curvature, weight=trust)

    def sparsity(self, scene: Scene) -> float:
        return objective(scene, self.trajectory, scene.search_ridge)[0]

    def ahead(self, scene: Scene, trust: float, steps: int) -> "_Runner":
        refined = refine(scene, self.trajectory, self.prior(trust), ridge=scene.search_ridge, steps=steps)
        return replace(self, trajectory=refined.trajectory, value=refined.value + trust * self.start.energy)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Course:
    """Where candidates run: all columns that serve, fewer of them, and these at half the resolution where the blur is long."""

    part: Scene
    trial: Scene
    coarse: Scene  # the trial columns themselves where the blur is short
    strips: list[Strip]
    halves: list[Strip]  # left and right halves of the strips, which show roll; none for two axes
    settings: Settings

    @classmethod
    def of(cls, scene: Scene, first: FirstPaths, settings: Settings) -> "_Course":
        part = first.part
        trial = replace(windowed(scene, TRIAL_COLS), samples=part.samples)
        rolls = settings.axes == 3
        return cls(
            part=part,
            trial=trial,
            coarse=halved(trial) if psf_fit.reach(first.strips) > LONG_KERNEL else trial,
            strips=first.strips,
            halves=initialise.strip_kernels(part.frame, part.camera.timing, KernelSettings(), parts=2) if rolls else [],
            settings=settings,
        )

    def entered(self, candidates: list[Candidate]) -> list[_Runner]:
        """The candidates, with roll where the camera may roll, after their first steps; best first."""
        if self.settings.axes == 3:
            candidates = initialise.with_roll(candidates, self.strips, self.halves, self.part.camera, degree=self.settings.degree)
        trust = self.settings.trust
        runners = [_Runner(start=c, trajectory=c.trajectory).ahead(self.coarse, trust, FIRST_STEPS) for c in candidates]
        return sorted(runners, key=lambda r: r.value)

    def backwards(self, runner: _Runner) -> _Runner:
        """The runner's path run backwards, which explains the kernels of an even motion as well, fitted to them anew."""
        degree = self.settings.degree
        back = still(self.part.camera.timing.interval, degree=degree, axes=2).with_coefficients(-runner.trajectory.coefficients[:, :2])
        fits = psf_fit.fit(self.strips, self.part.camera, degree=degree, stiffness=runner.start.stiffness, keep=1, start=back)
        return self.entered(fits)[0]

    def score(self, runner: _Runner) -> float:
        """What ranks the last runners: f, at both resolutions where the blur is long, the kernels and the energy."""
        at_half = runner.sparsity(self.coarse) if self.coarse is not self.trial else 0
        return runner.value + at_half + ENERGY * math.log(energy(self.part, runner.trajectory))
