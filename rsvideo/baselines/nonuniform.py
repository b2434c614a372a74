"""One density of camera poses for the whole frame, under a global shutter, blind.

The poses are shifts and roll (Gupta et al., ECCV 2010): with a telephoto lens yaw and pitch are shifts, and only roll
blurs a frame's corners otherwise than its middle. The latent image has sparse gradients (Xu, Zheng & Jia, CVPR 2013).
Over overlapping patches the kernel is linear in the density w, k_c = B_c w, so that the patches' correlations A_c, c_c of
strong gradients add up to one non-negative quadratic program, sum_c w^T B_c^T A_c B_c w - 2 c_c^T B_c w. It starts from the
uniform kernel, which is found coarse to fine.
"""

import time
from dataclasses import dataclass

import cv2
import numpy as np
import scipy.ndimage
import scipy.sparse
from jaxtyping import Float

from rsvideo import threads
from rsvideo.baselines import uniform
from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics import tiles
from rsvideo.physics.camera import Intrinsics, turned
from rsvideo.physics.tiles import Tile
from rsvideo.restoration import nonblind
from rsvideo.restoration.blind_kernel import (
    KernelSettings,
    Observation,
    correlations,
    fitted,
    observation,
    simplex_program,
    strong_gradients,
)
from rsvideo.restoration.scanlines import View
from rsvideo.restoration.scene import Scene, scene_of
from rsvideo.restoration.settings import Settings

