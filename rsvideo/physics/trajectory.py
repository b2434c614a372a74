"""Where the camera points over time: curves that are linear in their coefficients."""

from dataclasses import dataclass, replace
from typing import Protocol, TypeVar, runtime_checkable

import numpy as np
from jaxtyping import Float
from numpy.polynomial import legendre
from scipy.interpolate import BSpline

AXES = ("x_px", "y_px", "roll_rad")
_C = TypeVar("_C", bound="_Curve")  # not typing.Self, which cannot be checked at calls


@runtime_checkable
class Trajectory(Protocol):
    """A path p(t) of poses (x in px, y in px, and roll in rad where there is a third column), Eq. (6)-(7).

    A pose is where the latent image is sampled: positive x takes the sample from the right.
    """

    @property
    def t0(self) -> float:
        """Seconds, where the frame's interval starts."""
        ...

    @property
    def t1(self) -> float:
        """Seconds, where it ends."""
        ...

    @property
    def coefficients(self) -> np.ndarray:
        """(terms, axes)."""
        ...

    def basis(self, t: np.ndarray) -> np.ndarray:
        """(..., terms): the derivative of p(t) in its coefficients."""
        ...

    def at(self, t: np.ndarray) -> np.ndarray:
        """(..., axes): the pose at each time."""
        ...

    def with_coefficients(self, coefficients: np.ndarray) -> "Trajectory":
        """The same kind of curve on the same interval."""
        ...

    def shifted(self, pose: np.ndarray) -> "Trajectory":
        """The curve p(t) + pose."""
        ...


@dataclass(frozen=True, kw_only=True, eq=False)
class _Curve:
    t0: float  # seconds, where the frame's interval starts
    t1: float  # seconds, where it ends
    coefficients: Float[np.ndarray, "terms axes"]

    def __post_init__(self) -> None:
        if not self.t1 > self.t0:
            raise ValueError(f"a trajectory's interval must have t1 > t0, got [{self.t0:g}, {self.t1:g}] s")
        if self.coefficients.shape[1] not in (2, 3):
            raise ValueError(f"a trajectory has 2 or 3 axes, got {self.coefficients.shape[1]}")

    def with_coefficients(self: _C, coefficients: Float[np.ndarray, "terms axes"]) -> _C:
        return replace(self, coefficients=coefficients)


@dataclass(frozen=True, kw_only=True, eq=False)
class Polynomial(_Curve):
    """A polynomial of any degree in Legendre's basis, orthonormal over the interval (mean square 1).

    The paper writes monomials (Eq. 6); the space of curves is the same, the normal matrix is better conditioned.
    """

    def basis(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n terms"]:
        s = (2 * np.asarray(t, float) - self.t0 - self.t1) / (self.t1 - self.t0)
        degree = len(self.coefficients) - 1
        return legendre.legvander(s, degree) * np.sqrt(2 * np.arange(degree + 1) + 1)

    def at(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n axes"]:
        return self.basis(t) @ self.coefficients

    def shifted(self, pose: Float[np.ndarray, " axes"]) -> "Polynomial":
        coefficients = self.coefficients.copy()
        coefficients[0] += pose
        return self.with_coefficients(coefficients)


@dataclass(frozen=True, kw_only=True, eq=False)
class Spline(_Curve):
    """A cubic B-spline with equidistant knots, clamped at the interval's ends. Needs at least 4 coefficients."""

    @property
    def smooth(self) -> "Spline":
        """The spline, without what vibrates beside it."""
        return self

    @property
    def spacing(self) -> float:
        """Seconds from knot to knot."""
        return (self.t1 - self.t0) / (len(self.smooth.coefficients) - 3)

    def basis(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n terms"]:
        terms = len(self.coefficients)
        knots = np.r_[[self.t0] * 3, np.linspace(self.t0, self.t1, terms - 2), [self.t1] * 3]
        t = np.clip(np.asarray(t, float), self.t0, self.t1)
        return BSpline.design_matrix(t.ravel(), knots, 3).toarray().reshape(*t.shape, terms)

    def at(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n axes"]:
        return self.basis(t) @ self.coefficients

    def shifted(self, pose: Float[np.ndarray, " axes"]) -> "Spline":
        return self.with_coefficients(self.coefficients + pose)  # B-splines sum to one


@dataclass(frozen=True, kw_only=True, eq=False)
class VibratingSpline(Spline):
    """A cubic B-spline s(t), and tones beside it, as an engine shakes a camera, whose strength and phase change evenly from node to node:

        p(t) = s(t) + sum_fj h_j(t) (a_fj cos(2 pi f t) + b_fj sin(2 pi f t))

    with the linear B-splines h_j on equidistant nodes over the interval. After s's coefficients come a and b of each frequency and node.
    """

    frequencies: tuple[float, ...]  # Hz
    nodes: int  # of each tone; at least 2

    @property
    def smooth(self) -> Spline:
        return Spline(t0=self.t0, t1=self.t1, coefficients=self.coefficients[: -2 * self.nodes * len(self.frequencies)])

    def basis(self, t: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n terms"]:
        t = np.asarray(t, float)
        place = np.clip((t - self.t0) / (self.t1 - self.t0), 0, 1) * (self.nodes - 1)
        strengths = np.maximum(0, 1 - np.abs(place[..., None] - np.arange(self.nodes)))
        phases = 2 * np.pi * t[..., None] * np.array(self.frequencies)
        waves = np.stack([np.cos(phases), np.sin(phases)], axis=-1)
        tones = strengths[..., None, :, None] * waves[..., :, None, :]
        return np.concatenate([self.smooth.basis(t), tones.reshape(*t.shape, -1)], axis=-1)

    def shifted(self, pose: Float[np.ndarray, " axes"]) -> "VibratingSpline":
        coefficients = self.coefficients.copy()
        coefficients[: len(self.smooth.coefficients)] += pose
        return self.with_coefficients(coefficients)


def fit(
    curve: Trajectory, t: Float[np.ndarray, " n"], poses: Float[np.ndarray, "n axes"], weights: Float[np.ndarray, " n"] | None = None
) -> Trajectory:
    """The curve of the same kind as `curve` nearest to sampled `poses` in the (weighted) least-squares sense."""
    w = np.ones(len(t)) if weights is None else np.sqrt(weights)
    return curve.with_coefficients(np.linalg.lstsq(curve.basis(t) * w[:, None], poses * w[:, None], rcond=None)[0])


def still(interval: tuple[float, float], *, degree: int, axes: int) -> Polynomial:
    """A polynomial of the given degree that does not move."""
    return Polynomial(t0=interval[0], t1=interval[1], coefficients=np.zeros((degree + 1, axes)))


def centred(curve: Trajectory, t: float) -> Trajectory:
    """The same motion, with its pose at time `t` as the origin: the gauge of the restored frame."""
    return curve.shifted(-curve.at(np.array([t]))[0])


def path_error(found: Float[np.ndarray, "n axes"], truth: Float[np.ndarray, "n axes"]) -> float:
    """RMS distance in px of two sampled paths in x and y, after removing the mean difference."""
    d = (found - truth)[:, :2]
    return float(np.sqrt(((d - d.mean(axis=0)) ** 2).sum(axis=1).mean()))
