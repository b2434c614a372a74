"""The first trajectories of a frame: the paths that explain the power spectra of its patches best, each with its mirror image."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from rsvideo import threads
from rsvideo.physics.trajectory import Trajectory, fit, still
from rsvideo.restoration.extent import beyond, longest
from rsvideo.restoration.hand_shake import pose_unit, shake_spread
from rsvideo.restoration.scene import Scene, halved
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.spectrum import SIDE, Spectrum, patches

LENGTHS = 3.0, 5.0, 8.0, 12.0, 17.0, 24.0, 34.0  # px within an exposure, of the even motions that are tried first
LEAST_DROP = 0.08  # by which the spectra's misfit must be lower than at rest, for a frame not to count as sharp
LEAST_MOTION = 0.02  # the same beyond what softness explains, for a large frame's resolution to be chosen
LARGEST_SIDE = 960  # px, of a scene whose own resolution is searched; larger ones are halved, too
PATCH_REACH = 34.0  # px; of longer blurs the coarser resolution judges, in whose patches they have room
ALSO = 2  # paths of the other resolution are handed on
TURN = 2.5  # px by which the ends of neighbouring ones lie apart, and at least
FEWEST_TURNS = 6  # directions
OF_A_LENGTH, OF_ALL, START_STEPS = 2, 6, 12  # the best of each length, and of all besides, are settled by so many steps,
SETTLED, SETTLING_STEPS = 4, 25  # and the best of those that differ settled further
APART = 0.7  # px, RMS over the interval, by which two paths differ
TYPICAL = 12.0  # px, the length that the belief about a hand's path is scaled with
STIFFNESS = 3e-3  # of that belief, beside the misfit
TURNED = 2  # of the best paths, and moments of each, that are tried turned round
TIE = 0.03  # by which the misfit of a path so found may be higher than the least: origin: by trial
END = 2  # of the moments, near the ends of the interval, at which none is
SCALE = 100.0  # what L-BFGS is handed the misfit times, since its first step is as long as the gradient
TIMES = 33  # at which paths are compared


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralBelief:
    """What the spectra and a hand's habits say of a path's coefficients, times a weight; in place of a prior."""

    spectrum: Spectrum
    weight: float = 1.0

    @property
    def spread(self) -> Float[np.ndarray, "unknowns axes"]:
        """Plausible size of each coefficient."""
        terms, axes = self.spectrum.curve.coefficients.shape
        camera = self.spectrum.scene.camera
        unit = pose_unit(camera.intrinsics, axes) / self.spectrum.scene.unit(axes)  # px of the whole frame
        return TYPICAL * shake_spread(terms - 1, camera.timing)[:, None] * unit

    def at(self, coefficients: Float[np.ndarray, "unknowns axes"]) -> tuple[float, Float[np.ndarray, "unknowns axes"]]:
        """The penalty and its derivative."""
        misfit, slope = self.spectrum.misfit(coefficients)
        unlikely = coefficients / self.spread
        value = misfit + STIFFNESS * float((unlikely**2).sum())
        return self.weight * value, self.weight * (slope + 2 * STIFFNESS * unlikely / self.spread)


@dataclass(frozen=True, kw_only=True, eq=False)
class SpectralPath:
    """A path that the spectra allow."""

    trajectory: Trajectory
    misfit: float  # with the belief


@dataclass(frozen=True, kw_only=True, eq=False)
class _Level:
    """What the spectra allow at one resolution."""

    belief: SpectralBelief
    paths: list[SpectralPath]  # best first

    @cached_property
    def drop(self) -> float:
        """By how much the misfit along the best path is lower than at rest."""
        return self.belief.spectrum.drop(self.paths[0].trajectory) if self.paths else 0.0

    @cached_property
    def motion(self) -> float:
        """The same beyond what softness of the scene explains."""
        return replace(self.belief.spectrum, soft=True).drop(self.paths[0].trajectory) if self.paths else 0.0

    @property
    def scale(self) -> float:
        """Of the resolution."""
        return self.belief.spectrum.scene.scale

    @property
    def length(self) -> float:
        """Of the best path, in px of the whole frame."""
        scene = self.belief.spectrum.scene
        return longest(scene.camera, scene.scaled(self.paths[0].trajectory)) / self.scale

    @property
    def blurred(self) -> bool:
        """Whether the spectra are not those of a frame at rest."""
        return self.drop >= LEAST_DROP


def spectral_paths(scene: Scene, settings: Settings) -> tuple[SpectralBelief, list[Trajectory]] | None:
    """Distinct paths that lead to a minimum of the misfit, best first, and what they are to be judged by; None without texture.

    They are looked for at a resolution and at half of it, where long blurs fit into a patch and texture deceives less. The latter judges
    where the former shows no blur, or a longer one than fits. The misfit is even: the mirror image -p of each path explains the spectra as
    well. There is no path where the spectra are those of a frame at rest.
    """
    searched = _searched(scene, settings)
    if not searched:
        return None
    if not any(level.blurred for level in searched):
        return searched[0].belief, []
    levels = [level for level in searched if level.paths]
    if not levels[0].blurred or min(level.length for level in levels) * levels[0].scale > PATCH_REACH:
        levels.reverse()
    times, belief = np.linspace(*scene.camera.timing.interval, TIMES), levels[0].belief
    paths = [each.trajectory for each in levels[0].paths]
    paths += _turned(belief, levels[0].paths, times)
    for each in (also for level in levels[1:] for also in level.paths[:ALSO]):
        if _new(each.trajectory, paths, times):
            paths.append(each.trajectory)
    return belief, paths


def _searched(scene: Scene, settings: Settings) -> list[_Level]:
    """A resolution and half of it: of a large frame those at which its spectra show motion best, and of others their own.

    At half the resolution a short blur hides. At a large frame's own resolution softness resembles blur, or noise hides any.
    """
    scenes = [scene]
    while max(scenes[-1].frame.shape) > LARGEST_SIDE:
        scenes.append(halved(scenes[-1]))
    coarsest = len(scenes) - 1
    if min(scenes[-1].frame.shape) >= 2 * SIDE:
        scenes.append(halved(scenes[-1]))
    levels = [_level(each, settings) for each in scenes]
    blurred = {k: level for k, level in enumerate(levels[: coarsest + 1]) if level and level.blurred}
    shown = {k: level.motion for k, level in blurred.items() if level.motion > LEAST_MOTION}
    best = max(shown, key=shown.__getitem__, default=coarsest)
    return [level for level in levels[best : best + 2] if level is not None]


def _level(scene: Scene, settings: Settings) -> _Level | None:
    """The misfit's minima at a scene's own resolution."""
    observed = patches(scene)
    if observed is None:
        return None
    curve = still(scene.camera.timing.interval, degree=settings.degree, axes=settings.axes)
    belief = SpectralBelief(spectrum=Spectrum(scene=scene, patches=observed, curve=curve))
    tried = threads.each(lambda length: sorted(_even(belief, curve, length), key=lambda each: each.misfit), LENGTHS)
    starts = [each for some in tried for each in some[:OF_A_LENGTH]]
    starts += sorted((each for some in tried for each in some[OF_A_LENGTH:]), key=lambda each: each.misfit)[:OF_ALL]
    found = _distinct(threads.each(lambda each: settled(belief, each.trajectory, START_STEPS), starts), scene)
    best = threads.each(lambda each: settled(belief, each.trajectory, SETTLING_STEPS), found[:SETTLED])
    return _Level(belief=belief, paths=_distinct(best, scene))


def _turned(belief: SpectralBelief, paths: Sequence[SpectralPath], times: Float[np.ndarray, " n"]) -> list[Trajectory]:
    """Further minima, near the best of these paths turned round where they are slowest, whose misfit is hardly higher.

    Where a motion is slowest, spectra hardly tell whether it runs on from there or back: the blur of every scanline is as long.
    """
    found: list[Trajectory] = []
    minima = [each.trajectory for each in paths]
    scene = belief.spectrum.scene
    starts = [turned for path in minima[:TURNED] for turned in turns(path, times)]
    for each in threads.each(lambda turned: settled(belief, turned, SETTLING_STEPS), starts):
        likely = each.misfit < paths[0].misfit + TIE and not beyond(scene.camera, scene.scaled(each.trajectory))
        if likely and _new(each.trajectory, minima + found, times):
            found.append(each.trajectory)
    return found


def turns(path: Trajectory, times: Float[np.ndarray, " n"]) -> Iterator[Trajectory]:
    """The path run backwards from each moment at which it is slowest, slowest first."""
    place = path.at(times)
    speed = np.linalg.norm(np.gradient(place, times, axis=0)[:, :2], axis=1)
    inner = speed[END:-END]
    slow = 1 + np.flatnonzero((inner[1:-1] < inner[:-2]) & (inner[1:-1] < inner[2:]))
    for k in END + slow[np.argsort(inner[slow])][:TURNED]:
        turned = np.where(np.arange(len(times))[:, None] < k, place, 2 * place[k] - place)
        yield path.with_coefficients(fit(path, times, turned).coefficients)


def settled(belief: SpectralBelief, path: Trajectory, steps: int) -> SpectralPath:
    """The local minimum near a path."""
    spread = belief.spread

    def of(z: np.ndarray) -> Trajectory:
        return path.with_coefficients(np.vstack([0 * path.coefficients[:1], z.reshape(spread.shape) * spread]))

    def penalised(z: np.ndarray) -> tuple[float, np.ndarray]:
        value, slope = belief.at(of(z).coefficients[1:])
        return SCALE * value, SCALE * (slope * spread).ravel()

    start = (path.coefficients[1:] / spread).ravel()
    found = minimize(penalised, start, jac=True, method="L-BFGS-B", options={"maxiter": steps})
    return SpectralPath(trajectory=of(found.x), misfit=float(found.fun) / SCALE)


def _even(belief: SpectralBelief, curve: Trajectory, length: float) -> Iterator[SpectralPath]:
    """Even motions of `length` px an exposure, over half of all directions."""
    scene, timing = belief.spectrum.scene, belief.spectrum.scene.camera.timing
    times = np.linspace(*timing.interval, TIMES)
    rate = np.zeros((TIMES, curve.coefficients.shape[1]))
    rate[:, 0] = (times - timing.middle) * length / (timing.exposure * scene.scale)
    even = fit(curve, times, rate).coefficients[:, 0]
    count = max(FEWEST_TURNS, int(np.ceil(np.pi * length / TURN)))
    for angle in np.arange(count) * np.pi / count:
        coefficients = np.zeros_like(curve.coefficients)
        coefficients[:, 0], coefficients[:, 1] = even * np.cos(angle), even * np.sin(angle)
        path = curve.with_coefficients(coefficients)
        if not beyond(scene.camera, scene.scaled(path)):
            yield SpectralPath(trajectory=path, misfit=belief.spectrum.value(path))


def _distinct(paths: list[SpectralPath], scene: Scene) -> list[SpectralPath]:
    """Best first, of those that are alike, or each other's mirror images, the best one; none that leads out of the frame."""
    times = np.linspace(*scene.camera.timing.interval, TIMES)
    kept: list[SpectralPath] = []
    for each in sorted(paths, key=lambda each: each.misfit):
        inside = not beyond(scene.camera, scene.scaled(each.trajectory))
        if inside and _new(each.trajectory, [other.trajectory for other in kept], times):
            kept.append(each)
    return kept


def _new(path: Trajectory, others: list[Trajectory], times: Float[np.ndarray, " n"]) -> bool:
    """Whether a path differs from all others and from their mirror images."""
    return all(min(apart(path, other, times, sign) for sign in (1, -1)) > APART for other in others)


def apart(one: Trajectory, other: Trajectory, times: Float[np.ndarray, " n"], sign: float = 1.0) -> float:
    """px, RMS over the times, between a path and `sign` times another, their mean difference left out."""
    difference = (one.at(times) - sign * other.at(times))[:, :2]
    return float(np.sqrt(((difference - difference.mean(axis=0)) ** 2).sum(axis=1).mean()))


def mirrored(path: Trajectory) -> Trajectory:
    """-p: the same lines, run backwards."""
    return path.with_coefficients(-path.coefficients)
