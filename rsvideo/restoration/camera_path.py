"""One continuous path of a camera through a run of frames, from the points that move between them.

The points of a pair of frames are linear in the path's coefficients (restoration.point_equations). What the scene's depth adds to that
is smooth over the picture and alike from pair to pair. As a path it would be a wobble that repeats in every frame and grows towards both
ends of the run. So each pair has a quadratic field of its own beside the path. The fields' mean and spread over all pairs are estimated
too (expectation maximisation).
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import ceil

import numpy as np
from jaxtyping import Float
from scipy.linalg import block_diag
from scipy.ndimage import median_filter

from rsvideo.physics.camera import Camera
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Spline, Trajectory, VibratingSpline, centred, still
from rsvideo.restoration.hand_shake import pose_unit, shake_spread
from rsvideo.restoration.point_equations import FIELDS, NODES, SAMPLES, Pair, pairs_of
from rsvideo.restoration.tracks import Tracks
from rsvideo.restoration.vibration import MOST, Explained, Tone, spreads, strongest, vibrating

KNOTS = 5  # spline pieces a frame's interval; origin: by trial
MOST_KNOTS = 10  # spline pieces a period, where a frame's interval is short against it; origin: by trial, 5 to 10 gain alike
FINEST = 1 / 300  # s from knot to knot at least, however fast frames follow each other: ten a period of 30 frames a second
TERMS = 7  # of the polynomial that stands for the spline within one frame; origin: by trial
STIFFNESS = 1.0  # of the prior on a hand's motion, before tracks are used: as believed
BELIEVED = 4.0  # of the path's unknowns, as many as which that belief counts
JERK = 1.0  # of the typical energy of a piece, at which one counts half (Cauchy's weights); origin: by trial
ROUNDS = 10  # of reweighting
FIELD_REACH = 4.0  # px at the picture's longer sides, the first spread of the fields; one that starts too small stays so
LEAST_FIELD = 0.01  # px
FIRST_REACH = 8.0  # px a frame's interval, by which the camera is believed to move before tracks are used; origin: by trial
FIRST_SHARE = 0.25  # of how far points move from frame to frame, which it is at least; else a fast pan is taken for outliers
LEAST_REACH = 4.0  # px a frame's interval, the least that the prior believes after that; origin: by trial
NEIGHBOURS = 5  # pieces, half a frame's interval apart, whose median speed one piece is believed to have
END_ERROR = 3.0  # times what H says of the deviation at a run's ends: where a shake begins or stops within one, no prior expects it
LEAST_DOUBT, MOST_DOUBTS = 0.03, 8  # px RMS over a frame's interval, below which a displacement is believed, and how many may be in doubt
PATH_ERROR = 0.2  # px of blur by which a path may be wrong even where points bear it out; origin: by trial
FREE = 1e-6  # precision of every coefficient, in 1 / px^2: a spread of 1000 px, so that where the path begins is free
_FIT_POINTS = 4  # for each coefficient of a frame's polynomial, at which it is fitted to the spline; origin: by trial
_SPEED_POINTS = 9  # of the window in which a path's speed is measured; origin: by trial
_ROUNDING = 1e-9  # of a piece, which rounding may add to a whole number of them


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPath:
    """A path in px and rad over a run of frames, and how precise it is."""

    spline: Spline  # seconds of the clip
    precision: Float[np.ndarray, "unknowns unknowns"]  # H, of the coefficients, row by row

    @cached_property
    def covariance(self) -> Float[np.ndarray, "unknowns unknowns"]:
        """Of the coefficients."""
        return np.linalg.inv(self.precision)


def windows(path: Spline, begins: float | Float[np.ndarray, "*n"], timing: ShutterTiming) -> Float[np.ndarray, "*n terms coefficients"]:
    """M: the spline's coefficients to those of the polynomial nearest to it over the frame that begins at each of `begins`."""
    terms = TERMS
    if isinstance(path, VibratingSpline):  # Legendre polynomials above pi times the number of periods hardly show in a tone
        terms += ceil(np.pi * max(path.frequencies) * timing.interval[1])
    t = np.linspace(*timing.interval, _FIT_POINTS * terms)
    return np.linalg.pinv(polynomial(timing, terms, 2).basis(t)) @ path.basis(t + np.asarray(begins)[..., None])


def within(path: Spline, begins: float, timing: ShutterTiming) -> Trajectory:
    """The path within the frame that begins at `begins`, from its pose at the middle of the frame's interval."""
    coefficients = windows(path, begins, timing) @ path.coefficients
    return centred(polynomial(timing, *coefficients.shape).with_coefficients(coefficients), timing.middle)


