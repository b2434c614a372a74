"""The trajectory of one frame from its picture alone: paths that the spectra allow, and a race that one of them wins."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from rsvideo import threads
from rsvideo.physics.trajectory import Trajectory, centred, still
from rsvideo.restoration import kernel_search
from rsvideo.restoration.estimate import ESTIMATED, Estimate
from rsvideo.restoration.evidence import evidence, sparser, spoken
from rsvideo.restoration.extent import beyond, longest, sampled
from rsvideo.restoration.focus import focus_value
from rsvideo.restoration.refinement import focused, refine
from rsvideo.restoration.scene import COARSE_REACH, LONG_REACH, TRIAL_COLS, WINDOW_COLS, Scene, halved, shrunk, spread
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.spectral_paths import LARGEST_SIDE, SpectralBelief, mirrored, spectral_paths

SHOWN = 5.0  # px, that the longest blur keeps in a scene that is halved for its size
SPECTRA = 0.5  # weight of the spectra's misfit beside f
SHARPEST = 2  # paths in best focus that go on besides: f prefers short paths, and spectra may mislead; about the true path only is a dip
LAST_STEPS, FINER_STEPS = 20, 8  # of the winner alone, by its focus: where a long blur still shows, and at each finer resolution
LAST_SPECTRA, FINAL_SPECTRA = 0.3, 0.5  # weight of the spectra's misfit beside the focus, in the former and in the latter
FULL = 10.0  # px of blur in the spectra's scene, beyond which the latter falls to the former: a patch holds few periods of long blurs
PLAIN = 8.0  # standard errors, in the columns on which paths are judged; one that leads wrongly had 5.3
BEGUN, FOUND, HEAT = 0.02, 0.3, 0.13  # of a frame's work: before and after the spectra, a heat


def estimate(scene: Scene, settings: Settings) -> Iterator[Estimate]:
    """The trajectory, coarse to fine; the last estimate is the answer."""
    if settings.start != "spectra":
        yield from kernel_search.estimate(scene, settings)
        return
    rest = still(scene.camera.timing.interval, degree=settings.degree, axes=settings.axes)
    yield Estimate(stage="spectra", fraction=BEGUN, trajectory=rest)
    found = spectral_paths(scene, settings)
    if found is None:
        yield from kernel_search.estimate(scene, settings)
        return
    belief, paths = found
    if not paths:  # the spectra are those of a frame at rest
        yield Estimate(stage="spectra", fraction=ESTIMATED, trajectory=rest)
        return
    at = _Resolutions.of(scene, longest(scene.camera, paths[0]))
    belief = replace(belief, weight=SPECTRA)
    running = [_Runner(trajectory=path) for each in paths for path in (each, mirrored(each))]
    for i, (steps, wide, most) in enumerate(settings.effort.heats):
        yield Estimate(stage="candidate paths", fraction=FOUND + HEAT * i, trajectory=running[0].trajectory)
        where = at.part if wide else at.coarse if i == 0 else at.trial
        running = sorted(threads.each(partial(_Runner.ahead, scene=where, belief=belief, steps=steps), running), key=lambda r: r.value)
        inside = [r for r in running if not beyond(scene.camera, scene.scaled(r.trajectory))] or running[:1]
        running = _going_on(inside, where, most)
        length = longest(scene.camera, running[0].trajectory)
        at = _Resolutions.of(scene, length) if at.trial.scale * length > LONG_REACH else at
    speaks = threads.each(lambda runner: spoken(at.part, runner.trajectory), running)
    path = running[int(np.argmax(speaks))].trajectory
    yield _answer(path, at, belief)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Resolutions:
    """A scene as paths of one length are tried on it: halved until neither it nor their blur is too large."""

    part: Scene
    trial: Scene  # fewer columns
    coarse: Scene  # half the resolution, where a long blur still shows
    fine: Scene  # twice the resolution, where a large scene was halved
    whole: Scene  # of that resolution, all columns

    @classmethod
    def of(cls, scene: Scene, length: float) -> "_Resolutions":
        scene = shrunk(scene, length, LONG_REACH)
        finer = scene
        while max(scene.frame.shape) > LARGEST_SIDE and length * scene.scale >= 2 * SHOWN:
            finer, scene = scene, halved(scene)
        coarse = spread(halved(scene), TRIAL_COLS // 2) if length * scene.scale > COARSE_REACH else None
        trial = spread(scene, TRIAL_COLS)
        fine = trial if finer is scene else spread(finer, TRIAL_COLS)
        return cls(
            part=spread(scene, WINDOW_COLS), trial=trial, coarse=coarse or trial, fine=fine, whole=spread(finer, finer.frame.shape[1])
        )

    @property
    def plain(self) -> float:
        """Standard errors by which a path is sparser in the whole than its mirror image, from which on that has no second chance."""
        return PLAIN * math.sqrt(self.whole.counted / self.part.counted)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Led:
    """A path after the last steps, which its focus leads."""

    trajectory: Trajectory
    rest: float  # by how much the spectra's misfit was lower than at rest, before they were followed closely: any path can be led there
    values: tuple[float, ...]  # after each step


def _answer(path: Trajectory, at: _Resolutions, belief: SpectralBelief) -> Estimate:
    """The race's winner after the last steps, or its mirror image after the same, and what speaks for it.

    A path of the wrong length may be sparser than its exact mirror image though it leads in the wrong direction. So unless the direction is
    plain, the mirror image takes the last steps, too; and the path has to be sparser than both.
    """
    led = _led(path, at, belief)
    found = evidence(at.part, at.whole, led.trajectory, led.rest)
    if found.mirror < 0:
        led = replace(led, trajectory=mirrored(led.trajectory))
        found = evidence(at.part, at.whole, led.trajectory, led.rest)
    if found.mirror < at.plain:
        back = _led(mirrored(led.trajectory), at, belief)
        surely = sparser(at.whole, led.trajectory, back.trajectory)
        if surely < 0:
            led, found, surely = back, evidence(at.part, at.whole, back.trajectory, back.rest), -surely
        found = replace(found, mirror=min(found.mirror, surely))
    return Estimate(stage="path", fraction=ESTIMATED, trajectory=led.trajectory, values=led.values, evidence=found)


def _led(path: Trajectory, at: _Resolutions, belief: SpectralBelief) -> _Led:
    """Where the last steps lead from a path."""
    best = focused(sampled(at.coarse, path), path, replace(belief, weight=LAST_SPECTRA), steps=LAST_STEPS)
    path, values, rest = best.trajectory, best.values, belief.spectrum.drop(best.trajectory)
    blur = max(longest(at.part.camera, path) * belief.spectrum.scene.scale, FULL)
    closely = replace(belief, weight=max(FINAL_SPECTRA * (FULL / blur) ** 2, LAST_SPECTRA))
    for where in dict.fromkeys((at.trial, at.fine)):
        best = focused(sampled(where, path), path, closely, steps=FINER_STEPS)
        path, values = best.trajectory, values + best.values
    return _Led(trajectory=path, rest=rest, values=values)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Runner:
    """A path in the race: the lowest value so far wins."""

    trajectory: Trajectory
    value: float = math.inf  # f and what the spectra say

    def ahead(self, scene: Scene, belief: SpectralBelief, steps: int) -> "_Runner":
        refined = refine(sampled(scene, self.trajectory), self.trajectory, belief, ridge=scene.search_ridge, steps=steps)
        return replace(self, trajectory=refined.trajectory, value=refined.value)


def _going_on(running: list[_Runner], scene: Scene, most: int) -> list[_Runner]:
    """The first of them, which are sorted by their value, and those in best focus."""
    if len(running) <= most:
        return running

    def sharpness(runner: _Runner) -> float:
        path = centred(runner.trajectory, scene.camera.timing.middle)
        return focus_value(sampled(scene, path), path)

    sharpest = [running[k] for k in np.argsort(threads.each(sharpness, running))[::-1][:SHARPEST]]
    return running[:most] + [runner for runner in sharpest if runner not in running[:most]]
