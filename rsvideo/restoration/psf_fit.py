"""From the kernels of strips to one trajectory: a direct fit of rendered PSFs.

Each strip's kernel is explained by the path's pieces over the exposures of its rows, splatted with a Gaussian that
narrows from coarse to fine. A strip sees its own wobble as a shift of its latent image, so each scanline's piece is
taken about its own centroid and the whole has one free shift a strip. Overlapping exposures of neighbouring strips
determine the direction of time. Strips of the left and right halves of the frame tell roll from yaw and pitch.
"""

from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float
from numba import njit

from rsvideo import threads
from rsvideo.physics.camera import Camera, lever
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, still
from rsvideo.restoration.hand_shake import pose_unit, shake_spread

ROWS_PER_STRIP = 5  # scanlines whose PSFs stand for a strip
SAMPLES = 16  # path samples an exposure
ROUNDS = ((4.0, 12, 24), (2.5, 12, 12), (1.5, 15, 8), (1.0, 15, 8))  # Gaussian's sigma in px, steps, paths kept; origin: by trial
DOUBTED_AT = 1.5  # px; after the round of this sigma, kernels that the best path explains badly count less
STEP = 1.5  # grid points a sigma, at most one a px
DISTINCT = 0.3  # px; paths whose coefficients differ by less are one
FAILED = 2.5  # times the median length; a longer kernel has failed, and counts but FAILED_WEIGHT at first; origin: by trial
FAILED_WEIGHT = 0.1  # beside 1.1 of the others
LEFT_OUT = 0.05  # weight of the strip that a fit does without
FAIR = 0.5  # times the median residual, which a strip's own is compared with; origin: by trial
DAMPING, LEAST_DAMPING, MOST_DAMPING = 1e-2, 1e-6, 1e4  # of Levenberg-Marquardt: at first, at least, and where it gives up
DAMPING_FALL, DAMPING_RISE = 0.3, 5  # its factors after a step that lowers the energy, and after one that does not
SETTLED = 1e-4  # relative fall of the energy that ends it; these six are compiled in
ROUGHNESS = 0.05  # of the fit of the first velocities, against their own fit, times (degree / P)^2; origin: by trial
_FAINT_ROW, _FAINT = 1e-7, 1e-9  # weights of a Gaussian's row and of its points, below which they are passed over
_DIAGONAL = 1e-9  # added to the normal matrix: a coefficient that nothing depends on stays
_LEAST_RESIDUAL = 1e-12  # strips that are explained exactly divide by this
_SHIFT_RIDGE = 1e-12  # of the strips' own shifts, which are eliminated
_LAG = 1e-4  # of the interval, half of the difference by which a basis is differentiated
KEPT = 4  # paths that a fit hands on; origin: by trial


@dataclass(frozen=True, kw_only=True, eq=False)
class Strip:
    """A run of scanlines, or a part of their columns, and the kernel that deblurs them best."""

    first: int
    last: int  # exclusive
    middle: float  # the column that the strip stands for
    kernel: Float[np.ndarray, "k k"]  # sum 1, centred

    def rows(self) -> Float[np.ndarray, " scanlines"]:
        """The scanlines that stand for the strip."""
        return self.first + (np.arange(ROWS_PER_STRIP) + 0.5) * (self.last - self.first) / ROWS_PER_STRIP

    def times(self, timing: ShutterTiming) -> Float[np.ndarray, "scanlines samples"]:
        """Their sample times."""
        return self.rows()[:, None] * timing.row_time + (np.arange(SAMPLES) + 0.5) * (timing.exposure / SAMPLES)


@no_type_check
@njit(cache=True, fastmath=True)
def _render(points, design, grid, sigma, image, jacobian):
    """Add Gaussians at `points` (n, 2) to `image` (g, g) and their derivative in the unknowns to `jacobian`."""
    g = len(grid)
    unknowns = design.shape[1]
    ex = np.empty(g)
    ey = np.empty(g)
    norm = 1.0 / len(points)
    for n in range(len(points)):
        px, py = points[n, 0], points[n, 1]
        for a in range(g):
            ex[a] = np.exp(-0.5 * ((grid[a] - px) / sigma) ** 2)
            ey[a] = np.exp(-0.5 * ((grid[a] - py) / sigma) ** 2)
        for a in range(g):
            dy = (grid[a] - py) / (sigma * sigma)
            wy = ey[a] * norm
            if wy < _FAINT_ROW:
                continue
            for b in range(g):
                w = wy * ex[b]
                if w < _FAINT:
                    continue
                dx = w * (grid[b] - px) / (sigma * sigma)
                image[a, b] += w
                for q in range(unknowns):  # the point lies at minus the pose
                    jacobian[q, a, b] -= dx * design[n, q, 0] + w * dy * design[n, q, 1]
                jacobian[unknowns, a, b] += dx
                jacobian[unknowns + 1, a, b] += w * dy


