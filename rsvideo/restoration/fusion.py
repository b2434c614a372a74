"""Neighbouring frames show one scene: what one frame's blur has destroyed, another's has kept.

The latent images of a frame's neighbours are brought to its pose and averaged with its own, the shortest blur weighing
most, into a target t. What does not belong there (what moved by itself, or was hidden) shows in the frame itself:
where K t_j of a neighbour j does not explain b, it counts for nothing. Then l = argmin |K l - b|^2 + rho |l - t|^2.

Where neighbours show a place and none explains the frame, the frame's own latent image has nobody to agree with: mostly a path that is
wrong there, whatever its residual says. How much of the path's blur the frame shows is measured by them, too (`predicted_blur`).
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float

from rsvideo import threads
from rsvideo.physics.camera import Intrinsics, resampled_at
from rsvideo.physics.luminance import LIFT
from rsvideo.restoration import alignment, device_frame
from rsvideo.restoration.alignment import grey, misaligned, sampled, softened
from rsvideo.restoration.blurred_frame import BlurredFrame
from rsvideo.restoration.nodes import NODES, between, nodes
from rsvideo.restoration.predicted_blur import Predicted

RIDGE = 0.6  # rho; origin: by trial
FAINTEST = 0.15  # of the frame's own weight; neighbours that weigh less are left out; origin: by trial
MOST = 4  # neighbours, the sharpest
SHORTEST = 1.0  # px; no blur is counted as shorter
PATCH = 11  # px over which a neighbour must explain the frame, as far as it shows them; origin: by trial
LEAST_SHOWN = 1e-3  # of the frame's own weight, that neighbours have together where they show a place
LEAST_OWN = 1e-3  # of the frame's own weight, where its data show nothing: something is shown where no neighbour does, either
ASTRAY = 40.0  # times what noise and path leave unexplained, from which on a place has not the path's blur; origin: by trial
DOUBT = 3.0  # times the frame's own residual, at which a neighbour counts 1 / e; origin: by trial
EDGE = 1  # px from its borders, nearer than which a neighbour shows nothing


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedImage:
    """A latent image of the scene along its scanlines, the pose it shows, and how much its blur has left."""

    latent: Float[np.ndarray, "rows cols channels"]
    pose: Float[np.ndarray, " axes"]  # against the other frames', px and rad
    length: float  # px of the blur

    @property
    def weight(self) -> float:
        """How much it counts: its noise has the power of the blur's length squared."""
        return 1 / max(self.length, SHORTEST) ** 2

    @cached_property
    def there(self) -> Any:
        """The image on the GPU, brought there once for all frames that it helps."""
        return device_frame.picture(self.latent, LIFT, alignment.SOFT)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fused:
    """A frame restored with its neighbours, and how well the one that agrees best explains it."""

    frame: BlurredFrame
    solved: Callable[[], Any]  # its latent image, the frame's kind of picture
    explained: Float[np.ndarray, "rows cols"]  # 0 to 1
    shown: Bool[np.ndarray, "rows cols"]  # whether any neighbour shows the place
    astray: Bool[np.ndarray, "rows cols"]  # whether the blur there, or as far about it as that rings, is not the path's
    support: Float[np.ndarray, "rows cols"]  # 0 to 1: the share that the frame's own data grant, or neighbours that count as much
    predicted: Predicted | None  # what the neighbours alone make of the frame; None: not wanted


Displaced = Callable[[Float[np.ndarray, "rows cols"]], Float[np.ndarray, "rows cols"]]
"""D of `predicted_blur`: a picture whose scanlines are displaced as the path says, and not blurred."""


def helpful(first: PosedImage, others: Sequence[PosedImage]) -> list[PosedImage]:
    """The neighbours that count beside a frame's own latent image, the sharpest."""
    return sorted((o for o in others if o.weight > FAINTEST * first.weight), key=lambda o: -o.weight)[:MOST]


