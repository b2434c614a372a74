"""How long the frames of a clip were exposed: the spectra and the focus of their blur, against the speed that points between them show.

Points between the frames give the path through them, and what near and moving things do beside it. Blur shows how much of it one
exposure covers: cut to an exposure e about the same middle, the path has the misfit a_k(e) to the power spectra of frame k
(restoration.spectrum), and the same path turned by a right angle the misfit c_k(e). Softness of all directions, as lenses and codecs
leave it, resembles a short blur along both; motion does not. Spectra of a scene whose edges lie in one direction mislead all the same.
The focus does not (restoration.focus): f_k(e), the sparsity of the latent image, has a dip about the true exposure, of the depth
s_k(e) = (f_k(e / a) + f_k(a e)) / 2 - f_k(e). In some frames the path is wrong. So

    m_k = a_k - g c_k - h tanh(s_k / v),    p_k(e) = (1 - w) exp(-b m_k(e)) / sum_e exp(-b m_k(e)) + w / n

is what frame k shows of the n exposures that are tried. Automatic exposure follows the light evenly, so that frame k at t_k has

    log e_k = x + y t_k,    p(x, y) = p(x) p(y) prod_k p_k(exp(x + y t_k)),

with p(y) half at 0 and half in Cauchy's distribution about it: mostly the exposure stays, and where it does not, it may change much.

Lens and codec leave z px of softness in all frames alike. Variances of blurs add, so that the slower a frame moves, by u_k px/s, the
longer it seems to have been exposed: the same with p_k(sqrt(exp(x + y t_k)^2 + (z / u_k)^2)) and p(z) tells which exposures softness
allows. Exposures without it take in how frames' blur differs from each other, too (restoration.relative_exposure), in which softness does
not show, and of which compression leaves less; with a share w of clips in which that misleads.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from rsvideo import threads
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration import sparsity
from rsvideo.restoration.camera_path import CameraPath, within
from rsvideo.restoration.clip_motion import Followed, Run, beside, path_from_tracks, scene_at, votes
from rsvideo.restoration.extent import longest, sampled
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.relative_exposure import compared
from rsvideo.restoration.scene import TILED_COLS, Scene, windowed
from rsvideo.restoration.spectrum import Spectrum, patches
from rsvideo.restoration.trust import BETTER, CHANCE, FULL_VOTE, deviations, run_share
from rsvideo.restoration.verdict import across
from rsvideo.restoration.vibration import exposed

RATIO = 1.25  # from one exposure that is tried to the next
FINER = 12  # steps of equal ratios between these, at which misfits are interpolated
SHORTEST = 1 / 64  # of a frame's period, the shortest one
FRAMES = 16  # with most motion, from whose blur a clip's exposure is measured
FEWEST = 3  # of them
INDEPENDENT = 10.0  # b: numbers in a frame's spectra that are as good as independent; chosen, as the next, on 60 clips
FOCUSED = 0.3  # h: from 0.2 to 0.4 the errors differ little, and the share that is answered by a tenth
SOFTNESS = 0.5  # g: from 0.3 to 1 little differs where blur is plain, the more the longer short blurs appear
ASTRAY = 0.2  # w: of the frames, those that show nothing, and of clips, those in which blur that differs does not; 0.1 does as well
PLAIN = 2.5  # px of blur, which an answer must leave in the middle one of these frames; less may be a lens's or a codec's
SURE = 0.975  # of what is shown: exposures beyond are too long, and where softness is open those below 1 - SURE too short
VAGUE = 0.15  # standard deviation of the exposure's logarithm, from which on it is no answer
LEAST_DEVIATION = 0.05  # the same of any answer: nine on clips of single photographs were off by 0.06, where 0.04 was shown
DEFENDED = 6.0  # px of blur in the middle one of them, from which on focus bears a stated exposure out; wrong ones had 3.6 to 4.8
SHOWS = 2.0  # px of blur, from which on a frame helps to follow automatic exposure, and the better half of a part shows its own
ROUGHLY = 0.4  # VAGUE for a part of a clip whose exposure is assumed
STAYS = 0.5  # of the parts of clips, those in which the exposure does not change; origin: by trial
STEADY = 0.2  # 1 / s, of the exposure's logarithm: the scale of Cauchy's distribution for how fast it changes else; origin: by trial
CHANGES = np.linspace(-1.6, 1.6, 33)  # 1 / s, y; automatic exposure rarely changes a frame's by a factor of 5 in a second
SOFT = np.linspace(0, 6, 13)  # px, z
USUALLY_SOFT = 2.0  # px, p(z) is half of a Gaussian: 15 clips showed 1.0 to 2.2 px, and with 3 px the exposures hardly differ
ABOUT = 0.3  # of the exposure's logarithm: the scale of Cauchy's distribution for how far a part of a clip is from the clip's exposure
FARTHEST = 6.0  # times the exposure that is believed, or one by that, is the last that is tried of a part of a clip: typed slips are of 5
SAME = 1e-3  # relative difference of exposures, up to which both are the same
FAINT = 0.5  # px of blur, below which the focus has no dip
_LEAST_BLUR = 1e-3  # px; a clip that does not move at all divides by this


@dataclass(frozen=True, kw_only=True)
class Exposure:
    """A measured exposure."""

    value: float  # s, in the middle of the frames, as their blur shows it, with softness where that cannot be separated
    deviation: float  # s
    blur: float  # px, of the middle one of the frames
    sharp: float  # s, without softness
    least: float  # s, that softness allows, or blur from before


@dataclass(frozen=True, kw_only=True)
class Unclear:
    """Why blur does not show the exposure, and what it is at most."""

    reason: str
    most: float | None = None  # s; None where blur shows no bound
    least: float = 0.0  # s, that softness allows


@dataclass(frozen=True, kw_only=True, eq=False)
class _Tried:
    """Exposures, and how far the blur of each frame is from them."""

    exposures: Float[np.ndarray, " tried"]  # s, in equal ratios, and FINER of these from one whose blur was compared to the next
    frames: list[int]
    times: Float[np.ndarray, " frames"]  # s, from the middle of the run
    speeds: Float[np.ndarray, " frames"]  # px/s, of the longest streaks
    misfits: Float[np.ndarray, "frames tried"]
    relative: Float[np.ndarray, "#tried #changes"]  # the logarithm of how much likelier each is by how blur differs from frame to frame

    def between(self, shortest: float, longest: float) -> "_Tried":
        """The same of fewer exposures."""
        held = (self.exposures >= shortest) & (self.exposures <= longest)
        return replace(self, exposures=self.exposures[held], misfits=self.misfits[:, held], relative=self.relative[held])

    @cached_property
    def softened(self) -> Float[np.ndarray, "soft tried changes"]:
        """log p(z) and that of all frames, where they are softened by z."""
        usual = -0.5 * (SOFT / USUALLY_SOFT) ** 2
        return np.array([_likelihoods(self, z).sum(axis=0) for z in SOFT]) + usual[:, None, None]


def measured(run: Run, period: float) -> Exposure | Unclear:
    """The exposure of a run's frames, which are `period` seconds apart, up to that period."""
    path = path_from_tracks(run)
    tried = _tried(run, path, _most_moving(run, path)[:FRAMES], period)
    if isinstance(tried, Unclear):
        return tried
    likely = _likelihoods(tried)
    shown, sharp = _shown(likely.sum(axis=0)).sum(axis=1), _without_softness(tried).sum(axis=1)
    value, deviation = _mean(tried, shown)
    least, deviation = _least(tried), max(deviation, _disagreement(likely, np.log(tried.exposures)))
    without, spread = _mean(tried, sharp)
    if plainly := spread <= VAGUE:
        value, deviation = without, spread
    blur = _middle_length(run, path, tried.frames, value)
    surely = value * max(float(np.exp(2 * deviation)), PLAIN / max(blur, _LEAST_BLUR))
    most = min(max(_quantile(tried, shown, SURE), surely), period)
    if deviation > VAGUE:
        return Unclear(reason="its blur does not agree with its motion at one exposure more than at others", most=most, least=least)
    if blur < PLAIN and not plainly:
        return Unclear(reason=f"its motion leaves too little blur, about {blur:.1f} px", most=most, least=least)
    of_blur = value * float(np.hypot(deviation, LEAST_DEVIATION))
    return Exposure(value=value, deviation=of_blur, blur=blur, sharp=float(sharp @ tried.exposures), least=least)