@no_type_check
@njit(cache=True, fastmath=True)
def _system(x, design, targets, weights, grid, sigma, prior, normal, gradient):
    """Weighted energy of all strips, and its Gauss-Newton system in the unknowns x: z, then a shift for each strip."""
    strips, points, unknowns, _ = design.shape
    g = len(grid)
    energy = 0.0
    at = np.empty((points, 2))
    image = np.empty((g, g))
    jacobian = np.empty((unknowns + 2, g, g))
    index = np.arange(unknowns + 2)
    row = np.empty(unknowns + 2)
    for s in range(strips):
        for n in range(points):
            for a in range(2):
                v = x[unknowns + 2 * s + a]
                for q in range(unknowns):
                    v -= design[s, n, q, a] * x[q]
                at[n, a] = v
        image[:] = 0
        jacobian[:] = 0
        _render(at, design[s], grid, sigma, image, jacobian)
        index[unknowns] = unknowns + 2 * s
        index[unknowns + 1] = unknowns + 2 * s + 1
        for a in range(g):
            for b in range(g):
                r = image[a, b] - targets[s, a, b]
                energy += weights[s] * r * r
                for i in range(unknowns + 2):
                    row[i] = jacobian[i, a, b]
                for i in range(unknowns + 2):
                    gradient[index[i]] += weights[s] * row[i] * r
                    for j in range(i + 1):
                        normal[index[i], index[j]] += weights[s] * row[i] * row[j]
    for i in range(len(gradient)):
        for j in range(i):
            normal[j, i] = normal[i, j]
    for q in range(unknowns):
        energy += prior[q] * x[q] ** 2
        normal[q, q] += prior[q]
        gradient[q] += prior[q] * x[q]
    return energy


@no_type_check
@njit(cache=True, fastmath=True)
def _solved(A, b):
    """A^-1 b by Cholesky's L L^T = A, in place; LAPACK's compiled wrapper would take 10 s to compile."""
    n = len(b)
    for j in range(n):
        for k in range(j):
            A[j, j] -= A[j, k] * A[j, k]
            b[j] -= A[j, k] * b[k]
        A[j, j] = np.sqrt(A[j, j])
        b[j] /= A[j, j]
        for i in range(j + 1, n):
            for k in range(j):
                A[i, j] -= A[i, k] * A[j, k]
            A[i, j] /= A[j, j]
    for j in range(n - 1, -1, -1):
        for i in range(j + 1, n):
            b[j] -= A[i, j] * b[i]
        b[j] /= A[j, j]
    return b


@no_type_check
@threads.loop()
def _levenberg(first, last, found, design, targets, weights, grid, sigma, prior, steps, energies):
    """Levenberg-Marquardt from every start; `found` (starts, unknowns + 2 * strips) holds the starts, and then where they lead."""
    size = found.shape[1]
    for s in range(first, last):
        x = found[s].copy()
        damping = DAMPING
        normal = np.zeros((size, size))
        gradient = np.zeros(size)
        energy = _system(x, design, targets, weights, grid, sigma, prior, normal, gradient)
        for _ in range(steps):
            damped = normal.copy()
            for i in range(size):
                damped[i, i] += damping * normal[i, i] + _DIAGONAL
            x_next = x - _solved(damped, gradient.copy())
            normal_next = np.zeros((size, size))
            gradient_next = np.zeros(size)
            energy_next = _system(x_next, design, targets, weights, grid, sigma, prior, normal_next, gradient_next)
            if energy_next < energy:
                done = energy - energy_next < SETTLED * energy
                x, energy, normal, gradient = x_next, energy_next, normal_next, gradient_next
                damping = max(damping * DAMPING_FALL, LEAST_DAMPING)
                if done:
                    break
            else:
                damping *= DAMPING_RISE
                if damping > MOST_DAMPING:
                    break
        found[s] = x
        energies[s] = energy


def length(kernel: Float[np.ndarray, "k k"]) -> float:
    """The length of the straight uniform segment whose variance is the kernel's largest."""
    return float(np.linalg.norm(_main_axis(kernel)))


def reach(strips: list[Strip]) -> float:
    """The typical length of one exposure's path, px."""
    return float(np.median([length(s.kernel) for s in strips]))


