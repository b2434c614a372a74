"""A local minimum of f, the sparsity of the restored picture, or a local maximum of the focus, under a prior on the trajectory."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.optimize import OptimizeResult, minimize

from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.focus import focus
from rsvideo.restoration.scene import Scene
from rsvideo.restoration.sparsity import objective

SCALE = 100.0  # what L-BFGS is handed f times, since its first step is as long as the gradient; origin: by trial
TOLERANCE = 1e-5  # relative fall of the objective that ends L-BFGS
SPARSE = 0.5  # times f, which counts beside a still's focus: the greatest focus alone lies aside of the truth by part of a px; 0.1 to 1
# are alike on half of a corpus of photographs
SPARE = 6  # evaluations beyond one a step, for line searches


@runtime_checkable
class Belief(Protocol):
    """What is believed of the coefficients but the constants, whatever the picture's sparsity says."""

    def at(self, coefficients: Float[np.ndarray, "terms axes"]) -> tuple[float, Float[np.ndarray, "terms axes"]]:
        """The penalty and its derivative."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class Prior:
    """What is believed of the coefficients but the constants before the frame is used: weight * d^T curvature d about a mean."""

    mean: Float[np.ndarray, "terms axes"]
    curvature: Float[np.ndarray, "unknowns unknowns"]
    weight: float

    def at(self, coefficients: Float[np.ndarray, "terms axes"]) -> tuple[float, Float[np.ndarray, "terms axes"]]:
        """The penalty and its derivative."""
        d = (coefficients - self.mean).ravel()
        slope = self.weight * (self.curvature @ d)
        return float(d @ slope), 2 * slope.reshape(coefficients.shape)


@dataclass(frozen=True, kw_only=True, eq=False)
class Refined:
    """A local minimum of f, and how it was reached."""

    trajectory: Trajectory
    value: float  # f(theta) and the prior
    moved: float  # px, RMS over the interval, from the start
    evaluations: int
    values: tuple[float, ...]  # after each step


def refine(scene: Scene, start: Trajectory, prior: Belief, *, ridge: float, steps: int) -> Refined:
    """Minimise f(theta) + prior(theta) from `start` by L-BFGS; the constant terms are a gauge and stay."""
    return _descended(scene, start, prior, lambda path: objective(scene, path, ridge), steps)


def focused(scene: Scene, start: Trajectory, prior: Belief, *, steps: int) -> Refined:
    """Minimise prior(theta) - s(theta) + SPARSE f(theta) likewise, s being restoration.focus, which prefers no short paths as f does."""

    def blurred(path: Trajectory) -> tuple[float, np.ndarray]:
        value, slope = focus(scene, path, SPARSE)
        return -value, -slope

    return _descended(scene, start.with_coefficients(_still(start.coefficients)), prior, blurred, steps)


def _still(coefficients: Float[np.ndarray, "terms axes"]) -> Float[np.ndarray, "terms axes"]:
    """Without the constant terms."""
    return np.vstack([0 * coefficients[:1], coefficients[1:]])


def _descended(scene: Scene, start: Trajectory, prior: Belief, of: Callable[[Trajectory], tuple[float, np.ndarray]], steps: int) -> Refined:
    terms, axes = start.coefficients[1:].shape
    unit = np.ones(axes)
    unit[2:] = scene.scale / scene.camera.intrinsics.fx  # px to rad

    def unpacked(z: np.ndarray) -> Trajectory:
        return start.with_coefficients(np.vstack([start.coefficients[:1], z.reshape(terms, axes) * unit]))

    values: list[float] = []

    def watched(intermediate_result: OptimizeResult) -> None:
        values.append(float(intermediate_result.fun) / SCALE)

    def penalised(z: np.ndarray) -> tuple[float, np.ndarray]:
        trajectory = unpacked(z)
        value, gradient = of(trajectory)
        penalty, slope = prior.at(trajectory.coefficients[1:])
        return SCALE * (value + penalty), SCALE * ((gradient[1:] + slope) * unit).ravel()

    options = {"maxiter": steps, "maxfun": steps + SPARE, "ftol": TOLERANCE}
    z = (start.coefficients[1:] / unit).ravel()
    found = minimize(penalised, z, jac=True, method="L-BFGS-B", options=options, callback=watched)
    trajectory = unpacked(found.x)
    return Refined(
        trajectory=trajectory,
        value=float(found.fun) / SCALE,
        moved=float(np.linalg.norm((trajectory.coefficients - start.coefficients)[1:, :2])),
        evaluations=int(found.nfev),
        values=tuple(values),
    )
