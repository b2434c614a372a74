"""The trajectory that makes the restored image sparsest, with the latent image eliminated.

The paper alternates between latent image and trajectory (Algorithm 1, Eq. 9-13). That alternation converges slowly,
since the latent image absorbs the trajectory's error, and drifts away from the truth even when started there. Here the
latent image is a function of the trajectory, l(theta) = argmin |K(theta) l - b|^2 + rho |D l|^2, solved exactly, and the
trajectory minimises a measure of l(theta) alone:

    f(theta) = sum_x w |grad l| / rms_local(grad l),

the mean gradient relative to its root mean square over a window: small where edges are few and strong, large where a
wrong path leaves blur or ringing. The local scale makes it independent of contrast, as Krishnan et al. (CVPR 2011) do
for a whole image, and of the picture's changing texture, which misleads every stationary model.

Its gradient is exact up to interpolation (adjoint method). With M = K^H K + rho D^T D, l = M^-1 K^H b, r = b - K l and
m = M^-1 f'(l):  df = <m, dK^H r> - <m, K^H dK l> = <dK m, r> - <K m, dK l>.
"""

import math
from dataclasses import dataclass, replace
from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Complex, Float
from numba import njit, prange
from numpy.lib.stride_tricks import sliding_window_view
from scipy.optimize import OptimizeResult, minimize

from rsvideo.physics import tiles
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.row_fourier import RowFourier
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.nonblind import TileSystem, tile_system, total_variation

WINDOW = 49  # px over which gradients are compared
FAINT = 1e-4  # gradients below this are flat
PLAIN_NOISE = 5e-3  # up to which total variation has the paper's last weight, 1e-3
BLOCK = 32  # px; noise is measured in the quieter blocks


@dataclass(frozen=True, kw_only=True, eq=False)
class Scene:
    """What the trajectory is estimated from: a grey frame and the camera that wrote it, along its scanlines."""

    frame: Float[np.ndarray, "rows cols"]  # linear light, normalised so that its bright parts are 1
    valid: Float[np.ndarray, "rows cols"]  # 0 where clipped
    timing: ShutterTiming
    intrinsics: Intrinsics
    samples: int  # K, per exposure
    tiles: int  # for three axes
    noise: float  # standard deviation
    scale: float = 1.0  # of the frame; paths stay in px of the frame before it was made smaller

    def unit(self, axes: int) -> Float[np.ndarray, " axes"]:
        """What a pose is multiplied with in this frame: (x, y) or (x, y, roll)."""
        return np.array([self.scale, self.scale, 1])[:axes]

    def seen(self, trajectory: Trajectory) -> Trajectory:
        """The path in px of this frame."""
        return trajectory.with_coefficients(trajectory.coefficients * self.unit(trajectory.coefficients.shape[1]))

    @property
    def gradient_power(self) -> float:
        """Mean square of the frame's gradients."""
        return float((np.diff(self.frame, axis=1) ** 2).mean() + (np.diff(self.frame, axis=0) ** 2).mean())

    @property
    def ridge(self) -> float:
        """rho: the noise's power over that of the latent gradients, of which the blurred frame keeps about a third."""
        return float(np.clip(0.7 * self.noise**2 / max(self.gradient_power, 1e-12), 1.5e-3, 0.1))