def polynomial(timing: ShutterTiming, terms: int, axes: int) -> Polynomial:
    """What stands for the spline within one frame, at rest."""
    return still(timing.interval, degree=terms - 1, axes=axes)


def blank(begins: Float[np.ndarray, " frames"], timing: ShutterTiming, axes: int) -> Spline:
    """The spline over all frames, at rest."""
    start, end = float(begins[0]), float(begins[-1] + timing.interval[1])
    period = float(np.median(np.diff(begins))) if len(begins) > 1 else 0.0
    spacing = max(timing.interval[1] / KNOTS, period / MOST_KNOTS, FINEST)
    terms = 3 + max(1, int(np.ceil((end - start) / spacing)))
    return Spline(t0=start, t1=end, coefficients=np.zeros((terms, axes)))


def follow(
    tracks: Sequence[Tracks],
    begins: Float[np.ndarray, " frames"],
    camera: Camera,
    axes: int,
    *,
    about: CameraPath | None = None,
    backwards: Sequence[int] = (),
    toned: bool = True,
) -> CameraPath:
    """The path that explains the tracks between neighbouring frames, under a prior on a hand's motion or `about` a path.

    If it may be `toned`, there are as many tones beside a hand's motion as the tracks ask for. Frames whose index is among `backwards`
    were read from the last scanline to the first.
    """
    path, tones = about.spline if about else blank(begins, camera.timing, axes), list[Tone]()

    def equations(path: Spline) -> list[Pair]:
        return [pair for pair in pairs_of(tracks, begins, backwards, camera, path) if len(pair.moved)]

    while True:
        pairs = equations(path)
        found = _explained(pairs, camera, path, tones, about)
        looking = toned and not about and pairs and len(tones) < MOST
        tone = strongest(pairs, found, begins, equations) if looking else None
        if tone is None:
            return CameraPath(spline=found.path, precision=found.precision)
        tones.append(tone)
        path = vibrating(path.smooth, [tone.frequency for tone in tones])


def _explained(pairs: Sequence[Pair], camera: Camera, path: Spline, tones: Sequence[Tone], about: CameraPath | None) -> Explained:
    """The path, from rest or `about` one, and the fields beside it, that explain the points of pairs of frames."""
    pieces = _Pieces.of(path, camera, tones)
    timing = pieces.timing
    moved = float(np.median([np.median(np.linalg.norm(pair.moved, axis=1)) for pair in pairs])) if pairs else 0.0
    first = np.full(len(pieces.begins), max(FIRST_REACH, FIRST_SHARE * moved) * timing.exposure / timing.interval[1])
    prior = about.precision if about else pieces.precision(first)
    mean = path.coefficients.ravel()
    variance = np.full(FIELDS, FIELD_REACH**2)
    common = np.zeros(len(variance))
    fields = [np.zeros(len(variance)) for _ in pairs]
    out = Explained(path=path, precision=prior, weights=[], common=common, variance=variance)
    for _ in range(ROUNDS):
        precision, right = prior.copy(), prior @ mean
        weights = [pair.weights(path.coefficients, field) for pair, field in zip(pairs, fields, strict=True)]
        systems = [pair.system(weight, common, variance) for pair, weight in zip(pairs, weights, strict=True)]
        for system in systems:
            precision[np.ix_(system.unknowns, system.unknowns)] += system.precision
            right[system.unknowns] += system.right
        path = path.with_coefficients(np.linalg.solve(precision, right).reshape(path.coefficients.shape))
        out = Explained(path=path, precision=precision, weights=weights, common=common, variance=variance)
        covariance = np.linalg.inv(precision)
        if systems:
            fields = [common + system.deviation(path.coefficients) for system in systems]
            common = np.mean(fields, axis=0)
            apart = [(field - common) ** 2 + system.field_variance(covariance) for field, system in zip(fields, systems, strict=True)]
            variance = np.mean(apart, axis=0) + LEAST_FIELD**2
        if not about:
            reaches = _reaches(path.smooth, pieces.begins, timing)
            prior = pieces.precision(reaches, pieces.stiffness(path.smooth.coefficients, covariance, reaches))
    return out


def unexplained(
    path: Spline,
    tracks: Sequence[Tracks],
    begins: Float[np.ndarray, " frames"],
    camera: Camera,
    *,
    backwards: Sequence[int] = (),
) -> list[tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]]:
    """How far the points of each pair of neighbouring frames move beyond what the path explains, px, and in what time, s."""
    pairs = pairs_of(tracks, begins, backwards, camera, path)
    return [(-pair.residual(path.coefficients), pair.elapsed) for pair in pairs]