def _main_axis(kernel: Float[np.ndarray, "k k"]) -> Float[np.ndarray, "2"]:
    u = np.arange(len(kernel)) - len(kernel) // 2
    y, x = np.meshgrid(u, u, indexing="ij")
    mean = np.array([(kernel * x).sum(), (kernel * y).sum()])
    xx, yy, xy = (kernel * x * x).sum() - mean[0] ** 2, (kernel * y * y).sum() - mean[1] ** 2, (kernel * x * y).sum() - mean[0] * mean[1]
    values, vectors = np.linalg.eigh(np.array([[xx, xy], [xy, yy]]))
    return vectors[:, 1] * np.sqrt(12 * max(values[1], 0))  # a uniform segment has variance L^2 / 12


@dataclass(frozen=True, kw_only=True, eq=False)
class Candidate:
    """A trajectory and how badly it explains the strips' kernels, relative to their energy."""

    energy: float
    trajectory: Polynomial
    curvature: Float[np.ndarray, "unknowns unknowns"]  # of the energy there, in the coefficients but the constants
    stiffness: float  # of the prior on a hand's motion that it was found with


@dataclass(frozen=True, kw_only=True, eq=False)
class _Problem:
    """The strips' kernels convolved with a Gaussian of `sigma`, and the PSFs that explain them, linear in z up to their splatting."""

    design: Float[np.ndarray, "strips points unknowns 2"]  # of z: coefficients in units of their spread
    targets: Float[np.ndarray, "strips g g"]
    grid: Float[np.ndarray, " g"]  # px
    sigma: float  # px

    @property
    def unknowns(self) -> int:
        """Coefficients but the constants; behind them, x holds two shifts a strip."""
        return self.design.shape[2]

    def of_strip(self, x: np.ndarray, strip: int) -> tuple[float, np.ndarray]:
        """One strip's energy relative to its kernel's, and its Gauss-Newton matrix in (z, its shift)."""
        n = self.unknowns
        normal = np.zeros((n + 2, n + 2))
        energy = _system(
            np.concatenate([x[:n], x[n + 2 * strip : n + 2 * strip + 2]]),
            self.design[strip : strip + 1],
            self.targets[strip : strip + 1],
            np.ones(1),
            self.grid,
            self.sigma,
            np.zeros(n),
            normal,
            np.zeros(n + 2),
        )
        return float(energy / (self.targets[strip] ** 2).sum()), normal

    def trust(self, x: np.ndarray, believed: Float[np.ndarray, " strips"]) -> Float[np.ndarray, " strips"]:
        """Weights of sum 1 that fall where a strip's kernel is explained much worse than the others."""
        residuals = np.array([self.of_strip(x, s)[0] for s in range(len(self.design))])
        weights = 1 / (residuals + FAIR * np.median(residuals) + _LEAST_RESIDUAL)
        trusted = believed * (weights / weights.sum())
        return trusted / trusted.sum()

    def curvature(self, x: np.ndarray, weights: Float[np.ndarray, " strips"], prior: float) -> Float[np.ndarray, "unknowns unknowns"]:
        """The Gauss-Newton matrix of the energy in z, every strip's shift eliminated."""
        n = self.unknowns
        total = prior * np.eye(n)
        for s in range(len(self.design)):
            normal = self.of_strip(x, s)[1]
            cross = normal[:n, n:]
            total += weights[s] * (normal[:n, :n] - cross @ np.linalg.solve(normal[n:, n:] + _SHIFT_RIDGE * np.eye(2), cross.T))
        return total


def fit(
    strips: list[Strip],
    camera: Camera,
    *,
    degree: int,
    stiffness: float,
    keep: int = KEPT,
    start: Polynomial | None = None,
    doubting: bool = False,
    without: int | None = None,
) -> list[Candidate]:
    """Distinct trajectories that explain the strips' kernels, best first.

    Without a start: two axes, from every choice of signs of the strips' velocities. With one: its axes, from there,
    `doubting` from the beginning the kernels that disagree with it. The strip `without` is left out.
    """
    timing, axes = camera.timing, 2 if start is None else start.coefficients.shape[1]
    spread = (shake_spread(degree, timing)[:, None] * reach(strips) * pose_unit(camera.intrinsics, axes)).ravel()
    design = _design(strips, camera, degree, axes) * spread[:, None]  # unknowns in units of their spread
    z = _starts(strips, timing, degree) if start is None else start.coefficients[1:].reshape(1, -1)
    x = np.hstack([z / spread, np.zeros((len(z), 2 * len(strips)))])
    believed = np.array([LEFT_OUT if i == without else 1.0 for i in range(len(strips))])
    weights = _first_weights(strips, believed)
    energies, scale = np.zeros(len(x)), 1.0
    rounds = ROUNDS if start is None else ROUNDS[1:]
    problems = [_problem(strips, design, sigma) for sigma, _, _ in rounds]
    for problem, (sigma, steps, kept) in zip(problems, rounds, strict=True):
        if doubting:
            weights = problem.trust(x[0], believed)
        scale = float(weights @ (problem.targets**2).sum(axis=(1, 2)))
        prior = np.full(len(spread), stiffness * scale)
        energies = np.empty(len(x))
        threads.spread(_levenberg, len(x), x, problem.design, problem.targets, weights, problem.grid, sigma, prior, steps, energies)
        best = _distinct(x[:, : len(spread)], spread, energies, kept)
        x, energies = x[best], energies[best] / scale
        if sigma == DOUBTED_AT:
            weights = problem.trust(x[0], believed)
    curve = still(timing.interval, degree=degree, axes=axes)
    return [
        Candidate(
            energy=float(e),
            trajectory=curve.with_coefficients(np.vstack([np.zeros((1, axes)), (c[: len(spread)] * spread).reshape(degree, axes)])),
            curvature=problems[-1].curvature(c, weights, stiffness * scale) / scale / np.outer(spread, spread),
            stiffness=stiffness,
        )
        for e, c in zip(energies[:keep], x[:keep], strict=True)
    ]


