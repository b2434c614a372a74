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

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, no_type_check

import cv2
import numpy as np
from jaxtyping import Complex, Float

from rsvideo.physics import tiles
from rsvideo.physics.row_fourier import RowFourier
from rsvideo.physics.tiles import Tile
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration import device_frame
from rsvideo.restoration.blurred_frame import Eliminated
from rsvideo.restoration.nonblind import TileSystem, tile_system
from rsvideo.restoration.parallax import displacements
from rsvideo.restoration.scene import Scene
from rsvideo.solvers.banded import BandedFactor
from rsvideo.threads import loop, spread

WINDOW = 49  # px over which gradients are compared; origin: by trial
FAINT = 1e-4  # gradients below this are flat, white being 1
BORDER = 10, 12  # rows and columns along the frame's sides, and each tile's, that are not measured; origin: by trial
HALF_WEIGHT = 0.5  # times the frame's mean gradient power: where the local power is as small, a pixel counts half; origin: by trial
FLOOR = 0.01  # of rho, added to the normal matrix's diagonal, which keeps it positive definite where no scanline samples it
COMPLETIONS = 2  # solves for the latent image, between which the columns beyond the frame are completed from the model


def _box(image: np.ndarray) -> np.ndarray:
    return cv2.boxFilter(image, -1, (WINDOW, WINDOW), borderType=cv2.BORDER_CONSTANT)


@dataclass(frozen=True, kw_only=True, eq=False)
class Region:
    """What is measured of pictures: all of one, or of several on a GPU, (tiles, rows, cols), the gradients that lie in each."""

    box: Callable[[Any], Any] = _box
    inside: Any = None  # (tiles, rows - 1, cols - 1), 1 or 0; None: all

    def gradients(self, image: Any) -> tuple[Any, Any]:
        """Along the columns and along the rows, with one row and column less."""
        corner = image[..., :-1, :-1]
        gx, gy = image[..., :-1, 1:] - corner, image[..., 1:, :-1] - corner
        return (gx, gy) if self.inside is None else (gx * self.inside, gy * self.inside)

    def area(self, power: Any) -> Any:
        """The weight of the window about each pixel."""
        return self.box(np.ones_like(power) if self.inside is None else self.inside)


WHOLE = Region()


def texture_weight(frame: Float[Any, "*tiles rows cols"], typical: float, region: Region = WHOLE) -> Float[Any, "*tiles r c"]:
    """The weight w of each pixel: near 1 where the blurred frame has gradients worth measuring."""
    gx, gy = region.gradients(frame)
    power = gx**2 + gy**2
    local = region.box(power) / region.area(power)
    weight = local / (local + HALF_WEIGHT * typical)
    return weight if region.inside is None else weight * region.inside


def _local_power(power: Any, region: Region) -> tuple[Any, Any, Any]:
    """|grad l|, the weight of the window about each pixel, and the mean of |grad l|^2 over it."""
    area = region.area(power)
    return np.sqrt(power + FAINT**2), area, region.box(power) / area + FAINT**2


def sparsity(
    latent: Float[Any, "*tiles rows cols"], weight: Float[Any, "*tiles r c"], region: Region = WHOLE
) -> tuple[Float[Any, "*tiles"], Float[Any, "*tiles rows cols"]]:
    """sum w |grad l| / rms_local(grad l), and its derivative in l. The weight has one row and column less."""
    gx, gy = region.gradients(latent)
    magnitude, area, local = _local_power(gx * gx + gy * gy, region)
    scale = 1 / np.sqrt(local)
    value = (weight * magnitude * scale).sum(axis=(-2, -1))
    by_power = weight * scale / magnitude - region.box(weight * magnitude * scale / local / area)  # twice df / d power
    gradient = np.zeros_like(latent)
    for g, target in ((by_power * gx, np.s_[..., :-1, 1:]), (by_power * gy, np.s_[..., 1:, :-1])):
        gradient[target] += g
        gradient[..., :-1, :-1] -= g
    return value, gradient