def certainties(
    path: CameraPath, begins: Float[np.ndarray, " frames"], tied: Sequence[bool], timing: ShutterTiming
) -> Float[np.ndarray, " frames"]:
    """How surely each frame's scanlines are displaced as the path says: 0 to 1, |d|^2 / (|d|^2 + var d) over the scanlines.

    d is a scanline's mean displacement from the middle of the frame's interval. To follow it by this share has the least expected
    error, of all shares, if d without the tracks is as likely to be the opposite (the Wiener filter). `tied` says of each frame whether
    points were followed to the next one.
    """
    opened, shares = _opened(timing), []
    for begin, before, after in zip(begins, [False, *tied], tied, strict=False):
        places = path.spline.basis(begin + opened).mean(axis=1) - path.spline.basis(begin + np.array([timing.middle]))
        shares.append(_certainty(path, places, 1.0 if before and after else END_ERROR))
    return np.array(shares)


def blur_certainties(path: CameraPath, begins: Float[np.ndarray, " frames"], timing: ShutterTiming) -> Float[np.ndarray, " frames"]:
    """The same of blur: how surely each frame is blurred as the path says, with the displacements from the mean of a scanline's exposure
    for d, over all instants of its exposure."""
    opened, shares = _opened(timing), []
    for begin in begins:
        places = path.spline.basis(begin + opened)
        apart = places - places.mean(axis=1, keepdims=True)
        shares.append(_certainty(path, apart.reshape(-1, apart.shape[-1])))
    return np.array(shares)


@dataclass(frozen=True, kw_only=True, eq=False)
class Doubts:
    """How a path may be wrong within a frame: the principal displacements of its polynomial, each a standard deviation long."""

    moves: Float[np.ndarray, "doubts terms axes"]  # the longest first
    of_path: Float[np.ndarray, "doubts unknowns"]  # G: how many of each a change of the spline's coefficients makes
    shear: Float[np.ndarray, "doubts 2"]  # Z: how many of each displace the last scanline by 1 px, in x or in y, against the first


def doubts(path: CameraPath, begins: float, timing: ShutterTiming) -> Doubts:
    """Those of the frame that begins at `begins`, in px. Roll is believed, and where the frame begins."""
    inside = windows(path.spline, begins, timing)[1:]
    terms, axes = len(inside), path.spline.coefficients.shape[1]
    both = np.kron(inside, np.eye(axes)[:2])  # x and y of each term
    variances, directions = np.linalg.eigh(both @ path.covariance @ both.T)
    longest = np.arange(len(variances))[: -MOST_DOUBTS - 1 : -1]
    found = longest[variances[longest] > LEAST_DOUBT**2]
    directions, deviations = directions[:, found], np.sqrt(variances[found])
    moves = np.zeros((len(found), terms + 1, axes))
    moves[:, 1:, :2] = (deviations * directions).T.reshape(-1, terms, 2)
    first, last = polynomial(timing, terms + 1, 2).basis(timing.sample_times(SAMPLES)[[0, -1]]).mean(axis=1)
    slope = last[1] - first[1]  # of the polynomial's linear term
    return Doubts(
        moves=moves,
        of_path=(directions / deviations).T @ both,
        shear=(directions[:2] / deviations).T / slope if slope > 0 else np.zeros((len(found), 2)),
    )


def _opened(timing: ShutterTiming) -> Float[np.ndarray, "rows samples"]:
    """Instants at which some scanlines of a frame are open, s."""
    return np.linspace(0, timing.rows - 1, NODES)[:, None] * timing.row_time + timing.sample_times(SAMPLES)[0]


def _certainty(path: CameraPath, places: Float[np.ndarray, "places terms"], error: float = 1.0) -> float:
    """|d|^2 / (|d|^2 + var d) of d = places @ coefficients, whose deviation is `error` times what the covariance says."""
    axes = path.spline.coefficients.shape[1]
    power = float(((places @ path.spline.coefficients[:, :2]) ** 2).sum())
    variance = error**2 * sum(float((places @ path.covariance[a::axes, a::axes] * places).sum()) for a in range(2))
    return power / (power + variance)


