"""How long the frames of a clip were exposed: the extent of their blur, against the speed that points between them show.

Points between the frames give the path C through them, and what near and moving things do beside it. Blur shows how much of it one
exposure covers. With the path cut to exposures of length e about the same middles, f_k(C, e), the sparsity of frame k's latent image
(restoration.sparsity), rises with e whatever the truth is, for latent images lose edges to any blur; at the true exposure, and only
there, it has a dip:

    s_k(e) = (f_k(C, e / a) + f_k(C, a e)) / 2 - f_k(C, e)

is largest at the true e in the mean over frames, as a lens's focus is found from a series of pictures.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rsvideo.restoration.camera_path import CameraPath, within
from rsvideo.restoration.clip_motion import Run, evidence, flowing, path_from_tracks
from rsvideo.restoration.extent import longest
from rsvideo.restoration.scene import Scene, reduced
from rsvideo.restoration.sparsity import value

RATIO = 1.12  # from one exposure that is tried to the next
ACROSS_DIP = 2  # such ratios are a: 1.25, about how wide the dip is
SHORTEST = 1 / 16  # of a frame's period, the shortest exposure that is answered: blur of shorter ones is hardly ever visible
FRAMES = 8  # with most motion, from whose blur the exposure is measured
FEWEST = 3  # of them
LEAST_BLUR = 1.0  # px in the middle one of these frames; exposures that leave less are not tried, as no dip can show
PLAIN = 3.0  # px of blur, which an answer must leave in the middle one of these frames; a shorter one's dip is uncertain
CERTAIN = 3.0  # standard errors of the mean over frames, which the dip must exceed; origin: by trial
ALONE = 2.5  # times the next dip, which it must exceed; origin: by trial
RESAMPLED = 200  # times that the frames are drawn anew, for the deviation (bootstrap)


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """A measured exposure."""

    value: float  # s
    deviation: float  # s
    blur: float  # px, of the middle one of the frames


@dataclass(frozen=True, kw_only=True)
class Unclear:
    """Why blur does not show the exposure."""

    reason: str


def measured(run: Run, period: float) -> Exposure | Unclear:
    """The exposure of a run's frames, which are `period` seconds apart, up to that period."""
    path = path_from_tracks(run)
    frames = _most_moving(run, path)
    if len(frames) < FEWEST:
        return Unclear(reason="too few of its frames could be followed from one to the next")
    steps = round(np.log(1 / SHORTEST) / np.log(RATIO)) + 2 * ACROSS_DIP
    tried = period * RATIO ** np.arange(ACROSS_DIP - steps, ACROSS_DIP + 1)
    blur = np.array([np.median([_length(run, path, k, e) for k in frames]) for e in tried])
    tried, blur = tried[blur >= LEAST_BLUR], blur[blur >= LEAST_BLUR]
    if len(tried) <= 2 * ACROSS_DIP:
        return Unclear(reason="its motion leaves too little blur")
    beside = evidence(run, path, share=0.0)
    scenes = [reduced(flowing(run, k, beside[k].flow)) for k in frames]
    dips = _dips(np.array([[_cost(run, path, k, scene, e) for e in tried] for k, scene in zip(frames, scenes, strict=True)]))
    inner = tried[ACROSS_DIP:-ACROSS_DIP]
    mean = dips.mean(axis=0)
    best = int(np.argmax(mean))
    error = float(dips[:, best].std(ddof=1)) / np.sqrt(len(frames))
    others = np.abs(np.arange(len(inner)) - best) > ACROSS_DIP + 1
    if mean[best] < CERTAIN * error or (others.any() and mean[best] < ALONE * mean[others].max()):
        return Unclear(reason="its blur does not agree with its motion at one exposure more than at others")
    found = _highest(inner, mean)
    length = float(np.interp(found, tried, blur))
    if length < PLAIN:
        return Unclear(reason=f"its motion leaves too little blur, about {length:.1f} px")
    rng = np.random.default_rng(0)
    drawn = [_highest(inner, dips[rng.integers(0, len(frames), len(frames))].mean(axis=0)) for _ in range(RESAMPLED)]
    return Exposure(value=found, deviation=float(np.std(drawn)), blur=length)


def _most_moving(run: Run, path: CameraPath) -> list[int]:
    lengths = np.array([_length(run, path, k, run.camera.timing.exposure) for k in range(len(run.begins))])
    followed = np.flatnonzero(run.followed)
    return sorted(followed[np.argsort(-lengths[followed], kind="stable")[:FRAMES]].tolist())


def _length(run: Run, path: CameraPath, k: int, exposure: float) -> float:
    """Of the blur in px that an exposure leaves in a frame."""
    timing = replace(run.camera.timing, exposure=float(exposure))
    return longest(replace(run.camera, timing=timing), within(path.spline, _begins(run, k, exposure), timing))


def _begins(run: Run, k: int, exposure: float) -> float:
    """When the first scanline opens, if exposures of that length keep the middles that the run's have."""
    return float(run.begins[k]) + (run.camera.timing.exposure - float(exposure)) / 2


def _cost(run: Run, path: CameraPath, k: int, scene: Scene, exposure: float) -> float:
    """f of frame k, of which `scene` is taken, for an exposure."""
    cut = within(path.spline, _begins(run, k, exposure), replace(run.camera.timing, exposure=float(exposure)))
    camera = replace(scene.camera, timing=replace(scene.camera.timing, exposure=float(exposure)))
    scene = replace(scene, camera=camera)
    return value(scene, cut, scene.search_ridge)


def _dips(costs: Float[np.ndarray, "frames tried"]) -> Float[np.ndarray, "frames inner"]:
    """s_k(e), at all exposures but the outermost."""
    return (costs[:, : -2 * ACROSS_DIP] + costs[:, 2 * ACROSS_DIP :]) / 2 - costs[:, ACROSS_DIP:-ACROSS_DIP]


def _highest(inner: Float[np.ndarray, " inner"], dip: Float[np.ndarray, " inner"]) -> float:
    """Where a parabola through the largest dip and its neighbours, over the exposure's logarithm, is highest."""
    k = int(np.argmax(dip))
    if k in (0, len(dip) - 1):
        return float(inner[k])
    left, middle, right = dip[k - 1 : k + 2]
    return float(inner[k] * RATIO ** (0.5 * (left - right) / (left - 2 * middle + right)))
