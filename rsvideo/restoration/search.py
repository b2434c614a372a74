"""The trajectory of one frame from its picture alone: paths that the spectra allow, and a race that one of them wins."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice

import numpy as np

from rsvideo.physics.trajectory import Trajectory, still
from rsvideo.restoration import kernel_search
from rsvideo.restoration.estimate import ESTIMATED, Estimate
from rsvideo.restoration.evidence import compared, evidence
from rsvideo.restoration.extent import beyond, longest, sampled
from rsvideo.restoration.refinement import focused, refine
from rsvideo.restoration.scene import COARSE_REACH, TRIAL_COLS, Scene, halved, windowed
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.spectral_paths import APART, TIMES, SpectralBelief, apart, mirrored, spectral_paths
from rsvideo.restoration.verdict import FOCUS, MIRROR

SPECTRA = 0.5  # weight of the spectra's misfit beside f
HEATS = ((3, False, 5), (5, False, 3), (5, True, 3))  # steps, on all columns?, how many paths go on; origin: by trial
LAST_STEPS, FINER_STEPS = 20, 8  # of the winner alone, by its focus; the latter at full resolution after the former at half
CLOSE = 4.0  # standard errors, by which less may speak for a path than for the best one, and it is focused too
LEAD = 2.0  # standard errors, by which more must speak for that other path once both are focused
LAST_SPECTRA = 0.1  # weight of the spectra's misfit beside the focus
BEGUN, FOUND, HEAT = 0.02, 0.3, 0.13  # of a frame's work: before and after the spectra, a heat


def estimate(scene: Scene, settings: Settings) -> Iterator[Estimate]:
    """The trajectory, coarse to fine; the last estimate is the answer."""
    if settings.start != "spectra":
        yield from kernel_search.estimate(scene, settings)
        return
    part, rest = windowed(scene), still(scene.camera.timing.interval, degree=settings.degree, axes=settings.axes)
    yield Estimate(stage="spectra", fraction=BEGUN, trajectory=rest)
    found = spectral_paths(part, settings)
    if found is None:
        yield from kernel_search.estimate(scene, settings)
        return
    belief, paths = found
    if not paths:  # the spectra are those of a frame at rest
        yield Estimate(stage="spectra", fraction=ESTIMATED, trajectory=rest)
        return
    trial = windowed(scene, TRIAL_COLS)
    coarse = halved(trial) if longest(part.camera, paths[0]) > COARSE_REACH else trial
    belief = replace(belief, weight=SPECTRA)
    running = [_Runner(trajectory=path) for each in paths for path in (each, mirrored(each))]
    for i, (steps, wide, most) in enumerate(HEATS):
        yield Estimate(stage="candidate paths", fraction=FOUND + HEAT * i, trajectory=running[0].trajectory)
        where = part if wide else coarse if i == 0 else trial
        running = sorted((r.ahead(where, belief, steps) for r in running), key=lambda r: r.value)
        running = [r for r in running if not beyond(scene.camera, r.trajectory)][:most] or running[:1]
    belief = replace(belief, weight=LAST_SPECTRA)
    scenes = ((trial, LAST_STEPS),) if coarse is trial else ((coarse, LAST_STEPS), (trial, FINER_STEPS))
    ends = [_focused(path, scenes, belief, part) for path in _finalists(trial, [runner.trajectory for runner in running])]
    yield ends[-1] if _speaks(ends[-1]) > _speaks(ends[0]) + LEAD else ends[0]


def _finalists(scene: Scene, paths: list[Trajectory]) -> list[Trajectory]:
    """The path that most speaks for, and one that differs from it, if nearly as much speaks for that.

    That other one has to be convincing as it is: focusing raises what speaks for any path, so trying more of them restores more wrongly.
    """
    times = np.linspace(*scene.camera.timing.interval, TIMES)
    rated = sorted(((compared(scene, path), path) for path in paths), key=lambda pair: sum(pair[0]), reverse=True)
    most, first = rated[0]
    others = (
        path
        for (mirror, focus), path in rated[1:]
        if mirror > MIRROR and focus > FOCUS and mirror + focus > sum(most) - CLOSE and apart(path, first, times) > APART
    )
    return [first, *islice(others, 1)]


def _focused(path: Trajectory, scenes: tuple[tuple[Scene, int], ...], belief: SpectralBelief, part: Scene) -> Estimate:
    """The last steps, by the path's focus, and what speaks for where they lead."""
    values: tuple[float, ...] = ()
    for where, steps in scenes:
        best = focused(sampled(where, path), path, belief, steps=steps)
        path, values = best.trajectory, values + best.values
    found = evidence(part, belief.spectrum, path)
    if found.mirror < 0:
        path = mirrored(path)
        found = evidence(part, belief.spectrum, path)
    return Estimate(stage="path", fraction=ESTIMATED, trajectory=path, values=values, evidence=found)


def _speaks(estimate: Estimate) -> float:
    """Standard errors in all."""
    assert estimate.evidence is not None
    return estimate.evidence.mirror + estimate.evidence.focus


@dataclass(frozen=True, kw_only=True, eq=False)
class _Runner:
    """A path in the race: the lowest value so far wins."""

    trajectory: Trajectory
    value: float = math.inf  # f and what the spectra say

    def ahead(self, scene: Scene, belief: SpectralBelief, steps: int) -> "_Runner":
        refined = refine(sampled(scene, self.trajectory), self.trajectory, belief, ridge=scene.search_ridge, steps=steps)
        return replace(self, trajectory=refined.trajectory, value=refined.value)
