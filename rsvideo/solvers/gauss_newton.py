"""Damped Gauss-Newton, Eq. (9)-(13): a step is taken only if the objective falls."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

DAMPING = 1e-3  # at first, relative to the diagonal
TRIES = 8  # of a step, each damped more
FACTOR = 10  # by which damping rises where a step fails, and falls where it succeeds
LEAST_DAMPING = 1e-9
LEAST_DIAGONAL = 1e-12  # of the normal matrix, relative to its largest
_LEAST_NORMAL = 1e-300  # where all of the normal matrix is 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Quadratic:
    """A sum of squares about one point: half its value, its gradient J^T r and its normal matrix J^T J."""

    value: float
    gradient: Float[np.ndarray, " n"]
    normal: Float[np.ndarray, "n n"]


@dataclass(frozen=True, kw_only=True, eq=False)
class Step:
    """An accepted point."""

    theta: Float[np.ndarray, " n"]
    objective: float
    damping: float
    change: float  # by how much the objective fell, relative to what it was


def quadratic(residual: np.ndarray, jacobian: Float[np.ndarray, " n *m"]) -> Quadratic:
    """The quadratic of |r|^2 / 2 whose derivative in unknown i is jacobian[i]; sums run in double precision."""
    r = residual.ravel()
    J = jacobian.reshape(len(jacobian), -1)
    return Quadratic(value=0.5 * float(np.sum(r * r, dtype=float)), gradient=(J @ r).astype(float), normal=(J @ J.T).astype(float))


def gauss_newton(
    objective: Callable[[np.ndarray], float],
    linearise: Callable[[np.ndarray], Quadratic],
    start: Float[np.ndarray, " n"],
    *,
    damping: float = DAMPING,
    tries: int = TRIES,
) -> Iterator[Step]:
    """Levenberg's and Marquardt's damping, relative to the diagonal; ends where no try lowers the objective."""
    theta = start
    value = objective(theta)
    yield Step(theta=theta, objective=value, damping=damping, change=math.inf)
    while True:
        q = linearise(theta)
        scale = np.maximum(np.diag(q.normal), LEAST_DIAGONAL * max(np.diag(q.normal).max(), _LEAST_NORMAL))
        for _ in range(tries):
            step = -np.linalg.solve(q.normal + damping * np.diag(scale), q.gradient)  # Eq. (12)
            tried = objective(theta + step)
            if tried < value:
                break
            damping *= FACTOR
        else:
            return
        theta = theta + step  # Eq. (11)
        change, value, damping = (value - tried) / value, tried, max(damping / FACTOR, LEAST_DAMPING)
        yield Step(theta=theta, objective=value, damping=damping, change=change)