def fused(
    frame: BlurredFrame,
    first: PosedImage,
    others: Sequence[PosedImage],
    intrinsics: Intrinsics,
    noise: float,
    error: float = 0.0,
    *,
    own: Float[np.ndarray, "rows cols"] | None = None,
    displaced: Displaced | None = None,
) -> Fused:
    """The latent image of `frame`, whose own one is `first`, with the help of its neighbours'.

    `noise` is the sensor's, and the path may be off by `error` px. `own` is the share of the frame's own latent image that its data
    grant, 0 to 1: all of it by default. It counts by as much. Where scanlines are `displaced` as the path says, the answer also holds what
    path and neighbours predict of the frame.
    """
    share = np.ones(first.latent.shape[:2], np.float32) if own is None else np.maximum(own, LEAST_OWN).astype(np.float32)
    weights = np.float32(first.weight) * share
    if frame.device == "cuda":
        return _fused_there(frame, first, others, intrinsics, noise, error, weights, displaced)
    pixels, unclipped = frame.observed()
    observed = grey(pixels)

    def unexplained(image: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "rows cols"]:
        return unclipped * (frame.blurred(grey(image)) - observed) ** 2

    def misfit(image: Float[np.ndarray, "rows cols channels"], there: Bool[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
        return _about(there * unexplained(image)) / np.where(there, _about(there.astype(np.float32)), np.float32(1))

    power, own_misfit = _gradient_power(observed), _about(unexplained(first.latent))
    limit = DOUBT**2 * (own_misfit + _expected(np.minimum(power, power.mean()), noise, error) / 2)
    total, alone = weights[..., None] * first.latent, weights.copy()
    explained, shown = np.zeros(weights.shape, np.float32), np.zeros(weights.shape, bool)
    soft = softened(first.latent)
    at_once = threads.most()  # all of them would take more memory
    for some in (others[k : k + at_once] for k in range(0, len(others), at_once)):
        for other, (image, there) in zip(some, threads.each(lambda other: _at_pose(first, soft, other, intrinsics), some), strict=True):
            agreement = np.asarray(there * np.exp(-misfit(image, there) / limit), np.float32)
            explained, shown = np.maximum(explained, agreement), shown | there
            weight = np.float32(other.weight) * agreement
            image *= weight[..., None]
            total += image
            weights += weight
    predicted = None
    if displaced:
        beside = weights - alone
        served = beside > LEAST_SHOWN * first.weight
        own_grey = grey(first.latent)
        target = np.where(served, (grey(total) - alone * own_grey) / np.where(served, beside, 1), own_grey)
        served &= (unclipped > 0) & _inner(served.shape, first.length)
        predicted = Predicted(observed=observed, target=target, blurred=frame.blurred(target), displaced=displaced(target), shown=served)
    total /= weights[..., None]
    astray = _ringing(own_misfit > ASTRAY * _expected(power, noise, error), first.length)
    return _result(frame, lambda: frame.towards(total, RIDGE), explained, shown, astray, weights, first, predicted)


def _about(image: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
    """The mean over a patch about each pixel."""
    return cv2.boxFilter(image, -1, (PATCH, PATCH))


def _gradient_power(observed: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
    """About each pixel."""
    power = np.zeros_like(observed)
    power[:, :-1] += np.diff(observed, axis=1) ** 2
    power[:-1] += np.diff(observed, axis=0) ** 2
    return _about(power)


def _expected(power: Float[np.ndarray, "rows cols"], noise: float, error: float) -> Float[np.ndarray, "rows cols"]:
    """The variance of what a right image leaves unexplained: the sensor's, and what a path that is off by `error` px makes of gradients of
    that `power`."""
    return np.float32(noise**2) + np.float32(error**2) * power


def _inner(shape: tuple[int, int], length: float) -> Bool[np.ndarray, "rows cols"]:
    """Farther from the borders than blur of `length` px reaches: within that, nobody knows what the frame is blurred with."""
    (rows, cols), reach, inner = shape, math.ceil(length), np.zeros(shape, bool)
    inner[reach : rows - reach, reach : cols - reach] = True
    return inner


def _ringing(unexplained: Bool[np.ndarray, "rows cols"], length: float) -> Bool[np.ndarray, "rows cols"]:
    """Where a latent image leaves too much unexplained, and as far about that as blur of `length` px rings."""
    found, side = (unexplained & _inner(unexplained.shape, length)).astype(np.float32), 2 * math.ceil(length) + 1
    return cv2.boxFilter(found, -1, (side, side), normalize=False) > 0.5


def _result(
    frame: BlurredFrame,
    solved: Callable[[], Any],
    explained: np.ndarray,
    shown: np.ndarray,
    astray: np.ndarray,
    weights: np.ndarray,
    first: PosedImage,
    predicted: Predicted | None,
) -> Fused:
    support = np.minimum(weights / np.float32(first.weight), 1)
    return Fused(frame=frame, solved=solved, explained=explained, shown=shown, astray=astray, support=support, predicted=predicted)


def _fused_there(
    frame: BlurredFrame,
    first: PosedImage,
    others: Sequence[PosedImage],
    intrinsics: Intrinsics,
    noise: float,
    error: float,
    weights: Float[np.ndarray, "rows cols"],
    displaced: Displaced | None,
) -> Fused:
    """The same on the GPU, where neighbours follow one another; `weights` are those of the frame's own latent image."""
    rows, cols, _ = first.latent.shape
    x, y = np.meshgrid(nodes(cols).astype(float), nodes(rows).astype(float))
    step, basis = alignment.thinned(rows, cols), alignment.bends(rows)
    how = {"step": step, "edge": alignment.EDGE, "outlier": alignment.OUTLIER, "least_difference": alignment.LEAST_DIFFERENCE}
    total = device_frame.fusion(frame, first.there, weights, noise, error, patch=PATCH, doubt=DOUBT, margin=EDGE)
    for other in others:
        drift = resampled_at(intrinsics, first.pose - other.pose, x, y) - np.stack([x, y], axis=-1)
        neighbour = device_frame.neighbour(first.there, other.there, drift, NODES, **how)
        found = alignment.least_squares(rows, step, lambda found, sums=neighbour.sums: sums(found @ basis.T))
        total.add(neighbour, found @ basis.T, other.weight)
    explained, shown, weights = total.found()
    astray = _ringing(total.unexplained(ASTRAY), first.length)
    predicted = None
    if displaced:
        observed, blurred, target, served = total.beside(LEAST_SHOWN * first.weight)
        served &= _inner(served.shape, first.length)
        predicted = Predicted(observed=observed, target=target, blurred=blurred, displaced=displaced(target), shown=served)
    return _result(frame, lambda: total.latent(RIDGE), explained, shown, astray, weights, first, predicted)


def _at_pose(
    first: PosedImage, soft: Float[np.ndarray, "rows cols"], other: PosedImage, intrinsics: Intrinsics
) -> tuple[Float[np.ndarray, "rows cols channels"], Bool[np.ndarray, "rows cols"]]:
    """The other's latent image at the frame's own pose, and where the other shows it; elsewhere `first`, which `soft` is of."""
    rows, cols = soft.shape
    columns = nodes(cols)
    x, y = np.meshgrid(columns.astype(float), np.arange(rows, dtype=float))
    at = resampled_at(intrinsics, first.pose - other.pose, x, y)
    at = between((at + misaligned(soft, softened(other.latent), at, columns)).astype(np.float32), columns)
    sides = np.array([cols, rows], np.float32)[:, None, None]
    there = np.asarray(((at >= EDGE) & (at <= sides - 1 - EDGE)).all(axis=0))
    image = sampled(other.latent, at, cv2.INTER_LANCZOS4)
    np.clip(image, 0, 1, out=image)
    np.copyto(image, first.latent, where=~there[..., None])
    return image, there
