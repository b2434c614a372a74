"""Neighbouring frames show one scene: what one frame's blur has destroyed, another's has kept.

The latent images of a frame's neighbours are brought to its pose and averaged with its own, the shortest blur weighing
most, into a target t. What does not belong there (what moved by itself, or was hidden) shows in the frame itself:
where K t_j of a neighbour j does not explain b, it counts for nothing. Then l = argmin |K l - b|^2 + rho |l - t|^2.

Where neighbours show a place and none explains the frame, the frame's own latent image has nobody to agree with: mostly a path that is
wrong there, whatever its residual says.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from numpy.polynomial import legendre

from rsvideo import threads
from rsvideo.physics.camera import Intrinsics, resampled_at
from rsvideo.physics.luminance import LIFT
from rsvideo.restoration.blurred_frame import BlurredFrame
from rsvideo.restoration.rectification import between, nodes

RIDGE = 0.6  # rho; origin: by trial
FAINTEST = 0.15  # of the frame's own weight; neighbours that weigh less are left out; origin: by trial
MOST = 4  # neighbours, the sharpest
SHORTEST = 1.0  # px; no blur is counted as shorter
PATCH = 15  # px over which a neighbour must explain the frame; origin: by trial
LEAST_OWN = 1e-3  # of the frame's own weight, where its data show nothing: something is shown where no neighbour does, either
DOUBT = 3.0  # times the frame's own residual, at which a neighbour counts 1 / e; origin: by trial
BENDS = 4  # terms along the rows of what is left between two frames' poses: each path's own error within its frame
SOFT = 1.2  # px, of the Gaussian under which two frames are compared
EDGE = 8  # px beside the borders that are not compared
LANCZOS = 4  # px from its place, the farthest pixel that a sample reads
PLENTY = 200_000  # pixels, about as many as are compared
STEPS = 4  # of Gauss-Newton at most
SETTLED = 0.02  # px; a step that moves no sample farther is the last
OUTLIER = 3  # times the typical difference, at which a pixel counts half
_LEAST_DIFFERENCE = 1e-4  # of white: frames that agree exactly divide by this
STIFFNESS = 1e-3  # of the displacement, relative to the mean of the normal matrix's diagonal


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


@dataclass(frozen=True, kw_only=True, eq=False)
class Fused:
    """A frame restored with its neighbours, and how well the one that agrees best explains it."""

    latent: Float[np.ndarray, "rows cols channels"]
    explained: Float[np.ndarray, "rows cols"]  # 0 to 1
    shown: Bool[np.ndarray, "rows cols"]  # whether any neighbour shows the place
    support: Float[np.ndarray, "rows cols"]  # 0 to 1: the share that the frame's own data grant, or neighbours that count as much


def helpful(first: PosedImage, others: Sequence[PosedImage]) -> list[PosedImage]:
    """The neighbours that count beside a frame's own latent image, the sharpest."""
    return sorted((o for o in others if o.weight > FAINTEST * first.weight), key=lambda o: -o.weight)[:MOST]


def fused(
    frame: BlurredFrame,
    first: PosedImage,
    others: Sequence[PosedImage],
    intrinsics: Intrinsics,
    noise: float,
    *,
    own: Float[np.ndarray, "rows cols"] | None = None,
) -> Fused:
    """The latent image of `frame`, whose own one is `first`, with the help of its neighbours'.

    `own` is the share of the frame's own latent image that its data grant, 0 to 1: all of it by default. It counts by as much.
    """
    pixels, valid = frame.observed()
    observed, unclipped = _grey(pixels), valid.min(axis=2)

    def misfit(image: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "rows cols"]:
        return cv2.boxFilter(unclipped * (frame.blurred(_grey(image)) - observed) ** 2, -1, (PATCH, PATCH))

    limit = DOUBT**2 * (misfit(first.latent) + noise**2 / 2)
    weights = first.weight * (np.ones(first.latent.shape[:2], np.float32) if own is None else np.maximum(own, LEAST_OWN))
    total = weights[..., None] * first.latent
    explained, shown = np.zeros(weights.shape, np.float32), np.zeros(weights.shape, bool)
    soft = _soft(first.latent)
    at_once = threads.most()  # all of them would take more memory
    for some in (others[k : k + at_once] for k in range(0, len(others), at_once)):
        for other, (image, there) in zip(some, threads.each(lambda other: _at_pose(first, soft, other, intrinsics), some), strict=True):
            agreement = np.asarray(there * np.exp(-misfit(image) / limit), np.float32)
            explained, shown = np.maximum(explained, agreement), shown | there
            weight = np.float32(other.weight) * agreement
            image *= weight[..., None]
            total += image
            weights += weight
    total /= weights[..., None]
    latent = frame.towards(total, RIDGE)
    return Fused(latent=latent, explained=explained, shown=shown, support=np.minimum(weights / np.float32(first.weight), 1))


