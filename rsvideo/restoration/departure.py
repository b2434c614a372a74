"""By how much a frame's blur departs from what its path predicts, by what its neighbours show of the scene.

The mean t of the neighbours' latent images is near to the truth, so b - K t says where the blur of a frame b departs from what its path
predicts. Points leave the path in doubt by displacements d_m, each a standard deviation long (`camera_path.doubts`). If x_m d_m are missing
of it,

    b - K t = sum_m x_m J_m + sum_n y_n N_n + noise,    J_m = mean over s of <(grad t) at p(s), d_m(s) - mean of d_m>

with s the instants at which a scanline is open. d_m counts without its mean over these: t was aligned to the frame, and does not show where
a scanline lies. N_n is what else may depart: where scanlines lie, how soft t is, along the axes and between them, and how strong the
blur is, as of an exposure that is not quite right. By least squares x is sure up to a covariance S, by which blocks of the frame disagree
(the sandwich estimator). What the path does not explain, such as things that move by themselves, counts less, by Cauchy's weights.
"""

import itertools
import math
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float, Float32
from numpy.polynomial import legendre

from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.extent import longest
from rsvideo.restoration.nodes import nodes
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.predicted_blur import INDEPENDENT, Predicted
from rsvideo.restoration.rectification import sampled_at

LEAST_SAMPLES = 8  # of an exposure
AT_ONCE = 8  # of them, whose slopes are held
BENDS = 4  # terms along the scanlines of where they lie
SOFT = 0.7  # px, of the Gaussian under which curvatures are taken
BLOCKS = 6, 8  # down and across, which agree or not
PATCH = 11  # px over which a place must be explained
UNEXPLAINED = 3.0  # times what the middle one leaves unexplained, at which a place counts half; origin: by trial
BELIEVED = 0.5, 0.5, 0.3  # px, px^2 and a share: what else departs may be so much, which hardly matters
FREE = 100.0  # standard deviations that least squares leave to x
_NOTHING = 1e-12  # of light squared: a frame that is explained exactly divides by this


@dataclass(frozen=True, kw_only=True, eq=False)
class Departure:
    """What is missing of a frame's path."""

    missing: Float[np.ndarray, " doubts"]  # x, by least squares
    covariance: Float[np.ndarray, "doubts doubts"]  # S
    strength: float  # of the blur, where 1 is as predicted


def departure(
    path: Trajectory, doubts: Float[np.ndarray, "doubts terms axes"], predicted: Predicted, camera: Camera, flow: Flow | None = None
) -> Departure:
    """What is missing of a frame's path, a polynomial, within its `doubts`, px; all along the scanlines."""
    bent, slopes = changes(path, doubts, predicted.target, camera, flow)
    return _likeliest(np.concatenate([bent, _beside(slopes, predicted)]), predicted, len(doubts))


def changes(
    path: Trajectory,
    moves: Float[np.ndarray, "doubts terms axes"],
    target: Float[np.ndarray, "rows cols"],
    camera: Camera,
    flow: Flow | None,
) -> tuple[Float32[np.ndarray, "doubts rows cols"], Float32[np.ndarray, "2 rows cols"]]:
    """J_m, and the slopes of K t in x and in y: Eq. (13) without its minus, of displacements and of a shift."""
    rows, cols = target.shape
    times = camera.timing.sample_times(max(LEAST_SAMPLES, math.ceil(longest(camera, path))))
    poses = path.at(times) - path.at(np.array([camera.timing.middle]))
    apart = path.basis(times) @ moves[:, None, :, :2]  # (doubts, rows, samples, 2)
    apart = np.moveaxis(apart - apart.mean(axis=2, keepdims=True), 0, 1).astype(np.float32)
    drift = flow and flow.everywhere(nodes(cols), rows)
    steps = np.diff(target, axis=1, append=target[:, -1:]), np.diff(target, axis=0, append=target[-1:])
    bent, slopes = np.zeros((rows, len(moves), cols), np.float32), np.zeros((2, rows, cols), np.float32)
    for first in range(0, times.shape[1], AT_ONCE):
        some = range(first, min(first + AT_ONCE, times.shape[1]))
        found = np.empty((len(some), 2, rows, cols), np.float32)
        for s, slope in zip(some, found, strict=True):
            at = sampled_at(poses[:, s], times[:, s] - camera.timing.middle, camera, drift)
            for axis, step in enumerate(steps):
                x, y = (place - np.float32(0.5 * (a == axis)) for a, place in enumerate(at))  # a step lies between two pixels
                cv2.remap(step, x, y, cv2.INTER_LINEAR, slope[axis], cv2.BORDER_REPLICATE)
        slopes += found.sum(axis=0)
        bent += apart[:, :, some].reshape(rows, len(moves), -1) @ np.moveaxis(found.reshape(-1, rows, cols), 1, 0)
    return np.moveaxis(bent, 1, 0) / np.float32(times.shape[1]), slopes / np.float32(times.shape[1])