def in_better_focus(run: Run, stated: float, shown: float) -> bool:
    """Whether the frames that move most are in focus along their path with a stated exposure, and more so than with the one that is shown.

    Spectra of a scene mislead where most of its edges lie in one direction, and in all of a clip's frames alike. The focus along short
    blurs misleads, too.
    """
    path = path_from_tracks(run)
    frames = _most_moving(run, path)[:FRAMES]
    if not frames or _middle_length(run, path, frames, stated) < DEFENDED:
        return False

    def focus(exposure: float) -> float:
        taken = run.exposed(np.full(len(run.begins), exposure))
        return deviations(votes(taken, path_from_tracks(taken), frames))

    return focus(stated) > max(CHANCE, focus(shown))


def followed(run: Run) -> Followed:
    """A run some of whose points were followed, in matched blur; with the exposures that its blur shows, where its frames are in better
    focus with these than with what is believed."""
    found = Followed.of(run)
    if run.exposure_shown and run_share(found.votes) == 1:
        return found
    other = of_each(run, np.inf)
    if np.allclose(other.exposures, run.exposures, rtol=SAME, atol=0):
        return found
    shown = Followed.of(other)
    if deviations(shown.votes) <= deviations(found.votes) + BETTER:
        return found
    return replace(found, sharper=shown) if _softened(run, other.exposures) else shown


