"""How long frames were exposed, by how their blur differs from each other along a path that points between them show.

With the path, the streaks of `restoration.relative_blur` have one unknown a frame: s_k(e) is what the path, and the field beside it, cover
in an exposure e about the frame's middle. For exposures x of a run's middle that change by y a second,

    log p(x, y) = -INDEPENDENT sum_kj m_kj(exp(x + y t_k), exp(x + y t_j)),    m_kj = sum q A^2 log(1 + (r / A)^2) / 2

over pairs of frames that are near each other. What softens all frames alike, as lenses and codecs do, is in none of the ratios. Frames that
are all blurred alike, as of an even pan, tell nothing. Compression shortens exposures as it does streaks, so that p(x, y) is averaged over
p(x - d, y) with what is likely of d.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline
from scipy.special import logsumexp, ndtri

from rsvideo import threads
from rsvideo.physics.camera import lever
from rsvideo.restoration.camera_path import CameraPath
from rsvideo.restoration.clip_motion import Run
from rsvideo.restoration.movement import groups
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.relative_blur import CARRIED_SPREAD, INDEPENDENT, LONG, Ratio, log_power, misfit, near, ratios, shortened
from rsvideo.restoration.resolution import halved_image
from rsvideo.restoration.spectrum import SIDE
from rsvideo.restoration.vibration import exposed

STEP = 1.075  # from one exposure that is tried to the next
APART = -2, -1, 0, 1, 2  # ratios, by each of which two frames' exposures are tried to differ from their mean
ROWS = 9  # of a frame, at which the path is evaluated
_LIKELY = (np.arange(32) + 0.5) / 32  # quantiles of d, over which is averaged


@dataclass(frozen=True, kw_only=True, eq=False)
class Pairs:
    """Pairs of frames, and how far their blur is from differing as exposures would have it."""

    exposures: Float[np.ndarray, " tried"]  # s, of either frame's geometric mean, in equal ratios
    times: Float[np.ndarray, "pairs 2"]  # s, of each frame, from the middle of the run
    misfits: Float[np.ndarray, "pairs tried apart"]  # where the first frame's is by so many ratios longer, and the second's shorter: APART
    bits: float = math.inf  # `Run.bits`

    def likelihood(self, exposures: Float[np.ndarray, " x"], changes: Float[np.ndarray, " y"]) -> Float[np.ndarray, "x y"]:
        """log p(x, y), but for a constant, of exposures in s and changes of their logarithm in 1/s."""
        if math.isinf(self.bits):
            return self._shown(exposures, changes)
        at, shorter = np.log(self.exposures), shortened(self.bits) * np.exp(CARRIED_SPREAD * ndtri(_LIKELY))
        shown = CubicSpline(at, self._shown(self.exposures, changes))
        each = shown(np.clip(np.log(exposures) - shorter[:, None], at[0], at[-1]))
        return logsumexp(each, axis=0) - math.log(len(shorter))

    def _shown(self, exposures: Float[np.ndarray, " x"], changes: Float[np.ndarray, " y"]) -> Float[np.ndarray, "x y"]:
        """The same of exposures as compressed frames show them."""
        at, wanted = np.log(self.exposures), np.log(exposures)[:, None]
        out = np.zeros((len(exposures), len(changes)))
        for (one, other), misfits in zip(self.times, self.misfits, strict=True):
            tried = np.clip(wanted + changes * (one + other) / 2, at[0], at[-1])
            steps = np.clip(changes * (one - other) / (2 * (at[1] - at[0])), APART[0], APART[-1])
            between = np.maximum(0, 1 - np.abs(steps[:, None] - APART))  # linear interpolation
            out -= (CubicSpline(at, misfits)(tried) * between).sum(axis=-1)
        return INDEPENDENT * out


def compared(
    run: Run, path: CameraPath, flows: Callable[[], Sequence[Flow | None]], frames: Sequence[int], exposures: tuple[float, float]
) -> Pairs:
    """How some `frames` of a run differ in their blur from those near them, for exposures between two, s.

    `flows` finds the fields beside the path, and is called only where a pair was not compared before.
    """
    shortest, longest = exposures
    tried = np.geomspace(shortest, longest, 1 + round(np.log(longest / shortest) / np.log(STEP)))
    wanted = [pair for pair in near(groups(run.tied)) if not set(pair).isdisjoint(frames)]
    if missing := [pair for pair in wanted if pair not in run.compared]:
        run.compared.update(_misfits(run, path, flows(), missing, tried))
    held = [pair for pair in wanted if len(run.compared[pair])]
    times = run.begins[np.array(held, int).reshape(-1, 2)] - 0.5 * (run.begins[0] + run.begins[-1])
    misfits = np.array([run.compared[pair] for pair in held]).reshape(-1, len(tried), len(APART))
    return Pairs(exposures=tried, times=times, misfits=misfits, bits=run.bits)


def _misfits(
    run: Run, path: CameraPath, flows: Sequence[Flow | None], pairs: Sequence[tuple[int, int]], exposures: Float[np.ndarray, " tried"]
) -> dict[tuple[int, int], Float[np.ndarray, "_ apart"]]:
    """m of each pair, for the exposures' geometric mean, and how many ratios they are APART; of none without a ratio.

    Frames are halved until half of the longest exposure leaves a streak that a patch shows.
    """
    ratio = exposures[1] / exposures[0]
    beyond = exposures[0] * ratio ** np.arange(APART[0], len(exposures) + APART[-1])
    taken = sorted({k for pair in pairs for k in pair})
    chords = dict(zip(taken, threads.each(lambda k: _chords(run, path, k, beyond), taken), strict=True))
    images = [frame.pixels[..., 0] for frame in run.small]
    scale = len(images[0]) / run.camera.timing.rows
    reach = max(float(np.linalg.norm(chord[-1, :, :2], axis=-1).max()) for chord in chords.values()) / 2
    while scale * reach > LONG and min(images[0].shape) // 2 >= SIDE:
        images, scale = [halved_image(image) for image in images], scale / 2

    def shown(one: Ratio) -> Float[np.ndarray, "shown apart"]:
        first, second = (
            log_power((scale * _streaks(run, chords[k], flows[k], (places + 0.5) / scale - 0.5, beyond)).astype(np.float32))
            for k, places in zip(one.frames, one.places, strict=True)
        )
        middle, count = APART[-1], len(exposures)
        left = [first[middle + k :][:count] - second[middle - k :][:count] for k in APART]
        return np.stack([misfit(each - one.difference, one.counted).sum(axis=(1, 2)) for each in left], axis=-1)

    found = ratios(images, scale, run.displaced, pairs) if min(images[0].shape) >= SIDE else []
    misfits = zip([one.frames for one in found], threads.each(shown, found), strict=True)
    return dict.fromkeys(pairs, np.zeros((0, len(APART)))) | dict(misfits)


def _chords(run: Run, path: CameraPath, k: int, exposures: Float[np.ndarray, " tried"]) -> Float[np.ndarray, "tried rows axes"]:
    """How far the path leads in each exposure of frame k about its middle, at rows from the first to the last."""
    timing = run.camera.timing
    middles = run.begins[k] + timing.exposure / 2 + timing.row_time * np.linspace(0, timing.rows - 1, ROWS)

    def chord(exposure: float) -> Float[np.ndarray, "rows axes"]:
        opens, closes = exposed(path.spline, timing.exposure, exposure).at(middles + np.array([[-0.5], [0.5]]) * exposure)
        return closes - opens

    return np.array([chord(float(exposure)) for exposure in exposures])


def _streaks(
    run: Run,
    chords: Float[np.ndarray, "tried rows axes"],
    flow: Flow | None,
    places: Float[np.ndarray, "parts 2"],
    exposures: Float[np.ndarray, " tried"],
) -> Float[np.ndarray, "tried parts 2"]:
    """What exposures leave at places (column, row) of a frame, px."""
    x, y = places.T
    at = (ROWS - 1) * np.clip(y / (run.camera.timing.rows - 1), 0, 1)
    row = np.minimum(at.astype(int), ROWS - 2)
    share = (at - row)[:, None]
    pose = (1 - share) * chords[:, row] + share * chords[:, row + 1]
    streaks = np.einsum("pij,epj->epi", lever(run.camera.intrinsics, x, y, pose.shape[-1]), pose)
    return streaks if flow is None else streaks - exposures[:, None, None] * flow.at(places)