def _beside(slopes: Float[np.ndarray, "2 rows cols"], predicted: Predicted) -> list[Float[np.ndarray, "rows cols"]]:
    """N_n: what else may depart, the strength of the blur last."""
    terms = legendre.legvander(np.linspace(-1, 1, len(predicted.shown)), BENDS - 1).astype(np.float32)
    soft = cv2.GaussianBlur(predicted.blurred, (0, 0), SOFT)
    curved = [cv2.Sobel(soft, -1, *orders, ksize=3, scale=scale) for orders, scale in (((2, 0), 1 / 4), ((0, 2), 1 / 4), ((1, 1), 1 / 4))]
    lie = [term[:, None] * slope for term in terms.T for slope in slopes]
    return [*lie, *curved, predicted.blurred - predicted.displaced]


def _likeliest(departures: Float[np.ndarray, "unknowns rows cols"], predicted: Predicted, doubts: int) -> Departure:
    """x and S of so many doubts, the first of the departures, and how strong the blur is, the last one."""
    shown = predicted.shown.astype(np.float32)
    left = shown * (predicted.observed - predicted.blurred)
    spread = np.repeat([FREE, *BELIEVED], [doubts, 2 * BENDS, 3, 1])
    first, _ = _least_squares(departures, left, shown * _explained(left, shown), spread)
    still = left - np.tensordot(first.astype(np.float32), departures, 1)
    found, scatter = _least_squares(departures, left, shown * _explained(still, shown), spread)
    return Departure(missing=found[:doubts], covariance=scatter[:doubts, :doubts], strength=1 + float(found[-1]))


def _least_squares(
    departures: Float[np.ndarray, "unknowns rows cols"],
    left: Float[np.ndarray, "rows cols"],
    weight: Float[np.ndarray, "rows cols"],
    spread: Float[np.ndarray, " unknowns"],
) -> tuple[Float[np.ndarray, " unknowns"], Float[np.ndarray, "unknowns unknowns"]]:
    """How much of each departure there is, and S."""
    products, right = _by_block(departures, left, weight)
    precision = INDEPENDENT * weight.sum(dtype=float) / max(float((weight * left**2).sum(dtype=float)), _NOTHING)
    covariance = np.linalg.pinv(precision * products.sum(axis=0) + np.diag(1 / spread**2), hermitian=True)
    found = covariance @ (precision * right.sum(axis=0))
    apart = precision * (right - products @ found)
    return found, covariance @ (apart.T @ apart) @ covariance * len(apart) / (len(apart) - 1)


def _explained(left: Float[np.ndarray, "rows cols"], shown: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
    """Cauchy's weights, of how much a patch about each pixel leaves unexplained."""
    about = cv2.boxFilter((shown * left) ** 2, -1, (PATCH, PATCH))
    middle = float(np.median(about[shown > 0])) if shown.any() else 0.0
    return 1 / (1 + about / (UNEXPLAINED * middle + _NOTHING))


def _by_block(
    departures: Float[np.ndarray, "unknowns rows cols"], left: Float[np.ndarray, "rows cols"], weight: Float[np.ndarray, "rows cols"]
) -> tuple[Float[np.ndarray, "blocks unknowns unknowns"], Float[np.ndarray, "blocks unknowns"]]:
    """The normal equations of each block of the frame."""
    rows, cols = (np.linspace(0, side, parts + 1).round().astype(int) for side, parts in zip(left.shape, BLOCKS, strict=True))
    products, right = [], []
    for block in itertools.product(map(slice, rows[:-1], rows[1:]), map(slice, cols[:-1], cols[1:])):
        part = departures[:, *block].reshape(len(departures), -1).astype(float)
        weighted = part * weight[block].ravel()
        products.append(weighted @ part.T)
        right.append(weighted @ left[block].ravel())
    return np.array(products), np.array(right)