def _softened(run: Run, exposures: Float[np.ndarray, " frames"]) -> bool:
    """Whether softness explains why blur shows longer exposures than are believed."""
    believed, shown = (float(np.median(each)) for each in (run.exposures, exposures))
    if believed >= shown:
        return False
    path = path_from_tracks(run)
    tried = _tried(run, path, _most_moving(run, path), _period(run))
    return not isinstance(tried, Unclear) and believed >= _least(tried)


def of_each(run: Run, spread: float = ABOUT) -> Run:
    """The same frames, each with its own exposure, as automatic exposure changes it about the one that the run's camera has.

    `spread` is the scale, in its logarithm, by which the run's may differ from the camera's: infinite where that is assumed. Where too
    few frames are blurred, or where they do not agree, each has the camera's. A clip that does not show its exposure, because its path is
    wrong or its readout is, pretends a change of it, too: then all frames of a run have the same, softness included, since they have to
    come into focus first, and one that is shown vaguely is taken one deviation shorter. Others are without softness: too long an exposure
    costs more than one as much too short.
    """
    about, assumed = run.camera.timing.exposure, not np.isfinite(spread)
    if len(run.begins) < FEWEST or not run.followed.any():
        return run
    period, path = _period(run), path_from_tracks(run)
    frames = _most_moving(run, path, -np.inf if assumed else SHOWS)
    tried = _tried(run, path, frames, period)
    if isinstance(tried, Unclear):
        return run
    tried = tried.between(about / FARTHEST, max(about, period * SHORTEST) * FARTHEST)
    prior = -np.log1p((np.log(tried.exposures / about) / spread) ** 2)
    shown = _shown(_likelihoods(tried).sum(axis=0) + prior[:, None])
    seconds, deviation = _mean(tried, shown.sum(axis=1))
    if not assumed:
        sharp = _without_softness(tried, prior)
        if min(deviation, _mean(tried, sharp.sum(axis=1))[1]) > VAGUE:
            return run
        each = _changing(run, float(sharp.sum(axis=1) @ tried.exposures), sharp)
        return replace(run.exposed(each), seeming=_changing(run, seconds, shown))
    if deviation > ROUGHLY:
        return run
    if deviation > VAGUE:
        seconds *= float(np.exp(-deviation))
    better = tried.frames[: max(FEWEST, len(tried.frames) // 2)]
    if _middle_length(run, path, better, seconds) < SHOWS:
        return run
    return run.exposed(np.full(len(run.begins), np.clip(seconds, period * SHORTEST, period)))


def _changing(run: Run, middle: float, shown: Float[np.ndarray, "tried changes"]) -> Float[np.ndarray, " frames"]:
    """The exposure of each frame, s, about that in the middle, with the change that is shown."""
    period, change = _period(run), float(shown.sum(axis=0) @ CHANGES)
    return np.clip(middle * np.exp(change * (run.begins - _middle(run))), period * SHORTEST, period)


def _period(run: Run) -> float:
    """From a frame to the next, s."""
    return float(np.median(np.diff(run.begins)))


def _middle(run: Run) -> float:
    return 0.5 * float(run.begins[0] + run.begins[-1])


def _tried(run: Run, path: CameraPath, frames: Sequence[int], period: float) -> _Tried | Unclear:
    """What the blur of some frames says of exposures up to a period, with misfits between those that are compared interpolated."""
    if len(frames) < FEWEST:
        return Unclear(reason="too few of its frames could be followed from one to the next")
    exposures = period * np.geomspace(SHORTEST, 1, 1 + round(-np.log(SHORTEST) / np.log(RATIO)))
    flows = cache(lambda: beside(run, path))
    if missing := [k for k in frames if k not in run.misfits]:
        fields = flows()
        found = threads.each(lambda k: _misfits(run, path, k, fields[k], exposures), missing)
        run.misfits.update(zip(missing, found, strict=True))
    held = [k for k in frames if len(run.misfits[k])]
    if len(held) < FEWEST:
        return Unclear(reason="too few of its frames have texture to show blur")
    fine = np.geomspace(exposures[0], exposures[-1], 1 + FINER * (len(exposures) - 1))
    between = CubicSpline(np.log(exposures), np.array([run.misfits[k] for k in held]), axis=1)(np.log(fine))
    speeds = np.maximum([_length(run, path, k, period) for k in held], _LEAST_BLUR) / period
    pairs = compared(run, path, flows, held, (exposures[0], exposures[-1]))
    return _Tried(
        exposures=fine,
        frames=held,
        times=run.begins[held] - _middle(run),
        speeds=speeds,
        misfits=between,
        relative=_relative(pairs.likelihood(fine, CHANGES)),
    )


def _relative(likelihood: Float[np.ndarray, "tried changes"]) -> Float[np.ndarray, "tried changes"]:
    """log((1 - w) Q / mean Q + w), with the mean over x and p(y)."""
    each = np.exp(likelihood - likelihood.max())
    return np.log((1 - ASTRAY) * each / (each @ _of_changes()).mean() + ASTRAY)


def _likelihoods(tried: _Tried, z: float = 0.0) -> Float[np.ndarray, "frames tried changes"]:
    """log p_k(sqrt(exp(x + y t_k)^2 + (z / u_k)^2)) of each frame, for the exposures x that were tried and all changes y."""
    each = np.exp(-INDEPENDENT * (tried.misfits - tried.misfits.min(axis=1, keepdims=True)))
    alone = np.log((1 - ASTRAY) * each / each.sum(axis=1, keepdims=True) + ASTRAY / each.shape[1])
    at = np.log(tried.exposures)
    frames = zip(tried.times, z / tried.speeds, alone, strict=True)
    return np.array([np.interp(np.log(np.hypot(np.exp(at[:, None] + CHANGES * t), soft)), at, frame) for t, soft, frame in frames])


def _without_softness(tried: _Tried, prior: Float[np.ndarray, " tried"] | float = 0.0) -> Float[np.ndarray, "tried changes"]:
    """p(x, y) where frames are softened by z, whatever it is, and of how their blur differs; `prior` is log p(x)."""
    return _shown(tried.softened + np.reshape(prior, (-1, 1)) + tried.relative).sum(axis=0)


def _mean(tried: _Tried, shown: Float[np.ndarray, " tried"]) -> tuple[float, float]:
    """The geometric mean of exposures, s, and the standard deviation of their logarithm."""
    logarithms = np.log(tried.exposures)
    mean = float(shown @ logarithms)
    return float(np.exp(mean)), float(np.sqrt(shown @ (logarithms - mean) ** 2))


def _least(tried: _Tried) -> float:
    """The shortest exposure, s, that softness allows. How blur differs does not count, for blur from before differs, too."""
    return _quantile(tried, _shown(tried.softened).sum(axis=(0, 2)), 1 - SURE)


def _quantile(tried: _Tried, shown: Float[np.ndarray, " tried"], share: float) -> float:
    """The exposure, s, below which a share of what is shown lies."""
    return float(tried.exposures[np.searchsorted(np.cumsum(shown), share)])


def _shown(logarithm: Float[np.ndarray, "... tried changes"]) -> Float[np.ndarray, "... tried changes"]:
    """p(x, y), of sum 1, from the frames' own and p(x); that of a change is added."""
    together = logarithm + np.log(_of_changes())
    shown = np.exp(together - together.max())
    return shown / shown.sum()


def _of_changes() -> Float[np.ndarray, " changes"]:
    """p(y)."""
    changing = 1 / (1 + (CHANGES / STEADY) ** 2)
    return (1 - STAYS) * changing / changing.sum() + STAYS * (CHANGES == 0)


def _disagreement(likely: Float[np.ndarray, "frames tried changes"], logarithms: Float[np.ndarray, " tried"]) -> float:
    """The standard error of the mean logarithm by what each frame changes in it (jackknife): frames may be sure, and disagree."""
    together = likely.sum(axis=0)
    without = np.array([_shown(together - frame).sum(axis=1) @ logarithms for frame in likely])
    return float(np.sqrt((len(without) - 1) * without.var()))


def _most_moving(run: Run, path: CameraPath, least: float = -np.inf) -> list[int]:
    """The frames whose points were followed, and that have more than `least` px of blur, those with most of it first."""
    lengths = np.array([_length(run, path, k, run.camera.timing.exposure) for k in range(len(run.begins))])
    followed = np.flatnonzero(run.followed & (lengths > least))
    return followed[np.argsort(-lengths[followed], kind="stable")].tolist()


def _length(run: Run, path: CameraPath, k: int, exposure: float) -> float:
    """Of the blur in px that an exposure leaves in a frame."""
    return longest(run.camera.exposed(float(exposure)), _covered(run, path, k, float(exposure)))


def _covered(run: Run, path: CameraPath, k: int, exposure: float) -> Trajectory:
    """What another exposure of frame k covers of a path that points show."""
    spline = exposed(path.spline, run.camera.timing.exposure, exposure)
    return within(spline, run.opens(k, exposure), run.camera.exposed(exposure).timing)


def _middle_length(run: Run, path: CameraPath, frames: Sequence[int], exposure: float) -> float:
    """Of the blur in px that an exposure leaves in the middle one of some frames."""
    return float(np.median([_length(run, path, k, exposure) for k in frames]))


def _misfits(run: Run, path: CameraPath, k: int, flow: Flow | None, exposures: Float[np.ndarray, " tried"]) -> Float[np.ndarray, " shown"]:
    """m_k of exposures, whose ratio from one to the next is a; of none where the frame has no texture."""
    ratio = float(exposures[1] / exposures[0])
    cuts = [(float(e), _covered(run, path, k, float(e))) for e in (exposures[0] / ratio, *exposures, exposures[-1] * ratio)]
    lengths = np.array([longest(run.camera.exposed(e), cut) for e, cut in cuts[1:-1]])
    scene = scene_at(run, k, flow, lengths[-1] / 2)  # in its patches, blur of half the longest exposure has room
    if not (observed := patches(scene)):
        return np.zeros(0)

    cols = max(run.effort.exposure_pixels // len(scene.frame), TILED_COLS)
    part = replace(windowed(scene, cols), tiles=1) if cols < scene.frame.shape[1] else scene

    def taken(columns: Scene, exposure: float) -> Scene:
        return replace(columns, camera=columns.camera.exposed(exposure))

    def by_spectra(exposure: float, cut: Trajectory) -> float:
        shown = taken(scene, exposure)
        turned = replace(shown, flow=shown.flow and shown.flow.across)
        along, beside_it = (Spectrum(scene=each, patches=observed, curve=cut) for each in (shown, turned))
        return along.value(cut) - SOFTNESS * beside_it.value(across(cut))

    def sparsity_of(exposure: float, cut: Trajectory) -> float:
        shown = taken(part, exposure)
        return sparsity.value(sampled(shown, cut), cut, shown.search_ridge)

    sharp = np.zeros(len(exposures))
    first = int(np.argmax(lengths >= FAINT))
    if lengths[first] >= FAINT:
        sparse = np.array([sparsity_of(*cut) for cut in cuts[first:]])  # from the exposure before
        sharp[first:] = (sparse[:-2] + sparse[2:]) / 2 - sparse[1:-1]
    return np.array([by_spectra(*cut) for cut in cuts[1:-1]]) - FOCUSED * np.tanh(sharp / FULL_VOTE)