DOWN, ACROSS = 3, 4  # patches, each overlapping its neighbours by half
FARTHEST_PATCH = 0.7  # of the frame's half diagonal: no patch's middle lies farther from the frame's
ROLL_STEP = 1.0  # px at the frame's corner between neighbouring rolls
ROLL_REACH = 6  # rolls on either side of none
LARGEST = 800  # px; a larger frame's density is estimated on a smaller picture
TOLERANCE = 0.25  # px, a tile's error at its edge
MOST = 1000  # poses whose weights are sought at once
LIKELY = 1.0  # poses, of the Gaussian by which poses next to the density are ranked
GRID = 3  # PSFs down and across that are reported
_EDGE = 1.001  # px; a position farther inside than this has a next pixel to be interpolated with
_SMALLEST = 8  # px, either side of a reduced picture
DENSITY = KernelSettings(  # origin: by trial
    ridge=0.1, sparsity=1.0, last_sparsity=0.5, finest_steps=6, floor=0.03
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Density:
    """How much of the exposure the camera spent in each pose of a grid; the slice without roll is the middle's kernel."""

    weights: Float[np.ndarray, "rolls k k"]  # sum 1; rolls and k are odd, no pose is in the middle
    roll_step: float  # rad

    def poses(self) -> Float[np.ndarray, "n 3"]:
        """The poses (x, y, roll) that have a weight, in px and rad."""
        roll, y, x = np.nonzero(self.weights)
        rolls, size, _ = self.weights.shape
        return np.stack([size // 2 - x, size // 2 - y, (roll - rolls // 2) * self.roll_step], axis=-1).astype(float)

    def values(self) -> Float[np.ndarray, " n"]:
        """Their weights."""
        return self.weights[np.nonzero(self.weights)]


def restored(view: View, settings: Settings) -> FrameResult:
    """The latent image of a frame under one density of poses."""
    started = time.monotonic()
    scene = scene_of(view, settings)
    latent = psfs = None
    verdict = uniform.verdict_before(scene)
    if verdict is Verdict.RESTORED:
        full = min(1.0, LARGEST / max(scene.frame.shape))
        kernel = fitted(_resized(scene.frame, full), uniform.SIZES, uniform.KERNELS)
        density = estimate(scene, full, kernel)
        psfs = grid(density, view.camera.intrinsics)
        latent = uniform.solved(tiled_frame(view, density), settings, view.noise)
    return uniform.finished(view, latent, psfs, verdict, started)


def estimate(scene: Scene, full: float, kernel: Float[np.ndarray, "k k"]) -> Density:
    """The density of the frame, grown from the uniform kernel of the frame at scale `full`: each alternation frees the poses around."""
    lens = _scaled(scene.camera.intrinsics, full)
    weights = np.zeros((2 * ROLL_REACH + 1, *kernel.shape), np.float32)
    weights[ROLL_REACH] = kernel
    start = Density(weights=weights, roll_step=ROLL_STEP / float(np.hypot(lens.cols, lens.rows) / 2))
    density = refined(_resized(scene.frame, full), lens, start)
    return resampled(density, 1 / full, 1.0, 1) if full < 1 else density


def refined(image: Float[np.ndarray, "rows cols"], lens: Intrinsics, density: Density) -> Density:
    """The density after some alternations with the patches' sharp gradients."""
    patches = _patches(lens, density)
    observations = threads.each(lambda p: observation(np.ascontiguousarray(image[p.rows, p.cols]), p.size), patches)
    steps, fall = DENSITY.finest_steps, DENSITY.last_sparsity / DENSITY.sparsity
    for step in range(steps):
        share = DENSITY.sparsity * fall ** ((step + 1) / steps)
        free = _near(density)
        maps = [kernels_from(free, lens, p.x, p.y, p.size) for p in patches]
        start = density.weights[np.nonzero(free.weights)]

        def system(one: tuple[Patch, Observation, scipy.sparse.csr_array], share: float = share, start: np.ndarray = start) -> tuple:
            patch, observed, B = one
            kernel = (B @ start).reshape(patch.size, patch.size)
            edges = strong_gradients(observed, kernel / kernel.sum(), share * observed.mean_square, DENSITY)
            A, c, zero = correlations(observed.gradients, edges, patch.size)
            return B.T @ (B.T @ A).T, B.T @ c, zero  # A is symmetric

        parts = threads.each(system, zip(patches, observations, maps, strict=True))
        Q, c, zero = sum(p[0] for p in parts), sum(p[1] for p in parts), sum(p[2] for p in parts)
        Q, c = np.asarray(Q, np.float32) / np.float32(zero), np.asarray(c, np.float32) / np.float32(zero)
        Q[np.diag_indices(len(Q))] += DENSITY.ridge
        weights = np.zeros_like(density.weights)
        weights[np.nonzero(free.weights)] = simplex_program(Q, c)
        density = _clean(Density(weights=weights, roll_step=density.roll_step))
    return density


@dataclass(frozen=True, kw_only=True)
class Patch:
    """A part of the frame under one kernel, that of its middle."""

    rows: slice
    cols: slice
    x: float
    y: float
    size: int  # of its kernel


def _patches(lens: Intrinsics, density: Density) -> list[Patch]:
    rolls, size, _ = density.weights.shape
    turn = (rolls // 2) * density.roll_step * float(np.hypot(lens.rows, lens.cols)) / 2
    side = size + 2 * int(np.ceil(FARTHEST_PATCH * turn)) + 2
    spans = []
    for length, count in ((lens.rows, DOWN), (lens.cols, ACROSS)):
        extent = min(length, max(round(2 * length / (count + 1)), 2 * side))
        spans.append([slice(int(a), int(a) + extent) for a in np.linspace(0, length - extent, count)])
    middle = lambda s: (s.start + s.stop - 1) / 2  # noqa: E731
    return [Patch(rows=r, cols=c, x=middle(c), y=middle(r), size=side) for r in spans[0] for c in spans[1]]


def kernels_from(density: Density, lens: Intrinsics, x: float, y: float, size: int) -> scipy.sparse.csr_array:
    """B: from the weights of the density's poses to the kernel at pixel (x, y), by bilinear splats."""
    poses = density.poses()
    count = len(poses)
    moved = turned(lens, np.full(count, x), np.full(count, y), poses)
    at = np.clip(size // 2 - moved, 0, size - _EDGE)  # what a pixel samples at +d blurs towards -d
    first = np.floor(at).astype(int)
    part = at - first
    rows, values = [], []
    for i, wy in ((0, 1 - part[:, 1]), (1, part[:, 1])):
        for j, wx in ((0, 1 - part[:, 0]), (1, part[:, 0])):
            rows.append((first[:, 1] + i) * size + first[:, 0] + j)
            values.append(wy * wx)
    columns = np.tile(np.arange(count), 4)
    return scipy.sparse.csr_array((np.concatenate(values).astype(np.float32), (np.concatenate(rows), columns)), shape=(size * size, count))


def grid(density: Density, lens: Intrinsics) -> Float[np.ndarray, "down across k k"]:
    """The kernels over the frame."""
    size = _patches(lens, density)[0].size
    xs, ys = ((np.arange(GRID) + 0.5) * n / GRID - 0.5 for n in (lens.cols, lens.rows))
    values = density.values()
    return np.array([[(kernels_from(density, lens, x, y, size) @ values).reshape(size, size) for x in xs] for y in ys])


def tiled_frame(view: View, density: Density) -> nonblind.TiledFrame:
    """The frame whose scanlines sample the latent image in all poses of the density."""
    rows, cols = view.pixels.shape[:2]
    poses, values = density.poses(), density.values()
    turn = float(np.ptp(poses[:, 2]))
    count = int(np.clip(np.ceil(cols * turn / (4 * TOLERANCE)), 1, max(1, cols // tiles.NARROWEST)))
    shape = (rows, len(poses))
    everywhere, weights = np.broadcast_to(poses, (*shape, 3)), np.broadcast_to(values, shape)
    y = np.broadcast_to(np.arange(rows, dtype=float)[:, None], shape)

    def samples(tile: Tile) -> tuple[np.ndarray, np.ndarray]:
        return turned(view.camera.intrinsics, np.full(shape, tile.middle), y, everywhere), weights

    cut = tiles.split(cols, count, nonblind.OVERLAP)
    return nonblind.tiled_from(cut, samples, view.pixels, view.clipped)


def resampled(density: Density, ratio: float, roll_ratio: float, ring: int) -> Density:
    """The density on a grid `ratio` times as fine in px and `roll_ratio` times in roll, with `ring` poses of room."""
    rolls, size, _ = density.weights.shape
    new = [2 * int(np.ceil(n // 2 * r)) + 1 + 2 * ring for n, r in ((rolls, roll_ratio), (size, ratio), (size, ratio))]
    axes = [(np.arange(n) - n // 2) / r + o // 2 for n, r, o in zip(new, (roll_ratio, ratio, ratio), (rolls, size, size), strict=True)]
    weights = scipy.ndimage.map_coordinates(density.weights, np.meshgrid(*axes, indexing="ij"), order=1, mode="constant").astype(np.float32)
    return Density(weights=weights / weights.sum(), roll_step=density.roll_step / roll_ratio)


def _near(density: Density) -> Density:
    """1 at the poses that have a weight, and next to them as long as they are not too many."""
    held = density.weights > 0
    near = scipy.ndimage.binary_dilation(held, np.ones((3, 3, 3)))
    likely = np.where(held, 1, scipy.ndimage.gaussian_filter(density.weights, LIKELY)) * near
    if np.count_nonzero(likely) > MOST:
        likely *= likely >= np.partition(likely, -MOST, axis=None)[-MOST]
    return Density(weights=(likely > 0).astype(np.float32), roll_step=density.roll_step)


def _clean(density: Density) -> Density:
    """Without its noise floor, of sum 1, its centroid in the middle."""
    w = np.where(density.weights >= DENSITY.floor * density.weights.max(), density.weights, 0)
    middle = (np.array(w.shape) - 1) / 2
    shift = np.round(middle - np.array(scipy.ndimage.center_of_mass(w))).astype(int)
    w = scipy.ndimage.shift(w, shift, order=0, mode="constant")
    return Density(weights=(w / w.sum()).astype(np.float32), roll_step=density.roll_step)


def _resized(image: Float[np.ndarray, "rows cols"], scale: float) -> Float[np.ndarray, "r c"]:
    return image if scale == 1 else cv2.resize(image, _size(image.shape, scale)[::-1], interpolation=cv2.INTER_AREA)


def _scaled(lens: Intrinsics, scale: float) -> Intrinsics:
    return lens.scaled(*_size((lens.rows, lens.cols), scale))


def _size(shape: tuple[int, ...], scale: float) -> tuple[int, int]:
    return max(_SMALLEST, round(shape[0] * scale)), max(_SMALLEST, round(shape[1] * scale))
