"""One continuous path of a camera through a run of frames, from the points that move between them.

A point tracked from one frame to the next observes the mean pose over one scanline's exposure against that over another's,
each at its own time: linear in the path's coefficients. What the scene's depth adds to that is smooth over the picture and alike from
pair to pair. As a path it would be a wobble that repeats in every frame and grows towards both ends of the run. So each pair has a
quadratic field of its own beside the path. The fields' mean and spread over all pairs are estimated too (expectation maximisation).
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.ndimage import median_filter

from rsvideo.physics.camera import Camera, lever
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Spline, Trajectory, centred, still
from rsvideo.restoration.hand_shake import pose_unit, shake_spread
from rsvideo.restoration.tracks import Tracks

KNOTS = 3  # spline pieces a frame's interval; origin: by trial
TERMS = 7  # of the polynomial that stands for the spline within one frame; origin: by trial
INDEPENDENT = 20  # points of a pair that count; the others share their errors, which blur causes; origin: by trial
STIFFNESS = 1.0  # of the prior on a hand's motion: as believed
ROUNDS = 10  # of reweighting
FIELD_REACH = 4.0  # px at the picture's longer sides, the first spread of the fields; one that starts too small stays so
LEAST_FIELD = 0.01  # px
NODES = 33  # rows at which the basis is averaged; others by linear interpolation
SAMPLES = 8  # of a row's exposure, over which the basis is averaged
FIRST_REACH = 8.0  # px a frame's interval, by which the camera is believed to move before tracks are used; origin: by trial
FIRST_SHARE = 0.25  # of how far points move from frame to frame, which it is at least; else a fast pan is taken for outliers
LEAST_REACH = 4.0  # px a frame's interval, the least that the prior believes after that; origin: by trial
NEIGHBOURS = 5  # pieces, half a frame's interval apart, whose median speed one piece is believed to have
OUTLIER = 2.0  # times the typical residual, at which a point counts half (Cauchy's weights)
END_ERROR = 3.0  # times what H says of the deviation at a run's ends: where a shake begins or stops within one, no prior expects it
FIELDS = 9  # vector fields that are quadratic in the place, but for shifts and roll, which are the camera's
FREE = 1e-6  # precision of every coefficient, in 1 / px^2: a spread of 1000 px, so that where the path begins is free
_FIT_POINTS = 4  # for each coefficient of a frame's polynomial, at which it is fitted to the spline; origin: by trial
_SPEED_POINTS = 9  # of the window in which a path's speed is measured; origin: by trial
_ROUNDING = 1e-9  # s, and rows: keeps the last of a range inside it


@dataclass(frozen=True, kw_only=True, eq=False)
class CameraPath:
    """A path in px and rad over a run of frames, and how precise it is."""

    spline: Spline  # seconds of the clip
    precision: Float[np.ndarray, "unknowns unknowns"]  # H, of the coefficients, row by row


def windows(path: Spline, begins: float, timing: ShutterTiming, terms: int = TERMS) -> Float[np.ndarray, "terms coefficients"]:
    """M: the spline's coefficients to those of the polynomial nearest to it over the frame that begins at `begins`."""
    t = np.linspace(*timing.interval, _FIT_POINTS * terms)
    basis = polynomial(timing, 2, terms).basis(t)
    return np.linalg.lstsq(basis, path.basis(t + begins), rcond=None)[0]


def within(path: Spline, begins: float, timing: ShutterTiming) -> Trajectory:
    """The path within the frame that begins at `begins`, from its pose at the middle of the frame's interval."""
    poly = polynomial(timing, path.coefficients.shape[1]).with_coefficients(windows(path, begins, timing) @ path.coefficients)
    return centred(poly, timing.middle)


def polynomial(timing: ShutterTiming, axes: int, terms: int = TERMS) -> Polynomial:
    """What stands for the spline within one frame, at rest."""
    return still(timing.interval, degree=terms - 1, axes=axes)


def blank(begins: Float[np.ndarray, " frames"], timing: ShutterTiming, axes: int) -> Spline:
    """The spline over all frames, at rest."""
    start, end = float(begins[0]), float(begins[-1] + timing.interval[1])
    terms = 3 + max(1, int(np.ceil((end - start) / timing.interval[1] * KNOTS)))
    return Spline(t0=start, t1=end, coefficients=np.zeros((terms, axes)))