@no_type_check
@loop()
def _sensitivity(first, last, m, mx, latent, lx, top, left, offsets, least, greatest, residual, km, out):
    """<dK m, r> - <K m, dK l> for a unit displacement of each path sample, by linear interpolation.

    Path samples lie close together: the products at whole displacements serve all samples about them.
    """
    cols, samples = residual.shape[1], offsets.shape[1]
    for i in range(first, last):
        leftmost, lowest = least[i, 0], least[i, 1]
        wide, high = greatest[i, 0] - leftmost + 2, greatest[i, 1] - lowest + 2
        summed = np.zeros((high, wide), np.bool_)
        plain = np.empty((high, wide), np.float32)  # <m, r> - <K m, l> of the scanline at a whole displacement
        slope = np.empty((high, wide), np.float32)  # and with the derivatives of m and l along rows
        for k in range(samples):
            fx, fy = np.floor(offsets[i, k, 0]), np.floor(offsets[i, k, 1])
            ax, ay = np.float32(offsets[i, k, 0] - fx), np.float32(offsets[i, k, 1] - fy)
            bx, by = 1 - ax, 1 - ay
            v, u = int(fy) - lowest, int(fx) - leftmost
            for y in range(v, v + 2):
                for x in range(u, u + 2):
                    if not summed[y, x]:
                        row, columns = i + top + lowest + y, slice(left + leftmost + x, left + leftmost + x + cols)
                        mi, mxi, li, lxi = m[row, columns], mx[row, columns], latent[row, columns], lx[row, columns]
                        p = np.float32(0)
                        s = np.float32(0)
                        for j in range(cols):
                            p += mi[j] * residual[i, j] - li[j] * km[i, j]
                            s += mxi[j] * residual[i, j] - lxi[j] * km[i, j]
                        summed[y, x], plain[y, x], slope[y, x] = True, p, s
            above, below = bx * slope[v, u] + ax * slope[v, u + 1], bx * slope[v + 1, u] + ax * slope[v + 1, u + 1]
            out[i, k, 0] = (by * above + ay * below) / samples
            out[i, k, 1] = (bx * (plain[v + 1, u] - plain[v, u]) + ax * (plain[v + 1, u + 1] - plain[v, u + 1])) / samples


def _derivative_along_rows(op: RowFourier, spectrum: Complex[np.ndarray, "n frequencies"]) -> Float[np.ndarray, "n period"]:
    return op.image(spectrum * (2j * np.pi / op.period * np.arange(op.frequencies)).astype(np.complex64))


def _latent(system: TileSystem, ridge: float) -> tuple[BandedFactor, np.ndarray, np.ndarray, np.ndarray]:
    """M's factor, the frame completed beyond its columns, l = M^-1 K^H b as a spectrum, and K l."""
    op, factor = system.op, system.factor(ridge, FLOOR * ridge)
    data, again = system.completed(), 1
    while True:
        latent = factor.solve(op.adjoint(op.spectrum(data)))
        blurred = op.image(op.forward(latent))
        if again == COMPLETIONS:
            return factor, data, latent, blurred
        data, again = system.complete(blurred), again + 1


def _measured(op: RowFourier) -> tuple[tuple[slice, slice], tuple[slice, slice]]:
    """The part of a tile, in the frame and in the latent image, that is measured."""
    down, across = BORDER
    rows, cols = slice(down, op.rows - down), slice(across, op.cols - across)
    return (rows, cols), (slice(op.top + rows.start, op.top + rows.stop), slice(op.left + cols.start, op.left + cols.stop))


