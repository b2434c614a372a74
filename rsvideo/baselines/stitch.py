"""Blocks of scanlines restored under one kernel each, aligned and blended (Su & Heidrich 2015, Fig. 9 right).

Short blocks see less motion between their scanlines, tall ones more texture to measure blur by. A blind kernel leaves the
place of its latent image open, so neighbours are moved onto each other; that undoes a wobble's shifts, not its shears.
"""

import time
from dataclasses import dataclass
from itertools import pairwise

import cv2
import numpy as np
import scipy.ndimage
from jaxtyping import Float

from rsvideo import threads
from rsvideo.baselines import uniform
from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics.luminance import luminance
from rsvideo.restoration.blind_kernel import fitted
from rsvideo.restoration.scanlines import View
from rsvideo.restoration.scene import Scene, gradient_power, scene_of, windowed
from rsvideo.restoration.settings import Settings

SHORTEST = 24  # scanlines a block must have
SHARE = 3  # blocks that lie below each other without overlap, by default: a third of the frame each
CONTEXT = 24  # scanlines restored beyond a block on either side and its kernel, so that nothing rings
REFINEMENTS = 6  # Gauss-Newton steps of an alignment, and once more with outliers weighted down
OUTLIER = 4  # times the typical squared difference, at which a pixel counts half
WANDERED = 2  # px; a refinement that leads farther from its start is not believed
_TINY_POWER = 1e-12  # of gradients; an area without texture divides by this
_TINY_DIFFERENCE = 1e-8  # linear light squared; blocks that agree exactly divide by this
_RIDGE, _LEAST_RIDGE = 1e-6, 1e-9  # of the normal matrix: relative to its trace, and absolute; keeps a step finite without texture


@dataclass(frozen=True, kw_only=True, eq=False)
class Block:
    """Scanlines [first, last) of a frame and the kernel that blurred them."""

    first: int
    last: int
    kernel: Float[np.ndarray, "k k"]

    def surroundings(self, rows: int) -> slice:
        """The scanlines it is restored with."""
        beyond = CONTEXT + len(self.kernel) // 2
        return slice(max(0, self.first - beyond), min(rows, self.last + beyond))


def restored(view: View, settings: Settings, *, block_rows: int | None = None) -> FrameResult:
    """The latent image of a frame from blocks of `block_rows` scanlines that overlap by half, a third of them by default."""
    if block_rows is not None and block_rows < SHORTEST:
        raise ValueError(
            f"block_rows must be at least {SHORTEST} scanlines, got {block_rows}; a shorter block has too few edges for a kernel"
        )
    started = time.monotonic()
    scene = scene_of(view, settings)
    latent = psfs = None
    verdict = uniform.verdict_before(scene)
    if verdict is Verdict.RESTORED:
        blocks = with_kernels(scene, split(len(scene.frame), block_rows))
        psfs = _side_by_side(blocks)
        latent = stitched(view, blocks, settings)
    return uniform.finished(view, latent, psfs, verdict, started)