def _design(strips: list[Strip], camera: Camera, degree: int, axes: int) -> Float[np.ndarray, "strips points unknowns 2"]:
    """How each coefficient but the constants moves each path sample, about its scanline's own mean."""
    curve = still(camera.timing.interval, degree=degree, axes=axes)
    out = []
    for strip in strips:
        basis = curve.basis(strip.times(camera.timing))[..., 1:]
        basis -= basis.mean(axis=1, keepdims=True)
        rows = strip.rows()
        levers = lever(camera.intrinsics, np.full(len(rows), strip.middle), rows, axes)
        out.append(np.einsum("rkp,rca->rkpac", basis, levers).reshape(-1, degree * axes, 2))
    return np.array(out)


def _starts(strips: list[Strip], timing: ShutterTiming, degree: int) -> Float[np.ndarray, "starts unknowns"]:
    """Paths whose velocity at each strip's middle has the kernel's main axis and length, under every choice of signs."""
    axes = [_main_axis(strip.kernel) / timing.exposure for strip in strips]
    t = np.array([strip.times(timing).mean() for strip in strips])
    curve, h = still(timing.interval, degree=degree, axes=2), _LAG * timing.interval[1]
    rate = (curve.basis(t + h) - curve.basis(t - h))[:, 1:] / (2 * h)
    roughness = np.diag([ROUGHNESS * np.linalg.norm(rate) / len(t) * (p / degree) ** 2 for p in range(degree)])
    starts = []
    for signs in range(2 ** len(strips)):
        v = np.array([a * (1 if signs >> i & 1 else -1) for i, a in enumerate(axes)])
        c = np.linalg.lstsq(np.vstack([rate, roughness]), np.vstack([v, np.zeros((degree, 2))]), rcond=None)[0]
        starts.append(c.ravel())
    return np.array(starts)


def _first_weights(strips: list[Strip], believed: Float[np.ndarray, " strips"]) -> Float[np.ndarray, " strips"]:
    """Of the strips before any path is found, of sum 1: a kernel far longer than the others has failed."""
    lengths = np.array([length(s.kernel) for s in strips])
    weights = believed * ((lengths < FAILED * np.median(lengths)) + FAILED_WEIGHT)
    return weights / weights.sum()


def _problem(strips: list[Strip], design: np.ndarray, sigma: float) -> _Problem:
    """The kernels convolved with a Gaussian, in the scale of `_render`, on a grid that holds them; the kernel's centre is 0."""
    half = max(len(s.kernel) for s in strips) // 2
    step = max(1.0, sigma / STEP)
    n = int(np.ceil((half + 2 * sigma) / step))
    grid = np.arange(-n, n + 1) * step
    targets = []
    for strip in strips:
        u = np.arange(len(strip.kernel)) - len(strip.kernel) // 2
        e = np.exp(-0.5 * ((grid[:, None] - u[None]) / sigma) ** 2)
        targets.append(e @ strip.kernel @ e.T)
    return _Problem(design=design, targets=np.array(targets), grid=grid, sigma=sigma)


def _distinct(z: Float[np.ndarray, "paths unknowns"], spread: np.ndarray, energies: Float[np.ndarray, " paths"], most: int) -> list[int]:
    """The best paths, of those that are nearly the same the best one."""
    kept: list[int] = []
    for i in np.argsort(energies):
        if all(np.abs((z[i] - z[j]) * spread).max() > DISTINCT for j in kept):
            kept.append(int(i))
        if len(kept) == most:
            break
    return kept