def follow(
    tracks: Sequence[Tracks],
    begins: Float[np.ndarray, " frames"],
    camera: Camera,
    axes: int,
    *,
    about: CameraPath | None = None,
    backwards: Sequence[int] = (),
) -> CameraPath:
    """The path that explains the tracks between neighbouring frames, under a prior on a hand's motion or `about` a path.

    Frames whose index is among `backwards` were read from the last scanline to the first.
    """
    timing = camera.timing
    path = about.spline if about else blank(begins, timing, axes)
    pairs = [pair for pair in _pairs(tracks, begins, backwards, camera, path) if len(pair.moved)]
    pieces = _Pieces.of(path, camera)
    moved = float(np.median([np.median(np.linalg.norm(pair.moved, axis=1)) for pair in pairs])) if pairs else 0.0
    first = np.full(len(pieces.begins), max(FIRST_REACH, FIRST_SHARE * moved) * timing.exposure / timing.interval[1])
    prior = about.precision if about else pieces.precision(first)
    mean, precision = path.coefficients.ravel(), prior
    variance = np.full(FIELDS, FIELD_REACH**2)
    common = np.zeros(len(variance))
    fields = [np.zeros(len(variance)) for _ in pairs]
    for _ in range(ROUNDS):
        precision, right = prior.copy(), prior @ mean
        systems = [pair.system(path.coefficients, field, common, variance) for pair, field in zip(pairs, fields, strict=True)]
        for system in systems:
            precision += system.precision
            right += system.right
        path = path.with_coefficients(np.linalg.solve(precision, right).reshape(path.coefficients.shape))
        if systems:
            fields = [common + system.deviation(path.coefficients) for system in systems]
            common = np.mean(fields, axis=0)
            covariance = np.linalg.inv(precision)
            spreads = [(field - common) ** 2 + system.field_variance(covariance) for field, system in zip(fields, systems, strict=True)]
            variance = np.mean(spreads, axis=0) + LEAST_FIELD**2
        if not about:
            prior = pieces.precision(_reaches(path, pieces.begins, timing))
    return CameraPath(spline=path, precision=precision)


def unexplained(
    path: Spline,
    tracks: Sequence[Tracks],
    begins: Float[np.ndarray, " frames"],
    camera: Camera,
    *,
    backwards: Sequence[int] = (),
) -> list[tuple[Float[np.ndarray, "points 2"], Float[np.ndarray, " points"]]]:
    """How far the points of each pair of neighbouring frames move beyond what the path explains, px, and in what time, s."""
    pairs = _pairs(tracks, begins, backwards, camera, path)
    return [(-pair.residual(path.coefficients), pair.elapsed) for pair in pairs]


def certainties(
    path: CameraPath, begins: Float[np.ndarray, " frames"], tied: Sequence[bool], timing: ShutterTiming
) -> Float[np.ndarray, " frames"]:
    """How surely each frame's scanlines are displaced as the path says: 0 to 1, |d|^2 / (|d|^2 + var d) over the scanlines.

    d is a scanline's mean displacement from the middle of the frame's interval. To follow it by this share has the least expected
    error, of all shares, if d without the tracks is as likely to be the opposite (the Wiener filter). `tied` says of each frame whether
    points were followed to the next one.
    """
    axes = path.spline.coefficients.shape[1]
    covariance = np.linalg.inv(path.precision)
    rows = np.linspace(0, timing.rows - 1, NODES)[:, None] * timing.row_time + timing.sample_times(SAMPLES)[0]
    shares = []
    for begin, before, after in zip(begins, [False, *tied], tied, strict=False):
        basis = path.spline.basis(begin + rows).mean(axis=1) - path.spline.basis(begin + np.array([timing.middle]))
        power = float(((basis @ path.spline.coefficients[:, :2]) ** 2).sum())
        scale = 1.0 if before and after else END_ERROR**2
        variance = scale * sum(float((basis @ covariance[a::axes, a::axes] * basis).sum()) for a in range(2))
        shares.append(power / (power + variance))
    return np.array(shares)