def halved(scene: Scene) -> Scene:
    """The same at half the resolution."""
    rows, cols = (n // 2 for n in scene.frame.shape)
    frame, valid = (cv2.resize(a[: 2 * rows, : 2 * cols], (cols, rows), interpolation=cv2.INTER_AREA) for a in (scene.frame, scene.valid))
    c = scene.intrinsics
    return Scene(
        frame=frame,
        valid=np.floor(valid),  # where one of four is clipped, the whole is
        timing=replace(scene.timing, row_time=2 * scene.timing.row_time, rows=rows),
        intrinsics=replace(c, fx=c.fx / 2, fy=c.fy / 2, cx=c.cx / 2 - 0.25, cy=c.cy / 2 - 0.25, rows=rows, cols=cols),
        samples=math.ceil(scene.samples / 2),
        tiles=max(1, round(scene.tiles / 2)),
        noise=noise_level(frame),
        scale=scene.scale / 2,
    )


def noise_level(frame: Float[np.ndarray, "rows cols"]) -> float:
    """Standard deviation of the noise in the quieter blocks: the larger of its fine part and of its coarse, isotropic part."""
    return max(_fine_noise(frame), _coarse_noise(frame))


def _fine_noise(frame: Float[np.ndarray, "rows cols"]) -> float:
    """From second differences (Immerkaer 1996, by blocks)."""
    mask = np.outer([1, -2, 1], [1, -2, 1]).astype(np.float32) / 6
    high = cv2.filter2D(frame, -1, mask)[2:-2, 2:-2]
    blocks = [high[i : i + BLOCK, j : j + BLOCK] for i in range(0, high.shape[0], BLOCK) for j in range(0, high.shape[1], BLOCK)]
    return float(np.percentile([np.median(np.abs(b)) / 0.6745 for b in blocks], 25))


def _coarse_noise(frame: Float[np.ndarray, "rows cols"]) -> float:
    """From wavelengths of 3 to 6 px, which a camera's own denoising and JPEG leave grainy and deblurring amplifies most.

    Texture is there too, but blurred texture has a direction: what counts is the least of eight, less where they differ.
    """
    blocks = sliding_window_view(frame, (BLOCK, BLOCK))[:: BLOCK // 2, :: BLOCK // 2].reshape(-1, BLOCK, BLOCK)
    if not len(blocks):
        return 0.0
    window = np.outer(np.hanning(BLOCK), np.hanning(BLOCK))
    spectra = np.abs(np.fft.rfft2((blocks - blocks.mean(axis=(1, 2), keepdims=True)) * window)) ** 2 / (window**2).sum()
    y, x = np.fft.fftfreq(BLOCK)[:, None], np.fft.rfftfreq(BLOCK)
    ring = (np.hypot(x, y) > 1 / 6) & (np.hypot(x, y) < 1 / 3)
    sector = np.round(np.arctan2(y, x) * 8 / np.pi).astype(int) % 8
    power = [np.percentile(spectra[:, ring & (sector == s)].mean(axis=1), 10) for s in range(8)]
    return float(np.sqrt(min(power)) * min(power) / max(*power, 1e-12))


def _box(image: np.ndarray) -> np.ndarray:
    return cv2.boxFilter(image, -1, (WINDOW, WINDOW), borderType=cv2.BORDER_CONSTANT)


def texture_weight(frame: Float[np.ndarray, "rows cols"], typical: float) -> Float[np.ndarray, "r c"]:
    """The weight w of each pixel: near 1 where the blurred frame has gradients worth measuring."""
    power = np.diff(frame, axis=1)[:-1] ** 2 + np.diff(frame, axis=0)[:, :-1] ** 2
    local = _box(power) / _box(np.ones_like(power))
    return local / (local + 0.5 * typical)


def sparsity(latent: Float[np.ndarray, "rows cols"], weight: Float[np.ndarray, "r c"]) -> tuple[float, Float[np.ndarray, "rows cols"]]:
    """sum w |grad l| / rms_local(grad l), and its derivative in l. The weight has one row and column less."""
    gx, gy = latent[:-1, 1:] - latent[:-1, :-1], latent[1:, :-1] - latent[:-1, :-1]
    power = gx * gx + gy * gy
    magnitude = np.sqrt(power + FAINT**2)
    area = _box(np.ones_like(power))
    local = _box(power) / area + FAINT**2
    scale = 1 / np.sqrt(local)
    value = float((weight * magnitude * scale).sum())
    by_power = weight * scale / magnitude - _box(weight * magnitude * scale / local / area)  # twice df / d power
    gradient = np.zeros_like(latent)
    for g, target in ((by_power * gx, np.s_[:-1, 1:]), (by_power * gy, np.s_[1:, :-1])):
        gradient[target] += g
        gradient[:-1, :-1] -= g
    return value, gradient


@no_type_check
@njit(cache=True, fastmath=True, parallel=True)
def _sensitivity(m, mx, latent, lx, top, left, offsets, residual, km, out):
    """<dK m, r> - <K m, dK l> for a unit displacement of each path sample, by linear interpolation."""
    rows, cols = residual.shape
    samples = offsets.shape[1]
    for i in prange(rows):
        for k in range(samples):
            fx, fy = np.floor(offsets[i, k, 0]), np.floor(offsets[i, k, 1])
            ax, ay = np.float32(offsets[i, k, 0] - fx), np.float32(offsets[i, k, 1] - fy)
            bx, by = 1 - ax, 1 - ay
            y = i + top + int(fy)
            x = left + int(fx)
            m0, m1 = m[y, x : x + cols + 1], m[y + 1, x : x + cols + 1]
            l0, l1 = latent[y, x : x + cols + 1], latent[y + 1, x : x + cols + 1]
            mx0, mx1 = mx[y, x : x + cols + 1], mx[y + 1, x : x + cols + 1]
            lx0, lx1 = lx[y, x : x + cols + 1], lx[y + 1, x : x + cols + 1]
            sx = np.float32(0)
            sy = np.float32(0)
            for j in range(cols):
                dm = by * (bx * mx0[j] + ax * mx0[j + 1]) + ay * (bx * mx1[j] + ax * mx1[j + 1])
                dl = by * (bx * lx0[j] + ax * lx0[j + 1]) + ay * (bx * lx1[j] + ax * lx1[j + 1])
                sx += dm * residual[i, j] - dl * km[i, j]
                dm = bx * (m1[j] - m0[j]) + ax * (m1[j + 1] - m0[j + 1])
                dl = bx * (l1[j] - l0[j]) + ax * (l1[j + 1] - l0[j + 1])
                sy += dm * residual[i, j] - dl * km[i, j]
            out[i, k, 0] = sx / samples
            out[i, k, 1] = sy / samples


def _derivative_along_rows(op: RowFourier, spectrum: Complex[np.ndarray, "n frequencies"]) -> Float[np.ndarray, "n period"]:
    return op.image(spectrum * (2j * np.pi / op.period * np.arange(op.frequencies)).astype(np.complex64))


def _tile_objective(
    system: TileSystem, offsets: Float[np.ndarray, "rows samples 2"], typical: float, ridge: float
) -> tuple[float, float, Float[np.ndarray, "rows samples 2"]]:
    """sum w |grad l| / rms, sum w, and the derivative of the first in every path sample's displacement."""
    op = system.op
    factor = system.normal.plus(1, system.roughness(ridge, 0.01 * ridge), ridge).factor()
    data, latent = system.completed, op.spectrum(np.zeros((op.latent_rows, op.period), np.float32))
    blurred = data
    for turn in range(2):  # the columns beyond the frame are completed from the model
        data = system.complete(blurred) if turn else system.completed
        latent = factor.solve(op.adjoint(op.spectrum(data)))  # l = M^-1 K^H b
        blurred = op.image(op.forward(latent))
    image = op.image(latent)
    rows, cols = op.rows, op.cols
    inside = (slice(10, rows - 10), slice(12, cols - 12))
    own = (slice(op.top + 10, op.top + rows - 10), slice(op.left + 12, op.left + cols - 12))
    weight = texture_weight(system.frame[inside], typical)
    value, gradient = sparsity(image[own], weight)
    seen = np.zeros_like(image)
    seen[own] = gradient
    m = factor.solve(op.spectrum(seen))
    km = op.image(op.forward(m))
    columns = slice(op.left, op.left + cols)
    out = np.empty(offsets.shape, np.float32)
    _sensitivity(
        op.image(m),
        _derivative_along_rows(op, m),
        image,
        _derivative_along_rows(op, latent),
        op.top,
        op.left,
        offsets,
        np.ascontiguousarray((data - blurred)[:, columns]),
        np.ascontiguousarray(km[:, columns]),
        out,
    )
    return value, float(weight.sum()), out


def objective(scene: Scene, trajectory: Trajectory, ridge: float) -> tuple[float, Float[np.ndarray, "terms axes"]]:
    """f(theta), about 0.5 to 0.8, and its derivative in the trajectory's coefficients."""
    axes = trajectory.coefficients.shape[1]
    trajectory = scene.seen(trajectory)
    basis = trajectory.basis(scene.timing.sample_times(scene.samples))
    value, total, gradient = 0.0, 0.0, np.zeros_like(trajectory.coefficients)
    count = 1 if axes == 2 else scene.tiles
    for tile in tiles.split(scene.intrinsics.cols, count, 0):
        offsets = tiles.displacement(tile, trajectory, scene.intrinsics, scene.timing, scene.samples)
        columns = slice(tile.first, tile.last)
        system = tile_system(offsets, scene.frame[:, columns], scene.valid[:, columns])
        v, w, by_sample = _tile_objective(system, offsets, scene.gradient_power, ridge)
        value += v
        total += w
        lever = tiles.levers(tile, scene.intrinsics, scene.timing.rows, axes)
        gradient += np.tensordot(basis, by_sample @ lever, axes=((0, 1), (0, 1)))
    return value / total, gradient * scene.unit(axes) / total


def turned(trajectory: Trajectory) -> Trajectory:
    """The same path across itself: by a right angle, with the same roll."""
    coefficients = trajectory.coefficients.copy()
    coefficients[:, :2] = trajectory.coefficients[:, 1::-1] * (-1, 1)
    return trajectory.with_coefficients(coefficients)


def energy(scene: Scene, trajectory: Trajectory) -> float:
    """The paper's objective (Eq. 8) at its minimum over the latent image, a pixel's mean; mu rises with the noise's power."""
    mu = 1e-3 * float(np.clip((scene.noise / PLAIN_NOISE) ** 2, 1, 10))
    count = 1 if trajectory.coefficients.shape[1] == 2 else scene.tiles
    total = pixels = 0.0
    trajectory = scene.seen(trajectory)
    for tile in tiles.split(scene.intrinsics.cols, count, 0):
        columns = slice(tile.first, tile.last)
        offsets = tiles.displacement(tile, trajectory, scene.intrinsics, scene.timing, scene.samples)
        system = tile_system(offsets, scene.frame[:, columns], scene.valid[:, columns])
        op = system.op
        latent = total_variation(system, mu, steps=25)
        blurred = op.image(op.forward(op.spectrum(latent)))[:, op.left : op.left + op.cols]
        down, across = min(8, op.rows // 4), min(16, op.cols // 4)
        away = np.s_[down : op.rows - down, across : op.cols - across]  # from the borders
        residual = (system.valid * (blurred - system.frame))[away]
        inside = system.crop(latent)[away]
        variation = np.abs(np.diff(inside, axis=0)).mean() + np.abs(np.diff(inside, axis=1)).mean()
        total += residual.size * float(0.5 * np.mean(residual**2) + mu * variation)
        pixels += residual.size
    return total / pixels


@dataclass(frozen=True, kw_only=True, eq=False)
class Refined:
    """A local minimum of f, and how it was reached."""

    trajectory: Trajectory
    value: float  # f(theta) and the prior
    moved: float  # px, RMS over the interval, from the start
    evaluations: int
    values: tuple[float, ...]  # after each step


@dataclass(frozen=True, kw_only=True, eq=False)
class Prior:
    """What is known of the coefficients but the constants before looking at the frame: weight * d^T curvature d about a mean."""

    mean: Float[np.ndarray, "terms axes"]
    curvature: Float[np.ndarray, "unknowns unknowns"]
    weight: float

    def at(self, coefficients: Float[np.ndarray, "terms axes"]) -> tuple[float, Float[np.ndarray, "terms axes"]]:
        """The penalty and its derivative."""
        d = (coefficients - self.mean).ravel()
        slope = self.weight * (self.curvature @ d)
        return float(d @ slope), 2 * slope.reshape(coefficients.shape)


def refine(scene: Scene, start: Trajectory, prior: Prior, *, ridge: float, steps: int) -> Refined:
    """Minimise f(theta) + prior(theta) from `start` by L-BFGS; the constant terms are a gauge and stay."""
    terms, axes = start.coefficients[1:].shape
    unit = np.ones(axes)
    unit[2:] = scene.scale / scene.intrinsics.fx  # px to rad

    def unpacked(z: np.ndarray) -> Trajectory:
        return start.with_coefficients(np.vstack([start.coefficients[:1], z.reshape(terms, axes) * unit]))

    values: list[float] = []

    def watched(intermediate_result: OptimizeResult) -> None:
        values.append(float(intermediate_result.fun) / 100)

    def penalised(z: np.ndarray) -> tuple[float, np.ndarray]:
        trajectory = unpacked(z)
        value, gradient = objective(scene, trajectory, ridge)
        penalty, slope = prior.at(trajectory.coefficients[1:])
        return 100 * (value + penalty), 100 * ((gradient[1:] + slope) * unit).ravel()

    options = {"maxiter": steps, "maxfun": steps + 6, "ftol": 1e-5}
    z = (start.coefficients[1:] / unit).ravel()
    found = minimize(penalised, z, jac=True, method="L-BFGS-B", options=options, callback=watched)
    trajectory = unpacked(found.x)
    return Refined(
        trajectory=trajectory,
        value=float(found.fun) / 100,
        moved=float(np.linalg.norm((trajectory.coefficients - start.coefficients)[1:, :2])),
        evaluations=int(found.nfev),
        values=tuple(values),
    )