def _tile_objective(
    system: TileSystem, offsets: Float[np.ndarray, "rows samples 2"], typical: float, ridge: float
) -> tuple[float, float, Float[np.ndarray, "rows samples 2"]]:
    """sum w |grad l| / rms, sum w, and the derivative of the first in every path sample's displacement."""
    op = system.op
    factor, data, latent, blurred = _latent(system, ridge)
    image = op.image(latent)
    in_frame, in_latent = _measured(op)
    weight = texture_weight(system.frame[in_frame], typical)
    value, gradient = sparsity(image[in_latent], weight)
    slope = np.zeros_like(image)
    slope[in_latent] = gradient
    m = factor.solve(op.spectrum(slope))  # m = M^-1 f'(l)
    km = op.image(op.forward(m))
    columns = slice(op.left, op.left + op.cols)
    out = np.empty(offsets.shape, np.float32)
    spread(
        _sensitivity,
        len(out),
        op.image(m),
        _derivative_along_rows(op, m),
        image,
        _derivative_along_rows(op, latent),
        op.top,
        op.left,
        offsets,
        np.floor(offsets.min(axis=1)).astype(int),
        offsets.max(axis=1).astype(int),
        np.ascontiguousarray((data - blurred)[:, columns]),
        np.ascontiguousarray(km[:, columns]),
        out,
    )
    return float(value), float(weight.sum()), out


def _tiles(scene: Scene, trajectory: Trajectory) -> Iterator[tuple[Tile, Float[np.ndarray, "rows samples 2"]]]:
    """The scene's tiles, each with the displacements of its path samples."""
    count = 1 if trajectory.coefficients.shape[1] == 2 and not scene.flow else scene.tiles
    cut = scene.cut(count)
    yield from zip(cut, displacements(cut, trajectory, scene.flow, scene.camera, scene.samples), strict=True)


def _system(scene: Scene, tile: Tile, offsets: Float[np.ndarray, "rows samples 2"]) -> TileSystem:
    """A tile's system."""
    return tile_system(offsets, scene.frame[:, tile.columns], scene.valid[:, tile.columns])


def _on_device(scene: Scene, cut: list[tuple[Tile, Float[np.ndarray, "rows samples 2"]]], ridge: float) -> Eliminated:
    """The latent images of all tiles, on a GPU."""
    parts = [np.s_[:, tile.columns] for tile, _ in cut]
    return device_frame.eliminated(
        np.stack([offsets for _, offsets in cut]),
        [scene.frame[part] for part in parts],
        [scene.valid[part] for part in parts],
        ridge=ridge,
        floor=FLOOR * ridge,
        completions=COMPLETIONS,
    )


def _objectives(
    scene: Scene, trajectory: Trajectory, ridge: float
) -> Iterator[tuple[Tile, tuple[float, float, Float[np.ndarray, "rows samples 2"]]]]:
    """What `_tile_objective` answers of each tile, computed by the scene's device."""
    typical = scene.gradient_power
    if scene.device == "cpu":
        for tile, offsets in _tiles(scene, trajectory):
            yield tile, _tile_objective(_system(scene, tile, offsets), offsets, typical, ridge)
        return
    cut = list(_tiles(scene, trajectory))
    solved = _on_device(scene, cut, ridge)
    inner, region = _measured_there(solved)
    weight = texture_weight(solved.frames[inner], typical, region)
    value, solved.slopes[inner] = sparsity(solved.images[inner], weight, region)
    sums = (device_frame.to_host(total).tolist() for total in (value, weight.sum(axis=(-2, -1))))
    for (tile, _), value_of, weight_of, by_sample in zip(cut, *sums, solved.derivative(), strict=True):
        yield tile, (value_of, weight_of, by_sample)


def _measured_there(solved: Eliminated) -> tuple[tuple[slice, ...], Region]:
    """The part of tiles on a GPU that is measured, and what of it lies in each."""
    sides = zip(BORDER, solved.frames.shape[1:], strict=True)
    inner = (slice(None), *(slice(border, side - border) for border, side in sides))
    shape = solved.frames[inner].shape
    wide = [width - 2 * BORDER[1] - 1 for width in solved.widths]
    return inner, Region(box=partial(device_frame.box, window=WINDOW), inside=device_frame.inside(wide, shape[1] - 1, shape[2] - 1))


