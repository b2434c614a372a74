"""Conjugate gradients: symmetric positive definite systems given by their products with an array."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from rsvideo.solvers.operator import LinearOperator


@dataclass(frozen=True, kw_only=True, eq=False)
class Solve:
    """One step of conjugate gradients."""

    x: np.ndarray
    change: float  # the residual's norm, relative to the right side's


@dataclass(frozen=True, kw_only=True, eq=False)
class NormalMatrix:
    """scale K^T W K + rho D^T D + eps I."""

    blur: LinearOperator  # K
    gradient: LinearOperator  # D
    rho: float
    scale: float = 1.0
    weights: np.ndarray | None = None  # the diagonal of W; without it W = I
    eps: float = 0.0

    def __call__(self, x: np.ndarray) -> np.ndarray:
        """The product with x."""
        blurred = self.blur.forward(x)
        if self.weights is not None:
            blurred = self.weights * blurred
        return self.scale * self.blur.adjoint(blurred) + self.rho * self.gradient.adjoint(self.gradient.forward(x)) + self.eps * x


def conjugate_gradient(normal: Callable[[np.ndarray], np.ndarray], rhs: np.ndarray, start: np.ndarray) -> Iterator[Solve]:
    """Hestenes and Stiefel's method for normal(x) = rhs; ends where the residual vanishes."""
    scale = math.sqrt(float(np.vdot(rhs, rhs))) or 1.0
    x = start
    r = rhs - normal(x)
    p = r
    rr = float(np.vdot(r, r))
    yield Solve(x=x, change=math.sqrt(rr) / scale)
    while rr > 0:
        q = normal(p)
        alpha = rr / float(np.vdot(p, q))
        x = x + alpha * p
        r = r - alpha * q
        before, rr = rr, float(np.vdot(r, r))
        p = r + (rr / before) * p
        yield Solve(x=x, change=math.sqrt(rr) / scale)