def trusted(path: Spline, camera: Camera, *, drift: float, share: float) -> CameraPath:
    """A path that within each frame is right to `drift` px and a `share` of its length there; where it begins is free."""
    timing, pieces = camera.timing, _Pieces.of(path, camera)
    reaches = np.array([exposure_length(path, t, timing) for t in pieces.begins])
    return CameraPath(spline=path, precision=pieces.precision(drift * timing.exposure / timing.interval[1] + share * reaches))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pieces:
    """A path cut into overlapping pieces as long as a frame's interval, and how each of them moves."""

    begins: Float[np.ndarray, " pieces"]
    moves: list[np.ndarray]  # coefficients of the path to those of the polynomial, without the constant
    spread: Float[np.ndarray, "degrees axes"]  # of these, for a path of 1 px an exposure

    @classmethod
    def of(cls, path: Spline, camera: Camera) -> "_Pieces":
        timing = camera.timing
        duration = timing.interval[1]
        last = max(path.t0, path.t1 - duration)  # where the last piece begins; no part of the path is without a prior
        begins = np.linspace(path.t0, last, 1 + int(np.ceil((last - path.t0) / (duration / 2) - _ROUNDING)))
        unit = pose_unit(camera.intrinsics, path.coefficients.shape[1])
        return cls(
            begins=begins,
            moves=[windows(path, t, timing)[1:] for t in begins],
            spread=shake_spread(TERMS - 1, timing)[:, None] * unit,
        )

    def precision(self, reaches: Float[np.ndarray, " pieces"]) -> Float[np.ndarray, "unknowns unknowns"]:
        """Of the path's coefficients, row by row, if each piece moves by `reaches` px an exposure; where it begins is free."""
        axes, unit = self.spread.shape[1], self.spread[0] / self.spread[0, 0]
        out = np.diag(np.tile(FREE / unit**2, self.moves[0].shape[1]))
        for m, reach in zip(self.moves, reaches, strict=True):
            for a in range(axes):
                out[a::axes, a::axes] += STIFFNESS * m.T @ (m / (reach * self.spread[:, a, None]) ** 2)
        return out


def _reaches(path: Spline, begins: Float[np.ndarray, " pieces"], timing: ShutterTiming) -> Float[np.ndarray, " pieces"]:
    """How far each piece is believed to move in one exposure: as far as its neighbours, or a piece at a run's free end would run away."""
    return median_filter(np.array([exposure_length(path, t, timing) for t in begins]), size=NEIGHBOURS, mode="mirror")


