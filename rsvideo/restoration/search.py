"""The trajectory of one frame from its picture alone: paths that the spectra allow, and a race that one of them wins."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from rsvideo.physics.trajectory import Trajectory, centred, still
from rsvideo.restoration import kernel_search
from rsvideo.restoration.estimate import ESTIMATED, Estimate, Evidence
from rsvideo.restoration.focus import focus_value
from rsvideo.restoration.refinement import focused, refine
from rsvideo.restoration.scene import Scene, halved, windowed
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.sparsity import value
from rsvideo.restoration.spectral_paths import SpectralBelief, mirrored, spectral_paths
from rsvideo.restoration.spectrum import Spectrum
from rsvideo.restoration.verdict import beyond, longest

TRIAL_COLS = 560  # with most texture, on which paths are compared
COARSE_REACH = 12.0  # px; blurs longer than this still show at half the resolution, where paths then run first
SPECTRA = 0.5  # weight of the spectra's misfit beside f
HEATS = ((3, False, 5), (5, False, 3), (5, True, 3))  # steps, on all columns?, how many paths go on; origin: by trial
LAST_STEPS, LAST_SPECTRA = 20, 0.1  # of the winner alone, by its focus, and the weight beside it
MIDDLES = 8  # samples of an exposure, whose mean is a scanline's place
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
    if not paths:
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
    winner = running[0]
    best = focused(sampled(trial, winner.trajectory), winner.trajectory, replace(belief, weight=LAST_SPECTRA), steps=LAST_STEPS)
    yield Estimate(
        stage="path",
        fraction=ESTIMATED,
        trajectory=best.trajectory,
        values=best.values,
        evidence=evidence(part, belief.spectrum, best.trajectory),
    )


def evidence(scene: Scene, spectrum: Spectrum, path: Trajectory) -> Evidence:
    """What speaks for a path that was found."""
    scene = sampled(scene, path)
    middles = scene.camera.timing.sample_times(MIDDLES).mean(axis=1)
    rest, back = path.with_coefficients(0 * path.coefficients), mirrored(path)
    return Evidence(
        rest=spectrum.value(rest) - spectrum.value(path),
        mirror=value(scene, back, scene.search_ridge) - value(scene, path, scene.search_ridge),
        wobble=float(np.linalg.norm(path.at(middles)[:, :2].std(axis=0))),
        focus=focus_value(scene, centred(path, scene.camera.timing.middle)),
        pixels=scene.frame.size,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Runner:
    """A path in the race: the lowest value so far wins."""

    trajectory: Trajectory
    value: float = math.inf  # f and what the spectra say

    def ahead(self, scene: Scene, belief: SpectralBelief, steps: int) -> "_Runner":
        refined = refine(sampled(scene, self.trajectory), self.trajectory, belief, ridge=scene.search_ridge, steps=steps)
        return replace(self, trajectory=refined.trajectory, value=refined.value)


def sampled(scene: Scene, path: Trajectory) -> Scene:
    """The scene with as many path samples an exposure as the path has px: fewer would make a comb of it."""
    return replace(scene, samples=max(scene.samples, math.ceil(longest(scene.camera, scene.scaled(path)))))
