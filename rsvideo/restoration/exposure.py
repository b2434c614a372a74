"""How long the frames of a clip were exposed: the spectra of their blur, against the speed that points between them show.

Points between the frames give the path through them, and what near and moving things do beside it. Blur shows how much of it one
exposure covers: cut to an exposure e about the same middle, the path has the misfit a_k(e) to the power spectra of frame k
(restoration.spectrum), and the same path turned by a right angle the misfit c_k(e). Softness of all directions, as lenses and codecs
leave it, resembles a short blur along both; motion does not. In some frames the path is wrong. So

    m_k = a_k - g c_k,    p_k(e) = (1 - w) exp(-b m_k(e)) / sum_e exp(-b m_k(e)) + w / n

is what frame k shows of the n exposures that are tried, and the product over the frames what the clip shows. Spectra are integrated over
latent images, so that long exposures are not preferred to short ones, as they are by the sparsity of latent images.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from rsvideo import threads
from rsvideo.restoration.camera_path import CameraPath, within
from rsvideo.restoration.clip_motion import Run, beside, path_from_tracks, scene_at
from rsvideo.restoration.extent import longest
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scene import Scene
from rsvideo.restoration.spectrum import Patches, patches
from rsvideo.restoration.trust import misfits

RATIO = 1.12  # from one exposure that is tried to the next
SHORTEST = 1 / 64  # of a frame's period, the shortest one
FRAMES = 16  # with most motion, from whose blur the exposure is measured
FEWEST = 3  # of them
INDEPENDENT = 20.0  # b: numbers in a frame's spectra that are as good as independent; 15 to 60 differ little
SOFTNESS = 0.5  # g: from 0.3 to 1 little differs where blur is plain, the more the longer short blurs appear
ASTRAY = 0.2  # w: of the frames, those that show nothing
PLAIN = 2.5  # px of blur, which an answer must leave in the middle one of these frames; less may be a lens's or a codec's
SURE = 0.975  # of what is shown: exposures beyond are too long
VAGUE = 0.15  # standard deviation of the exposure's logarithm, from which on it is no answer
_LEAST_BLUR = 1e-3  # px; a clip that does not move at all divides by this


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """A measured exposure."""

    value: float  # s
    deviation: float  # s
    blur: float  # px, of the middle one of the frames


@dataclass(frozen=True, kw_only=True)
class Unclear:
    """Why blur does not show the exposure, and what it is at most."""

    reason: str
    most: float | None = None  # s; None where blur shows no bound


def measured(run: Run, period: float) -> Exposure | Unclear:
    """The exposure of a run's frames, which are `period` seconds apart, up to that period."""
    path = path_from_tracks(run)
    frames = _most_moving(run, path)
    if len(frames) < FEWEST:
        return Unclear(reason="too few of its frames could be followed from one to the next")
    tried = period * np.geomspace(SHORTEST, 1, 1 + round(np.log(1 / SHORTEST) / np.log(RATIO)))
    flows = beside(run, path)
    scenes = [_scene(run, path, k, flows[k], period) for k in frames]
    textured = [(k, scene, found) for k, scene in zip(frames, scenes, strict=True) if (found := patches(scene))]
    if len(textured) < FEWEST:
        return Unclear(reason="too few of its frames have texture to show blur")
    missed = np.array(threads.each(lambda each: [_misfit(run, path, *each, e) for e in tried], textured))
    shown = _shown(missed)
    mean = float(shown @ np.log(tried))
    value = float(np.exp(mean))
    deviation = max(float(np.sqrt(shown @ (np.log(tried) - mean) ** 2)), _disagreement(missed, np.log(tried)))
    blur = float(np.median([_length(run, path, k, value) for k, _, _ in textured]))
    surely = value * max(float(np.exp(2 * deviation)), PLAIN / max(blur, _LEAST_BLUR))
    most = max(float(tried[np.searchsorted(np.cumsum(shown), SURE)]), surely)
    if deviation > VAGUE:
        return Unclear(reason="its blur does not agree with its motion at one exposure more than at others", most=min(most, period))
    if blur < PLAIN:
        return Unclear(reason=f"its motion leaves too little blur, about {blur:.1f} px", most=min(most, period))
    return Exposure(value=value, deviation=value * float(np.hypot(deviation, np.log(RATIO) / np.sqrt(12))), blur=blur)


def _shown(misfits: Float[np.ndarray, "frames tried"]) -> Float[np.ndarray, " tried"]:
    """What the frames together show of each exposure; of sum 1."""
    each = np.exp(-INDEPENDENT * (misfits - misfits.min(axis=1, keepdims=True)))
    together = np.log((1 - ASTRAY) * each / each.sum(axis=1, keepdims=True) + ASTRAY / misfits.shape[1]).sum(axis=0)
    shown = np.exp(together - together.max())
    return shown / shown.sum()


def _disagreement(misfits: Float[np.ndarray, "frames tried"], logarithms: Float[np.ndarray, " tried"]) -> float:
    """The standard error of the mean logarithm by what each frame changes in it (jackknife): frames may be sure, and disagree."""
    without = np.array([_shown(np.delete(misfits, k, axis=0)) @ logarithms for k in range(len(misfits))])
    return float(np.sqrt((len(without) - 1) * without.var()))


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


def _scene(run: Run, path: CameraPath, k: int, flow: Flow | None, period: float) -> Scene:
    """The scene of frame k, in whose patches blur of half the longest exposure has room."""
    return scene_at(run, k, flow, _length(run, path, k, period) / 2)


def _misfit(run: Run, path: CameraPath, k: int, scene: Scene, observed: Patches, exposure: float) -> float:
    """m_k(e)."""
    cut = within(path.spline, _begins(run, k, exposure), replace(run.camera.timing, exposure=float(exposure)))
    scene = replace(scene, camera=replace(scene.camera, timing=replace(scene.camera.timing, exposure=float(exposure))))
    along, turned = misfits(scene, observed, cut)
    return along - SOFTNESS * turned