def _relative_gradients(
    scene: Scene, trajectory: Trajectory, ridge: float, power: float
) -> Iterator[tuple[Tile, Float[np.ndarray, "r c"], Float[np.ndarray, "r c"]]]:
    """`relative_gradients` of each tile, computed by the scene's device."""
    typical = scene.gradient_power
    if scene.device == "cpu":
        for tile, offsets in _tiles(scene, trajectory):
            system = _system(scene, tile, offsets)
            in_frame, in_latent = _measured(system.op)
            latent = system.op.image(_latent(system, ridge)[2])
            yield tile, *relative_gradients(latent[in_latent], system.frame[in_frame], typical, power)
        return
    cut = list(_tiles(scene, trajectory))
    solved = _on_device(scene, cut, ridge)
    inner, region = _measured_there(solved)
    measured = relative_gradients(solved.images[inner], solved.frames[inner], typical, power, region)
    for (tile, _), value, weight in zip(cut, *map(device_frame.to_host, measured), strict=True):
        yield tile, value, weight


def objective(scene: Scene, trajectory: Trajectory, ridge: float) -> tuple[float, Float[np.ndarray, "terms axes"]]:
    """f(theta), about 0.5 to 0.8, and its derivative in the trajectory's coefficients."""
    axes = trajectory.coefficients.shape[1]
    trajectory = scene.scaled(trajectory)
    lens, timing = scene.camera.intrinsics, scene.camera.timing
    basis = trajectory.basis(timing.sample_times(scene.samples))
    value, total, gradient = 0.0, 0.0, np.zeros_like(trajectory.coefficients)
    for tile, (v, w, by_sample) in _objectives(scene, trajectory, ridge):
        value += v
        total += w
        lever = tiles.levers(tile, lens, timing.rows, axes)
        gradient += np.tensordot(basis, by_sample @ lever, axes=((0, 1), (0, 1)))
    return value / total, gradient * scene.unit(axes) / total


def value(scene: Scene, trajectory: Trajectory, ridge: float) -> float:
    """f(theta) alone."""
    total, weight = density(scene, trajectory, ridge)
    return float(total.sum() / weight.sum())


def density(
    scene: Scene, trajectory: Trajectory, ridge: float, power: float = 1.0
) -> tuple[Float[np.ndarray, "rows cols"], Float[np.ndarray, "rows cols"]]:
    """What each pixel adds to the numerator of f(theta), w (|grad l| / rms)^power, and its weight w; 0 where f is not measured."""
    trajectory = scene.scaled(trajectory)
    value, weight = np.zeros(scene.frame.shape, np.float32), np.zeros(scene.frame.shape, np.float32)
    down, across = BORDER
    for tile, of_value, of_weight in _relative_gradients(scene, trajectory, ridge, power):
        columns = slice(tile.first + across, tile.last - across - 1)
        place, part = np.s_[down : len(value) - down - 1, columns], np.s_[:, : columns.stop - columns.start]
        value[place], weight[place] = of_value[part], of_weight[part]
    return value, weight


def relative_gradients(
    latent: Float[Any, "*tiles rows cols"], frame: Float[Any, "*tiles rows cols"], typical: float, power: float, region: Region = WHOLE
) -> tuple[Float[Any, "*tiles r c"], Float[Any, "*tiles r c"]]:
    """w (|grad l| / rms_local(grad l))^power of each pixel, and w; both have one row and column less. `typical` is as in texture_weight."""
    gx, gy = region.gradients(latent)
    magnitude, _, local = _local_power(gx**2 + gy**2, region)
    weight = texture_weight(frame, typical, region)
    return weight * (magnitude / np.sqrt(local)) ** power, weight