def exposure_length(path: Spline, begins: float, timing: ShutterTiming) -> float:
    """The length in px of the path within one exposure, from its mean speed about a frame's middle; not less than 4 px a frame."""
    window = max(timing.exposure, timing.interval[1] / 2)  # the speed of a short exposure alone is noise
    t = begins + timing.middle + window * np.linspace(-0.5, 0.5, _SPEED_POINTS)
    travelled = float(np.linalg.norm(np.diff(path.at(t)[:, :2], axis=0), axis=1).sum())
    return timing.exposure * max(travelled / window, LEAST_REACH / timing.interval[1])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """The points between two frames as linear equations: moved = design @ coefficients."""

    design: Float[np.ndarray, "points terms"]  # of the mean pose at the second sight, less that at the first
    levers: Float[np.ndarray, "points 2 axes"]
    fields: Float[np.ndarray, "points 2 fields"]  # what the scene's depth may add
    elapsed: Float[np.ndarray, " points"]  # s, from the middle of the first sight's exposure to that of the second
    moved: Float[np.ndarray, "points 2"]
    error: float  # px, of a point at best

    @classmethod
    def of(cls, tracks: Tracks, begins: np.ndarray, back: list[bool], camera: Camera, path: Spline) -> "_Pair":
        timing = camera.timing
        nodes = np.linspace(0, timing.rows - 1, NODES)
        times = nodes[:, None] * timing.row_time + timing.sample_times(SAMPLES)[0]
        poses, when = [], []
        for at, turned, points in zip(begins, back, (tracks.before, tracks.after), strict=True):
            open_at = (times[::-1] if turned else times) + at
            basis = path.basis(open_at).mean(axis=1)
            place = np.clip(points[:, 1] / (timing.rows - 1) * (NODES - 1), 0, NODES - 1 - _ROUNDING)
            low, share = place.astype(int), (place % 1)[:, None]
            poses.append((1 - share) * basis[low] + share * basis[low + 1])
            when.append(np.interp(points[:, 1], nodes, open_at.mean(axis=1)))
        middle = 0.5 * (tracks.before + tracks.after)
        return cls(
            design=poses[1] - poses[0],
            levers=lever(camera.intrinsics, middle[:, 0], middle[:, 1], path.coefficients.shape[1]),
            fields=_fields(camera, middle) * float(begins[1] != begins[0]),  # two views of one moment show the same depth
            elapsed=when[1] - when[0],
            moved=tracks.before - tracks.after,  # a camera that moves right moves the image left
            error=tracks.error,
        )

    def residual(self, coefficients: Float[np.ndarray, "terms axes"]) -> Float[np.ndarray, "points 2"]:
        """What a path leaves of how far the camera seems to have moved."""
        return self.moved - np.einsum("nca,nt,ta->nc", self.levers, self.design, coefficients)

    def system(
        self,
        coefficients: Float[np.ndarray, "terms axes"],
        field: Float[np.ndarray, " fields"],
        common: Float[np.ndarray, " fields"],
        variance: Float[np.ndarray, " fields"],
    ) -> "_System":
        """The pair's equations without its field, which lies about the `common` one; points weigh by how well they fit (Cauchy)."""
        size = np.linalg.norm(self.residual(coefficients) - self.fields @ field, axis=1)
        scale = max(float(np.median(size)), self.error)
        weight = 1 / (1 + (size / (OUTLIER * scale)) ** 2) / scale**2
        weight *= min(1.0, INDEPENDENT / len(weight))
        path = np.einsum("nca,nt->ncta", self.levers, self.design).reshape(2 * len(weight), -1)
        beside = self.fields.reshape(len(path), -1)
        moved = self.moved.ravel() - beside @ common
        weighted = beside.T * np.repeat(weight, 2)
        covariance = np.linalg.inv(np.diag(1 / variance) + weighted @ beside)
        across, by_field = weighted @ path, weighted @ moved
        own = path.T * np.repeat(weight, 2)
        return _System(
            precision=own @ path - across.T @ covariance @ across,
            right=own @ moved - across.T @ covariance @ by_field,
            covariance=covariance,
            across=across,
            by_field=by_field,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class _System:
    """Normal equations of a pair in the path's coefficients, its field eliminated (Schur complement)."""

    precision: Float[np.ndarray, "unknowns unknowns"]
    right: Float[np.ndarray, " unknowns"]
    covariance: Float[np.ndarray, "fields fields"]  # of the field, for a given path
    across: Float[np.ndarray, "fields unknowns"]
    by_field: Float[np.ndarray, " fields"]

    def deviation(self, coefficients: Float[np.ndarray, "terms axes"]) -> Float[np.ndarray, " fields"]:
        """Of the likeliest field beside a path from the common one, px."""
        return self.covariance @ (self.by_field - self.across @ coefficients.ravel())

    def field_variance(self, covariance: Float[np.ndarray, "unknowns unknowns"]) -> Float[np.ndarray, " fields"]:
        """How uncertain the field is, if the path has this covariance."""
        by_path = self.covariance @ self.across
        return np.diag(self.covariance) + np.einsum("fu,uv,fv->f", by_path, covariance, by_path, optimize=True)


def _fields(camera: Camera, points: Float[np.ndarray, "points 2"]) -> Float[np.ndarray, "points 2 fields"]:
    """The vector fields at each point; places are from the picture's centre, in halves of its longer side."""
    lens = camera.intrinsics
    x, y = ((points - (lens.cx, lens.cy)) / (max(lens.rows, lens.cols) / 2)).T
    bent, none = [x * x, x * y, y * y], 0 * x
    sideways = [x, x, y, *bent, none, none, none]  # zoom, two kinds of shear, and curvature
    down = [y, -y, x, none, none, none, *bent]
    return np.stack([np.stack(sideways, axis=1), np.stack(down, axis=1)], axis=1)


def _pairs(tracks: Sequence[Tracks], begins: np.ndarray, backwards: Sequence[int], camera: Camera, path: Spline) -> list[_Pair]:
    back = [k in backwards for k in range(len(begins))]
    return [_Pair.of(t, begins[k : k + 2], back[k : k + 2], camera, path) for k, t in enumerate(tracks)]
