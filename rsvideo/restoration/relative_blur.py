"""How frames of one scene are blurred, by how they differ from each other.

Frames b_k = k_k * l show one scene l, so that the ratio of the power of one patch in two of them,

    log |B_k(w)|^2 - log |B_j(w)|^2 = g(w, s_k) - g(w, s_j),    g(w, s) = log(sinc^2(w . s / 2) + LEAK),

holds neither the scene nor what lens and codec leave in both, as depth from defocus compares two apertures (Pentland, PAMI 1987, "A new
sense for depth of field"). s_k is the streak of frame k in px, straight and of even pace. Over the frame it differs, since the camera
rolls, and since its pace changes while scanlines are read:

    s_k(x, y) = J(x, y) p_k + y c_k,

with the lever J of a pose p_k, and y from the middle in heights of the frame. What is sought minimises

    INDEPENDENT sum q A^2 log(1 + (r / A)^2) + sum_k |p_k / P|^2 + |c_k / C|^2

with r the two sides' difference over pairs of frames, parts of the picture and frequencies, and q how many patches are averaged. First each
frame in turn gets that one of many streaks which explains its ratios best; then all are refined together by Levenberg and Marquardt's
method. What blurs all frames alike shows in no ratio, so that streaks come out as short as can be. Their sense does not show either.

Codecs predict a frame by others, and carry over what of the difference costs too many bits. So compressed frames become alike, and streaks
come out shorter, by exp(-d). The edges of a scene grow with the picture's side, and so do the bits that they need: with B bits for each
px of the side, the root of a picture's pixels, d is exp(-B / CARRIED), give or take CARRIED_SPREAD of its logarithm.

Where frames hardly differ in their blur, noise and compression pretend a streak that all of them have. With the cost D less than that of no
streaks, and the variance v of a streak, of both its axes together, frames are blurred at all with the probability

    1 / (1 + 2 exp(-D) P^2 / v),

by Laplace's approximation for the two numbers of a streak that all have, where both are as likely before.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.special import expit

from rsvideo import threads
from rsvideo.physics.camera import Camera, lever
from rsvideo.physics.noise_level import noise_level
from rsvideo.restoration.resolution import halved_image, pose_factors
from rsvideo.restoration.spectrum import SIDE, windowed

ROWS, COLS = 7, 14  # of patches
PARTS = 4, 2  # of the picture, down and across, in which ratios are averaged
REACH = 4  # frames before and behind one that it is compared with; these four by trial
LOWEST, HIGHEST = 2.0, 1.6  # frequencies that count: in periods a patch, whose window blurs lower ones; in rad a px
SIGNAL = 100.0  # times the noise's power, that the sharper one of two patches must have at a frequency; chosen, as the next, on 25 clips
FINE, FINE_NOISE = 2.2, 1.0  # rad a px, from which on so much of a patch's power is what noise and compression add
LEAK = 0.01  # of the scene's power, that a patch shows where its blur is dark; from 0.003 to 0.03 streaks differ by 0.1 px
COARSE = 480  # px of the longer side at most, at which streaks are searched
LONGEST, STEP, TURNS = 24.0, 0.5, 36  # px of the longest one that is tried, and from one to the next; and directions
ROUNDS = 8  # in which each frame may get another one
SCALES = 16.0, 8.0, 4.0, 2.0, 1.0  # times A, with which each gets another one: graduated non-convexity
LONG = 16.0  # px, from which on a streak is not refined at a higher resolution
USUAL, CHANGE = 30.0, 3.0  # px: P, over the frame, and C
STEPS, ENOUGH = 12, 1e-4  # of Levenberg and Marquardt's method, at most, and the relative fall of the cost that ends them
CARRIED, CARRIED_SPREAD = 67.0, 0.35  # bits for each px of a picture's side, and of the logarithm of d; fitted on 35 clips, docs/method.md
ASTRAY = 0.3  # A; 0.2 does as well, 1.2 worse
INDEPENDENT = 0.002  # of a patch's frequencies, those that are as good as independent: streaks are then off as their variance says, mostly
DAMPING = 1e-3  # of the normal matrix's diagonal, at first
_FLAT = 1e-3  # rad, a phase below which g is as flat as at rest


_ALL = np.stack(np.meshgrid(2 * np.pi * np.fft.rfftfreq(SIDE), 2 * np.pi * np.fft.fftfreq(SIDE)), axis=-1)  # rad a px, across and down
_MAGNITUDE = np.hypot(_ALL[..., 0], _ALL[..., 1])
_TAKEN, _FINE = (LOWEST * 2 * np.pi / SIDE < _MAGNITUDE) & (_MAGNITUDE < HIGHEST), _MAGNITUDE > FINE
_W = _ALL[_TAKEN]

Displaced = Callable[[int, int, Float[np.ndarray, "places 2"]], Float[np.ndarray, "places 2"]]
"""How far what is at places (column, row) of one frame has moved in a later one, px: `tracks.displaced` says so."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Streaks:
    """How each frame is blurred over an exposure, and how surely."""

    pose: Float[np.ndarray, "frames axes"]  # p, px and rad
    change: Float[np.ndarray, "frames 2"]  # c, px
    variance: Float[np.ndarray, " frames"]  # px^2, of the streak in the frame's middle, of both axes together
    probability: Float[np.ndarray, " frames"]  # that a frame, and those of its group, are blurred at all