def _grey(image: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "rows cols"]:
    return image @ np.full(image.shape[2], 1 / image.shape[2], np.float32)


def _at_pose(
    first: PosedImage, soft: Float[np.ndarray, "rows cols"], other: PosedImage, intrinsics: Intrinsics
) -> tuple[Float[np.ndarray, "rows cols channels"], Bool[np.ndarray, "rows cols"]]:
    """The other's latent image at the frame's own pose, and where the other shows it; elsewhere `first`, which `soft` is of."""
    rows, cols = soft.shape
    columns = nodes(cols)
    x, y = np.meshgrid(columns.astype(float), np.arange(rows, dtype=float))
    at = resampled_at(intrinsics, first.pose - other.pose, x, y)
    at = between((at + _misaligned(soft, _soft(other.latent), at, columns)).astype(np.float32), columns)
    inside = np.asarray(((at >= LANCZOS) & (at <= np.array([cols, rows], np.float32) - 1 - LANCZOS)).all(axis=-1), np.uint8)
    there = cv2.erode(inside, np.ones((PATCH, PATCH)), borderValue=0) > 0
    at = _axes(at)  # the image takes the memory of what it is made from
    image = _sampled(other.latent, at, cv2.INTER_LANCZOS4)
    np.clip(image, 0, 1, out=image)
    np.copyto(image, first.latent, where=~there[..., None])
    return image, there


def _soft(image: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "rows cols"]:
    return cv2.GaussianBlur(np.sqrt(np.maximum(_grey(image), 0) + LIFT), (0, 0), SOFT)


def _axes(at: Float[np.ndarray, "rows cols 2"]) -> Float[np.ndarray, "2 rows cols"]:
    return np.ascontiguousarray(np.moveaxis(at, -1, 0), np.float32)


def _sampled(image: np.ndarray, at: Float[np.ndarray, "2 rows cols"], how: int) -> np.ndarray:
    shown = cv2.remap(image, at[0], at[1], how, borderMode=cv2.BORDER_REPLICATE)
    return shown.reshape(*at.shape[1:], *image.shape[2:])  # which OpenCV takes from a grey one


def _misaligned(
    first: Float[np.ndarray, "rows cols"],
    other: Float[np.ndarray, "rows cols"],
    at: Float[np.ndarray, "rows nodes 2"],
    columns: Int[np.ndarray, " nodes"],
) -> Float[np.ndarray, "rows nodes 2"]:
    """What to add to where the other is sampled so that both agree (Lucas & Kanade): a shift, and its change across columns, smooth
    along the rows. Both are compared on every few rows and columns of a large frame."""
    rows, cols = first.shape
    step = max(1, round(math.sqrt(rows * cols / PLENTY)))
    thin = np.s_[EDGE : rows - EDGE : step, EDGE : cols - EDGE : step]
    basis, across = legendre.legvander(np.linspace(-1, 1, rows), BENDS - 1), np.linspace(-0.5, 0.5, cols)
    p, wide = basis[thin[0]], across[thin[1]].astype(np.float32)
    observed, start = first[thin], between(at[thin[0]].astype(np.float32), columns)[:, thin[1]]
    gradients = cv2.Sobel(other, -1, 1, 0, scale=1 / 8), cv2.Sobel(other, -1, 0, 1, scale=1 / 8)
    found = np.zeros((2, 2, BENDS))  # constant or across, axis, term

    def moved(middle: np.ndarray, side: np.ndarray) -> np.ndarray:
        constant, changing = np.swapaxes(found @ middle.T, 1, 2)
        return constant[:, None] + changing[:, None] * side[:, None]

    for _ in range(STEPS):
        place = _axes(start + moved(p, wide))
        gx, gy, sampled = (_sampled(image, place, cv2.INTER_LINEAR) for image in (*gradients, other))
        apart = observed - sampled
        weight = 1 / (1 + (apart / (OUTLIER * np.median(np.abs(apart)) + _LEAST_DIFFERENCE)) ** 2)
        slopes = np.stack([gx, gy, gx * wide, gy * wide])
        by_row = np.matmul((slopes * weight).swapaxes(0, 1), slopes.transpose(1, 2, 0))
        normal = np.einsum("rfg,rp,rq->fpgq", by_row, p, p, optimize=True).reshape(4 * BENDS, 4 * BENDS)
        right = np.tensordot((slopes * weight * apart).sum(axis=2), p, axes=(1, 0)).ravel()
        normal += STIFFNESS * np.trace(normal) / len(normal) * np.eye(len(normal))
        step_taken = np.linalg.solve(normal, right).reshape(2, 2, BENDS)
        found = found + step_taken
        if np.abs(step_taken[0] @ basis.T).max() + np.abs(step_taken[1] @ basis.T).max() / 2 < SETTLED:
            break
    return moved(basis, across[columns])
