"""How a lens bends rays: OpenCV's Brown-Conrady and fisheye models, forwards, backwards and their derivative.

A point (u, v) is where a ray pierces the plane z = 1 before the camera. D takes the point of the true ray to the point through which
a pinhole camera of the same focal length would show it at the same pixel; U is its inverse.
"""

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Literal, no_type_check

import numpy as np
from jaxtyping import Float
from numpy.polynomial import Polynomial

COEFFICIENTS = {"brown-conrady": (4, 5, 8, 12), "fisheye": (4,)}  # as OpenCV counts them
WIDEST = math.radians(80)  # off the axis; farther out, points of the plane z = 1 run away
_TERMS = 12  # k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4
_NODES = 513  # of the radial table from which the inverse starts
_ROUNDS = 8  # of Newton's method; from the table it needs two or three
_CLOSE = 1e-8  # on the plane z = 1; the step that follows squares it
_AXIS = 1e-30  # on the plane z = 1, squared: keeps the axis itself from dividing by nothing
_REAL = 1e-9  # part of a root that may be imaginary: rounding makes real double roots complex

Model = Literal["brown-conrady", "fisheye"]


@dataclass(frozen=True, kw_only=True)
class Distortion:
    """A lens's distortion, with OpenCV's coefficients: k1 k2 p1 p2 [k3 [k4 k5 k6 [s1 s2 s3 s4]]], or a fisheye's k1 k2 k3 k4."""

    model: Model
    coefficients: tuple[float, ...]

    def __post_init__(self) -> None:
        counts = COEFFICIENTS[self.model]
        if len(self.coefficients) not in counts:
            raise ValueError(f"{self.model} has {' or '.join(map(str, counts))} coefficients, got {len(self.coefficients)}")
        if not all(math.isfinite(c) for c in self.coefficients):
            raise ValueError(f"the coefficients of a distortion must be finite, got {', '.join(f'{c:g}' for c in self.coefficients)}")

    def distorted(self, u: Float[np.ndarray, "*n"], v: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
        """D: where the rays of the points (u, v) are shown."""
        return np.stack(self._bent(u, v)[:2], axis=-1)

    def slopes(self, u: Float[np.ndarray, "*n"], v: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2 2"]:
        """The derivative of D."""
        return np.stack(self._bent(u, v)[2:], axis=-1).reshape(*u.shape, 2, 2)

    def undistorted(self, u: Float[np.ndarray, "*n"], v: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
        """U: the points of the true rays that are shown at (u, v), by Newton's method; what no ray reaches is not finite or not met."""
        true, shown = self._table
        radius = np.hypot(u, v)
        with np.errstate(all="ignore"):
            scale = np.where(radius > 0, np.interp(radius, shown, true) / np.where(radius > 0, radius, 1), 1)
            a, b = u * scale, v * scale
            for _ in range(_ROUNDS):
                x, y, xa, xb, ya, yb = self._bent(a, b)
                x, y, determinant = x - u, y - v, xa * yb - xb * ya
                a, b = a - (yb * x - xb * y) / determinant, b - (xa * y - ya * x) / determinant
                if max(np.abs(x).max(initial=0), np.abs(y).max(initial=0)) < _CLOSE:
                    break
        return np.stack([a, b], axis=-1)

    @cached_property
    def reach(self) -> float:
        """The angle in rad off the axis, at most WIDEST, up to which the radial terms show a ray farther out where it lies farther out."""
        c, s = self.terms, Polynomial([0.0, 1.0])
        if self.model == "fisheye":
            rising = Polynomial([1, 3 * c[0], 5 * c[1], 7 * c[2], 9 * c[3]])  # d theta_d / d theta, in theta^2
            return min([WIDEST, *(math.sqrt(root) for root in _positive(rising))])
        up, down = Polynomial([1, c[0], c[1], c[4]]), Polynomial([1, c[5], c[6], c[7]])  # in s = r^2
        rising = up * down + 2 * s * (up.deriv() * down - up * down.deriv())  # d r_d / d r, times down^2
        return min([WIDEST, *(math.atan(math.sqrt(root)) for root in _positive(rising) + _positive(down))])

    @property
    def limit(self) -> float:
        """`reach` as the model's own function takes it: an angle, or its squared distance from the axis on the plane z = 1."""
        return self.reach if self.model == "fisheye" else math.tan(self.reach) ** 2

    @cached_property
    def terms(self) -> Float[np.ndarray, "12"]:
        """All coefficients; those that are not given are 0."""
        return np.array([*self.coefficients, *[0.0] * (_TERMS - len(self.coefficients))])

    def transposed(self) -> "Distortion":
        """That of the picture whose rows and columns change places."""
        return self._with(self.terms[[0, 1, 3, 2, 4, 5, 6, 7, 10, 11, 8, 9]])

    def flipped(self) -> "Distortion":
        """That of the picture upside down."""
        return self._with(self.terms * [1, 1, -1, 1, 1, 1, 1, 1, 1, 1, -1, -1])

    def _with(self, terms: Float[np.ndarray, "12"]) -> "Distortion":
        return self if self.model == "fisheye" else replace(self, coefficients=tuple(terms[: len(self.coefficients)].tolist()))

    @cached_property
    def _table(self) -> tuple[Float[np.ndarray, " nodes"], Float[np.ndarray, " nodes"]]:
        """Distances from the axis on the plane z = 1, and where they are shown, by the radial terms alone."""
        radial = self._with(self.terms * [1, 1, 0, 0, 1, 1, 1, 1, 0, 0, 0, 0])
        true = np.tan(np.linspace(0, self.reach, _NODES))
        return true, radial._bent(true, np.zeros_like(true))[0]

    def _bent(self, u: np.ndarray, v: np.ndarray) -> tuple[Any, ...]:
        return (fisheye if self.model == "fisheye" else brown_conrady)(u, v, self.terms, self.limit)


@no_type_check
def brown_conrady(u, v, c, limit):  # of arrays, or compiled of scalars: one source for both
    """(u_d, v_d, du_d/du, du_d/dv, dv_d/du, dv_d/dv). Beyond `limit` rays are shown in proportion, so that the map never turns back."""
    r2 = u * u + v * v
    s = np.minimum(r2, limit)
    down = 1 + s * (c[5] + s * (c[6] + s * c[7]))
    q = (1 + s * (c[0] + s * (c[1] + s * c[4]))) / down
    slope = 1.0 * (s == r2) * ((c[0] + s * (2 * c[1] + 3 * c[4] * s)) - q * (c[5] + s * (2 * c[6] + 3 * c[7] * s))) / down  # dq / ds
    x = u * q + 2 * c[2] * u * v + c[3] * (r2 + 2 * u * u) + r2 * (c[8] + c[9] * r2)
    y = v * q + c[2] * (r2 + 2 * v * v) + 2 * c[3] * u * v + r2 * (c[10] + c[11] * r2)
    across = 2 * u * v * slope + 2 * c[2] * u + 2 * c[3] * v
    thin_x, thin_y = 2 * (c[8] + 2 * c[9] * r2), 2 * (c[10] + 2 * c[11] * r2)
    xu = q + 2 * u * u * slope + 2 * c[2] * v + 6 * c[3] * u + thin_x * u
    yv = q + 2 * v * v * slope + 6 * c[2] * v + 2 * c[3] * u + thin_y * v
    return x, y, xu, across + thin_x * v, across + thin_y * u, yv


@no_type_check
def fisheye(u, v, c, limit):
    """As `brown_conrady`: theta_d = theta (1 + k1 theta^2 + k2 theta^4 + k3 theta^6 + k4 theta^8)."""
    r2 = u * u + v * v + _AXIS
    angle = np.arctan(np.sqrt(r2))
    theta = np.minimum(angle, limit)
    t = theta * theta
    q = theta * (1 + t * (c[0] + t * (c[1] + t * (c[2] + t * c[3])))) / np.tan(theta)
    rising = 1 + t * (3 * c[0] + t * (5 * c[1] + t * (7 * c[2] + 9 * c[3] * t)))
    slope = 1.0 * (theta == angle) * (rising / (1 + r2) - q) / (2 * r2)  # dq / d(r^2)
    across = 2 * u * v * slope
    return u * q, v * q, q + 2 * u * u * slope, across, across, q + 2 * v * v * slope


def _positive(polynomial: Polynomial) -> list[float]:
    """Its real roots above 0."""
    roots = polynomial.trim().roots()
    return [float(root.real) for root in roots if root.real > 0 and abs(root.imag) <= _REAL * abs(root)]