def trusted(path: Spline, camera: Camera, *, drift: float, share: float) -> CameraPath:
    """A path that within each frame is right to `drift` px and a `share` of its length there; where it begins is free."""
    pieces = _Pieces.of(path, camera)
    timing = pieces.timing
    reaches = exposure_lengths(path, pieces.begins, timing)
    return CameraPath(spline=path, precision=pieces.precision(drift * timing.exposure / timing.interval[1] + share * reaches))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pieces:
    """A path cut into overlapping pieces as long as a frame's interval, or as KNOTS of its own, and how each of them moves."""

    timing: ShutterTiming  # of a frame whose interval is as long as a piece
    begins: Float[np.ndarray, " pieces"]
    moves: Float[np.ndarray, "pieces degrees terms"]  # coefficients of the smooth path to those of the polynomial, without the constant
    spread: Float[np.ndarray, "degrees axes"]  # of these, for a path of 1 px an exposure
    beside: Float[np.ndarray, "tones axes"]  # precision of the tones' coefficients

    @classmethod
    def of(cls, path: Spline, camera: Camera, tones: Sequence[Tone] = ()) -> "_Pieces":
        timing = camera.timing.lasting(KNOTS * path.smooth.spacing)
        duration = timing.interval[1]
        last = max(path.t0, path.t1 - duration)  # where the last piece begins; no part of the path is without a prior
        begins = np.linspace(path.t0, last, 1 + int(np.ceil((last - path.t0) / (duration / 2) - _ROUNDING)))
        unit = pose_unit(camera.intrinsics, path.coefficients.shape[1])
        return cls(
            timing=timing,
            begins=begins,
            moves=windows(path.smooth, begins, timing)[:, 1:],
            spread=shake_spread(TERMS - 1, timing)[:, None] * unit,
            beside=1 / (spreads(tones, path) * unit) ** 2,
        )

    def precision(
        self, reaches: Float[np.ndarray, " pieces"], stiffness: Float[np.ndarray, " pieces"] | None = None
    ) -> Float[np.ndarray, "unknowns unknowns"]:
        """Of the path's coefficients, row by row, if each piece moves by `reaches` px an exposure; where it begins is free."""
        unit = self.spread[0] / self.spread[0, 0]
        stiffness = np.full(len(reaches), STIFFNESS) if stiffness is None else stiffness
        smooth = np.diag(np.tile(FREE / unit**2, self.moves.shape[2])) + self._smoothness(reaches, stiffness)
        return np.asarray(block_diag(smooth, np.diag(self.beside.ravel())))

    def _smoothness(
        self, reaches: Float[np.ndarray, " pieces"], stiffness: Float[np.ndarray, " pieces"]
    ) -> Float[np.ndarray, "unknowns unknowns"]:
        """What the prior adds to the precision of the smooth path's coefficients, row by row."""
        axes, terms = self.spread.shape[1], self.moves.shape[2]
        added = np.zeros((terms, axes, terms, axes))
        moves, expected = self.moves.reshape(-1, terms), reaches[:, None, None] * self.spread
        for a, weight in enumerate(np.moveaxis(stiffness[:, None, None] / expected**2, 2, 0)):
            added[:, a, :, a] = (moves * weight.reshape(-1, 1)).T @ moves
        return added.reshape(terms * axes, terms * axes)

    def stiffness(
        self,
        path: Float[np.ndarray, "terms axes"],
        covariance: Float[np.ndarray, "unknowns unknowns"],
        reaches: Float[np.ndarray, " pieces"],
    ) -> Float[np.ndarray, " pieces"]:
        """How stiff the prior on each piece of a path is, that has this covariance.

        A hand jerks now and then: a piece of more energy than others counts less. What all pieces are believed to have together is what
        the path shows (expectation maximisation, with the belief before it as BELIEVED unknowns more).
        """
        energies = ((self.moves @ path / (reaches[:, None, None] * self.spread)) ** 2).sum(axis=(1, 2))
        weights = 1 / (1 + energies / (JERK * max(float(np.median(energies)), _ROUNDING)))
        believed = self._smoothness(reaches, weights)
        shown = path.ravel() @ believed @ path.ravel() + np.sum(believed * covariance[: path.size, : path.size])
        return weights * (path.size - path.shape[1] + BELIEVED) / (shown + BELIEVED / STIFFNESS)


def _reaches(path: Spline, begins: Float[np.ndarray, " pieces"], timing: ShutterTiming) -> Float[np.ndarray, " pieces"]:
    """How far each piece is believed to move in one exposure: as far as its neighbours, or a piece at a run's free end would run away."""
    return median_filter(exposure_lengths(path, begins, timing), size=NEIGHBOURS, mode="mirror")


def exposure_lengths(path: Spline, begins: Float[np.ndarray, " n"], timing: ShutterTiming) -> Float[np.ndarray, " n"]:
    """The lengths in px of the path within one exposure each, from its mean speed about the middles of frames that begin so; not less
    than 4 px a frame."""
    window = max(timing.exposure, timing.interval[1] / 2)  # the speed of a short exposure alone is noise
    t = (begins + timing.middle)[:, None] + window * np.linspace(-0.5, 0.5, _SPEED_POINTS)
    travelled = np.linalg.norm(np.diff(path.at(t)[..., :2], axis=1), axis=2).sum(axis=1)
    return timing.exposure * np.maximum(travelled / window, LEAST_REACH / timing.interval[1])