def split(rows: int, block_rows: int | None) -> list[tuple[int, int]]:
    """Blocks of equal height over all scanlines, neighbours overlapping by about half."""
    height = min(rows, max(SHORTEST, round(rows / SHARE)) if block_rows is None else block_rows)
    count = 1 + -(-2 * (rows - height) // height)
    return [(first, first + height) for first in np.linspace(0, rows - height, count).round().astype(int).tolist()]


def with_kernels(scene: Scene, spans: list[tuple[int, int]]) -> list[Block]:
    """The blocks' kernels; one too poor in texture has that of the nearest block that is not."""
    part = windowed(scene).frame
    images = [np.ascontiguousarray(part[first:last]) for first, last in spans]
    power = [gradient_power(image) for image in images]
    floor = min(scene.least_texture, max(power))
    rich = [i for i, p in enumerate(power) if p >= floor]
    kernels = dict(zip(rich, threads.each(lambda i: fitted(images[i], uniform.SIZES, uniform.KERNELS), rich), strict=True))
    nearest = [min(rich, key=lambda i, b=b: abs(i - b)) for b in range(len(spans))]
    return [Block(first=first, last=last, kernel=kernels[i]) for (first, last), i in zip(spans, nearest, strict=True)]


def stitched(view: View, blocks: list[Block], settings: Settings) -> Float[np.ndarray, "rows cols channels"]:
    """Every block restored, moved onto its neighbours, and blended by weights that fall linearly to its ends.

    The place of the whole, which nothing determines, is that of the block in the middle.
    """
    pixels, clipped = view.pixels, view.clipped
    rows = len(pixels)
    spans = [block.surroundings(rows) for block in blocks]
    latents = [
        uniform.deconvolved(pixels[span], clipped[span], block.kernel, settings, view.noise)
        for span, block in zip(spans, blocks, strict=True)
    ]
    steps = [np.zeros(2)]
    for (above, one, a), (below, other, b) in pairwise(zip(spans, latents, blocks, strict=True)):
        common = slice(below.start, above.stop)
        parts = [luminance(part[common.start - span.start : common.stop - span.start]) for span, part in ((above, one), (below, other))]
        steps.append(displacement(parts[0], parts[1], max(len(a.kernel), len(b.kernel)) / 2))
    shifts = np.cumsum(steps, axis=0)
    shifts -= shifts[len(blocks) // 2]
    image, total = np.zeros_like(pixels), np.zeros((rows, 1, 1), np.float32)
    for span, latent, block, shift in zip(spans, latents, blocks, shifts, strict=True):
        lines = np.arange(block.first, block.last)
        weight = np.minimum(lines - block.first + 1, block.last - lines).astype(np.float32)[:, None, None]
        image[lines] += weight * moved(latent, -shift)[lines - span.start]
        total[lines] += weight
    return image / total


def displacement(one: Float[np.ndarray, "rows cols"], other: Float[np.ndarray, "rows cols"], most: float) -> Float[np.ndarray, "2"]:
    """How far (x, y) the content of `other` lies from that of `one`, at most `most` px: phase correlation, then Gauss-Newton.

    Differences far above the rest, where the two restorations hardly show the same, count little in the end. In linear light:
    a tone curve moves an edge whose two versions are not equally sharp.
    """
    window = np.outer(np.hanning(len(one) + 2)[1:-1], np.hanning(one.shape[1] + 2)[1:-1]).astype(np.float32)
    start = np.array(cv2.phaseCorrelate(one, other, window)[0])
    candidates = [np.zeros(2), start] if np.abs(start).max() <= most else [np.zeros(2)]
    best = min(candidates, key=lambda s: float((window * np.abs(moved(other, -s) - one)).sum()))
    gy, gx = np.gradient(one)
    shift, weight = best, window
    for step in range(2 * REFINEMENTS):
        difference = moved(other, -shift) - one
        if step == REFINEMENTS:
            power = window * (gx * gx + gy * gy)
            weight = window / (
                1 + difference**2 / (OUTLIER * (power * difference**2).sum() / (power.sum() + _TINY_POWER) + _TINY_DIFFERENCE)
            )
        normal = np.array([[(weight * a * b).sum() for b in (gx, gy)] for a in (gx, gy)])
        right = np.array([(weight * a * difference).sum() for a in (gx, gy)])
        shift = shift - np.linalg.solve(normal + (_RIDGE * np.trace(normal) + _LEAST_RIDGE) * np.eye(2), right)
    return shift if np.abs(shift - best).max() < WANDERED else best


def moved(image: np.ndarray, shift: Float[np.ndarray, "2"]) -> np.ndarray:
    """The image with its content moved by (x, y), by cubic splines; (rows, cols) or (rows, cols, channels)."""
    along = (shift[1], shift[0], 0)[: image.ndim]
    return scipy.ndimage.shift(image, along, order=3, mode="nearest") if shift.any() else image


def _side_by_side(blocks: list[Block]) -> Float[np.ndarray, "blocks 1 k k"]:
    size = max(len(block.kernel) for block in blocks)
    return np.stack([np.pad(block.kernel, (size - len(block.kernel)) // 2) for block in blocks])[:, None]