@dataclass(frozen=True, kw_only=True, eq=False)
class Ratio:
    """How the power of the same patches differs in two frames, part by part."""

    frames: tuple[int, int]
    places: Float[np.ndarray, "2 parts 2"]  # px, the column and the row of each part in either frame
    difference: Float[np.ndarray, "parts taken"]  # of the logarithms, the first frame's less the second's
    counted: Float[np.ndarray, "parts taken"]  # q


def streaks(
    images: Sequence[Float[np.ndarray, "rows cols"]],
    displaced: Displaced,
    group: Sequence[int] | Int[np.ndarray, " frames"],
    camera: Camera,
    axes: int,
) -> Streaks:
    """The streaks of successive frames, along the scanlines.

    Only frames of one `group` show the same. `images` may be halved, once or more; streaks are in px of the camera's frame.
    """
    if min(images[0].shape) < SIDE:
        pose, change, none = np.zeros((len(images), axes)), np.zeros((len(images), 2)), np.zeros(len(images))
        return Streaks(pose=pose, change=change, variance=none + USUAL**2, probability=none)
    scale = 1.0
    while camera.intrinsics.rows > len(images[0]):
        camera, scale = camera.halved(), scale / 2
    levels = [(images, camera, scale)]
    while max(images[0].shape) > COARSE and min(images[0].shape) // 2 >= SIDE:
        images, camera, scale = [halved_image(image) for image in images], camera.halved(), scale / 2
        levels.append((images, camera, scale))
    model, unknowns, variance = None, None, np.zeros(len(images))
    for images, camera, scale in reversed(levels):
        shown = ratios(images, scale, displaced, near(group))
        start = _searched(shown, len(images), axes) if unknowns is None else unknowns * np.append(pose_factors(2, axes), [2, 2])
        model = _Model(camera=camera, ratios=shown, axes=axes)
        unknowns, variance = model.refined(start)
        if 2 * np.linalg.norm(unknowns[:, :2], axis=1).max() > LONG:
            break
    assert model is not None
    assert unknowns is not None
    probability = model.probability(unknowns, variance, group)
    pose, change = np.split(unknowns, [axes], axis=1)
    return Streaks(pose=pose / pose_factors(scale, axes), change=change / scale, variance=variance / scale**2, probability=probability)


def shortened(bits: float) -> float:
    """d, by whose exponential streaks come out shorter than they are, in the median of clips with so many `bits` (`Stream.bits`)."""
    return math.exp(-bits / CARRIED)


def near(group: Sequence[int] | Int[np.ndarray, " frames"]) -> list[tuple[int, int]]:
    """The pairs of frames of one group that are compared."""
    return [(k, j) for k in range(len(group)) for j in range(k + 1, min(len(group), k + REACH + 1)) if group[k] == group[j]]


