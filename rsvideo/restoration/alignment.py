"""What is left between two frames that should show the same: a shift, and its change across columns, smooth along the rows.

Lucas & Kanade's steps of Gauss-Newton. A pixel that differs by more than most counts less.
"""

import math
from collections.abc import Callable

import cv2
import numpy as np
from jaxtyping import Float, Int
from numpy.polynomial import legendre

from rsvideo.physics.luminance import LIFT
from rsvideo.restoration.nodes import between

BENDS = 4  # terms along the rows of what is left between two frames' poses: each path's own error within its frame
SOFT = 1.2  # px, of the Gaussian under which two frames are compared
EDGE = 8  # px beside the borders that are not compared
PLENTY = 200_000  # pixels, about as many as are compared
STEPS = 4  # of Gauss-Newton at most
SETTLED = 0.02  # px; a step that moves no sample farther is the last
OUTLIER = 3  # times the typical difference, at which a pixel counts half
LEAST_DIFFERENCE = 1e-4  # of white: frames that agree exactly divide by this
STIFFNESS = 1e-3  # of the displacement, relative to the mean of the normal matrix's diagonal

Sums = tuple[Float[np.ndarray, "thin 4 4"], Float[np.ndarray, "thin 4"]]
"""Of each row that is compared, with the slopes of both axes in the shift and in its change: their products, and with what is left."""


def grey(image: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "rows cols"]:
    """The mean of the channels."""
    return image @ np.full(image.shape[2], 1 / image.shape[2], np.float32)


def softened(image: Float[np.ndarray, "rows cols channels"]) -> Float[np.ndarray, "rows cols"]:
    """A picture as it is compared."""
    return cv2.GaussianBlur(np.sqrt(np.maximum(grey(image), 0) + LIFT), (0, 0), SOFT)


def sampled(image: np.ndarray, at: Float[np.ndarray, "2 rows cols"], how: int) -> np.ndarray:
    """An image at these places, interpolated as OpenCV's constant says."""
    shown = cv2.remap(image, at[0], at[1], how, borderMode=cv2.BORDER_REPLICATE)
    return shown.reshape(*at.shape[1:], *image.shape[2:])  # which OpenCV takes from a grey one


def thinned(rows: int, cols: int) -> int:
    """From one row or column of a large frame that is compared to the next."""
    return max(1, round(math.sqrt(rows * cols / PLENTY)))


def bends(rows: int) -> Float[np.ndarray, "rows terms"]:
    """By which terms a displacement changes along the rows."""
    return legendre.legvander(np.linspace(-1, 1, rows), BENDS - 1)


def least_squares(rows: int, step: int, sums: Callable[[Float[np.ndarray, "2 2 terms"]], Sums]) -> Float[np.ndarray, "2 2 terms"]:
    """The shift and its change across the columns (from -0.5 to 0.5), x and y, by terms along the rows."""
    basis = bends(rows)
    p = basis[EDGE : rows - EDGE : step]
    found = np.zeros((2, 2, BENDS))  # constant or across, axis, term
    for _ in range(STEPS):
        by_row, left = sums(found)
        normal = np.einsum("rfg,rp,rq->fpgq", by_row, p, p, optimize=True).reshape(4 * BENDS, 4 * BENDS)
        right = np.tensordot(left.T, p, axes=(1, 0)).ravel()
        normal += STIFFNESS * np.trace(normal) / len(normal) * np.eye(len(normal))
        taken = np.linalg.solve(normal, right).reshape(2, 2, BENDS)
        found = found + taken
        if np.abs(taken[0] @ basis.T).max() + np.abs(taken[1] @ basis.T).max() / 2 < SETTLED:
            break
    return found


def misaligned(
    first: Float[np.ndarray, "rows cols"],
    other: Float[np.ndarray, "rows cols"],
    at: Float[np.ndarray, "rows nodes 2"],
    columns: Int[np.ndarray, " nodes"],
) -> Float[np.ndarray, "rows nodes 2"]:
    """What to add to where the other is sampled so that both agree. Of a large frame every few rows and columns are compared."""
    rows, cols = first.shape
    step = thinned(rows, cols)
    thin = np.s_[EDGE : rows - EDGE : step, EDGE : cols - EDGE : step]
    basis, across = bends(rows), np.linspace(-0.5, 0.5, cols)
    p, wide = basis[thin[0]], across[thin[1]].astype(np.float32)
    observed, start = first[thin], between(at[thin[0]].astype(np.float32), columns)[..., thin[1]]
    gradients = cv2.Sobel(other, -1, 1, 0, scale=1 / 8), cv2.Sobel(other, -1, 0, 1, scale=1 / 8)

    def moved(found: np.ndarray, middle: np.ndarray, side: np.ndarray) -> np.ndarray:
        constant, changing = (found @ middle.T)[..., None]
        return constant + changing * side

    def sums(found: Float[np.ndarray, "2 2 terms"]) -> Sums:
        place = np.asarray(start + moved(found, p, wide), np.float32)
        gx, gy, shown = (sampled(image, place, cv2.INTER_LINEAR) for image in (*gradients, other))
        apart = observed - shown
        weight = 1 / (1 + (apart / (OUTLIER * np.median(np.abs(apart)) + LEAST_DIFFERENCE)) ** 2)
        slopes = np.stack([gx, gy, gx * wide, gy * wide])
        by_row = np.matmul((slopes * weight).swapaxes(0, 1), slopes.transpose(1, 2, 0))
        return by_row, (slopes * weight * apart).sum(axis=2).T

    return np.moveaxis(moved(least_squares(rows, step, sums), basis, across[columns]), 0, -1)