def ratios(
    images: Sequence[Float[np.ndarray, "rows cols"]], scale: float, displaced: Displaced, pairs: Sequence[tuple[int, int]]
) -> list[Ratio]:
    """Of those pairs of frames that show some of the same, in images so many times as large as the frames."""
    rows, cols = images[0].shape
    tops, lefts = (np.linspace(0, side - SIDE, count).round().astype(int) for side, count in ((rows, ROWS), (cols, COLS)))
    at = np.stack(np.meshgrid(lefts, tops), axis=-1).reshape(-1, 2)
    powers = threads.each(lambda image: _power(image, at), images)
    noise = threads.each(lambda image: noise_level(image.astype(np.float32)) ** 2, images)
    middles = (at + SIDE / 2) / scale - 0.5  # px of the frames
    part = (PARTS[0] * at[:, 1] // (rows - SIDE + 1)) * PARTS[1] + PARTS[1] * at[:, 0] // (cols - SIDE + 1)

    def ratio(k: int, j: int) -> Ratio | None:
        there = at + np.rint(scale * displaced(k, j, middles)).astype(int)
        held = ((there >= 0) & (there <= (cols - SIDE, rows - SIDE))).all(axis=1)
        if not held.any():
            return None
        (one, fine), (other, finer) = (each[held] for each in powers[k]), _power(images[j], there[held])
        floor = np.maximum(max(noise[k], noise[j]), FINE_NOISE * np.minimum(fine, finer))[:, None]
        counted = (np.maximum(one, other) > SIGNAL * floor).astype(one.dtype)
        difference = counted * np.log((one + floor) / (other + floor))
        inside = [part[held] == each for each in np.unique(part[held])]
        total, q = (np.array([each[some].sum(axis=0) for some in inside]) for each in (difference, counted))
        places = np.array([[each[held][some].mean(axis=0) for some in inside] for each in (at, there)]) + (SIDE - 1) / 2
        return Ratio(frames=(k, j), places=places, difference=total / np.maximum(q, 1), counted=q)

    return [found for found in threads.each(lambda pair: ratio(*pair), pairs) if found]


def _power(
    image: Float[np.ndarray, "rows cols"], at: Int[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n taken"], Float[np.ndarray, " n"]]:
    """The periodograms of the patches whose first column and row these are, in which noise has its variance, and their median at the
    finest frequencies."""
    patches = np.stack([image[y : y + SIDE, x : x + SIDE] for x, y in at]).astype(np.float32)
    periodograms = np.abs(windowed(patches)) ** 2
    fine = periodograms[:, _FINE]
    middle = fine.shape[1] // 2
    return periodograms[:, _TAKEN], np.partition(fine, middle, axis=1)[:, middle]


def misfit(left: Float[np.ndarray, "*n taken"], counted: Float[np.ndarray, "*#n taken"]) -> Float[np.ndarray, "*n taken"]:
    """q A^2 log(1 + (r / A)^2) / 2 of what streaks leave of ratios."""
    return 0.5 * ASTRAY**2 * counted * np.log1p((left / ASTRAY) ** 2)


def log_power(streak: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n taken"]:
    """g."""
    sinc, _ = _sinc(streak)
    return np.log(sinc**2 + LEAK)


def _log_power(streak: Float[np.ndarray, "*n 2"]) -> tuple[Float[np.ndarray, "*n taken"], Float[np.ndarray, "*n taken 2"]]:
    """g, and its derivative in the streak."""
    sinc, phase = _sinc(streak)
    power = sinc**2 + LEAK
    slope = sinc * (np.cos(phase) - sinc) / (phase * power)  # of the logarithm, in twice the phase
    return np.log(power), slope[..., None] * _W


def _sinc(streak: Float[np.ndarray, "*n 2"]) -> tuple[Float[np.ndarray, "*n taken"], Float[np.ndarray, "*n taken"]]:
    """sinc(w . s / 2), and w . s / 2."""
    half = streak @ _W.T.astype(streak.dtype) / 2
    phase = np.where(np.abs(half) < _FLAT, half.dtype.type(_FLAT), half)
    return np.sin(phase) / phase, phase


def _searched(ratios: Sequence[Ratio], frames: int, axes: int) -> Float[np.ndarray, "frames unknowns"]:
    """Streaks that are alike over each frame, to refine."""
    out = np.zeros((frames, axes + 2))
    reaches, turns = np.arange(0, LONGEST + STEP / 2, STEP), np.pi * np.arange(TURNS) / TURNS
    tried = np.unique((reaches[:, None, None] * np.stack([np.cos(turns), np.sin(turns)], axis=-1)).reshape(-1, 2), axis=0)
    shown = log_power(tried)
    beside: list[list[tuple[int, np.ndarray, np.ndarray]]] = [[] for _ in range(frames)]
    for one in ratios:
        (k, j), q = one.frames, one.counted.sum(axis=0)
        difference = (one.counted * one.difference).sum(axis=0) / np.maximum(q, 1)
        beside[k].append((j, difference, q))
        beside[j].append((k, -difference, q))

    squares, lengths = shown**2, (tried**2).sum(axis=1)

    def best(expected: Float[np.ndarray, "others taken"], q: Float[np.ndarray, "others taken"], before: np.ndarray) -> np.ndarray:
        likeliest = [before]
        for scale in SCALES:
            weight = INDEPENDENT * q / (1 + ((log_power(likeliest[-1]) - expected) / (scale * ASTRAY)) ** 2)
            cost = squares @ weight.sum(axis=0) - 2 * shown @ (weight * expected).sum(axis=0) + lengths / USUAL**2
            likeliest.append(tried[np.argmin(cost)])
        values = log_power(np.array(likeliest))[:, None]
        costs = 2 * INDEPENDENT * misfit(values - expected, q).sum(axis=(1, 2))
        return likeliest[int(np.argmin(costs + (np.array(likeliest) ** 2).sum(axis=1) / USUAL**2))]

    for k, others in enumerate(beside):
        if others:  # as if the sharpest one at each frequency were not blurred there
            sharpest = np.minimum(np.min([difference for _, difference, _ in others], axis=0), 0)
            out[k, :2] = best(sharpest[None], np.mean([q for *_, q in others], axis=0)[None], np.zeros(2))
    for _ in range(ROUNDS):
        before = out.copy()
        for k, others in enumerate(beside):
            if others:
                expected = np.array([log_power(out[j, :2]) + difference for j, difference, _ in others])
                out[k, :2] = best(expected, np.array([q for *_, q in others]), out[k, :2])
        if np.array_equal(out, before):
            break
    return out


@dataclass(frozen=True, kw_only=True, eq=False)
class _Model:
    """What streaks leave unexplained of the ratios between frames."""

    camera: Camera
    ratios: Sequence[Ratio]
    axes: int

    @cached_property
    def designs(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """The derivative of the streak in the unknowns, (parts, 2, unknowns), in the first frame of each ratio and in the second."""
        lens = self.camera.intrinsics

        def design(places: Float[np.ndarray, "parts 2"]) -> np.ndarray:
            x, y = places.T
            height = (y - (lens.rows - 1) / 2) / lens.rows
            return np.concatenate([lever(lens, x, y, self.axes), height[:, None, None] * np.eye(2)], axis=-1)

        return [(design(one.places[0]), design(one.places[1])) for one in self.ratios]

    def refined(
        self, start: Float[np.ndarray, "frames unknowns"]
    ) -> tuple[Float[np.ndarray, "frames unknowns"], Float[np.ndarray, " frames"]]:
        """The streaks of least cost near others, and the variance of those in the frames' middles, px^2."""
        frames, count = start.shape
        found = start
        normal, right, cost = self._normal(found)
        damping = DAMPING
        for _ in range(STEPS):
            step = np.linalg.solve(normal + damping * np.diag(np.diag(normal)), right).reshape(frames, count)
            after = self._normal(found + step)
            gained = cost - after[2]
            if gained > 0:
                found, (normal, right, cost), damping = found + step, after, damping / 10
            else:
                damping *= 10
            if 0 < gained < ENOUGH * cost:
                break
        covariance = np.linalg.inv(normal).reshape(frames, count, frames, count)
        return found, np.array([np.trace(covariance[k, :2, k, :2]) for k in range(frames)])

    def probability(
        self,
        unknowns: Float[np.ndarray, "frames unknowns"],
        variance: Float[np.ndarray, " frames"],
        group: Sequence[int] | Int[np.ndarray, " frames"],
    ) -> Float[np.ndarray, " frames"]:
        """How probable it is that the frames of each group are blurred at all."""
        out, (*_, cost) = np.zeros(len(unknowns)), self._normal(unknowns)
        for one in np.unique(group):
            inside = np.asarray(group) == one
            *_, without = self._normal(np.where(inside[:, None], 0, unknowns))
            out[inside] = expit(without - cost - np.log(2 * USUAL**2 / np.median(variance[inside])))
        return out

    @cached_property
    def prior(self) -> Float[np.ndarray, " unknowns"]:
        """The inverse variance of each of a frame's unknowns."""
        side = max(self.camera.intrinsics.cols, self.camera.intrinsics.rows) / 2
        return np.array([USUAL, USUAL, *([USUAL / side] * (self.axes - 2)), CHANGE, CHANGE]) ** -2

    def _normal(self, unknowns: Float[np.ndarray, "frames unknowns"]) -> tuple[np.ndarray, np.ndarray, float]:
        """Gauss-Newton's matrix and right side, and the cost."""
        frames, count = unknowns.shape
        normal, right = np.zeros((frames, count, frames, count)), np.zeros((frames, count))
        cost = 0.5 * float((self.prior * unknowns**2).sum())
        for one, designs in zip(self.ratios, self.designs, strict=True):
            left, slopes = -one.difference, list[np.ndarray]()
            for frame, design, sign in zip(one.frames, designs, (1, -1), strict=True):
                value, slope = _log_power(design @ unknowns[frame])
                left = left + sign * value
                slopes.append(sign * (slope @ design).reshape(-1, count))
            weight = (INDEPENDENT * one.counted / (1 + (left / ASTRAY) ** 2)).ravel()
            cost += INDEPENDENT * float(misfit(left, one.counted).sum())
            for frame, slope in zip(one.frames, slopes, strict=True):
                right[frame] -= slope.T @ (weight * left.ravel())
                for other, beside in zip(one.frames, slopes, strict=True):
                    normal[frame, :, other] += (slope * weight[:, None]).T @ beside
        right -= self.prior * unknowns
        return normal.reshape(frames * count, -1) + np.diag(np.tile(self.prior, frames)), right.ravel(), cost
