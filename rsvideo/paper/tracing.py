"""From the kernels of strips to a trajectory as published: Sec. 4.2.2.

Each kernel is smoothed, thinned to a curve, and traced from one end to the other; a point's time is the intensity that has
accumulated up to it, its confidence its own intensity. Which end came first is not in a kernel: all senses of all strips
are tried, and the polynomial with the least residual wins.
"""

import itertools
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial
from rsvideo.restoration.psf_fit import Strip

FLOOR = 0.1  # smoothed intensities below this share of the largest are no part of the curve; origin: by trial
MOST_STRIPS = 12  # 2^12 senses are tried in about a second
STIFFNESS = 1e-3  # of the fit, relative to its data: tells apart curves that the strips do not


@dataclass(frozen=True, kw_only=True, eq=False)
class Traced:
    """A strip's curve as poses with time stamps, in one sense of time."""

    t: Float[np.ndarray, " n"]  # seconds
    poses: Float[np.ndarray, "n 2"]  # px, up to the strip's own offset
    confidence: Float[np.ndarray, " n"]  # sum 1


def trace(strips: list[Strip], timing: ShutterTiming, *, degree: int) -> Polynomial:
    """The polynomial of two axes, zero at the frame's middle, that fits all strips' traced curves best, each in its best sense.

    A blind kernel may be moved freely with its latent strip, so nothing ties the strips' positions to each other: here each strip
    has a free offset, solved for along with the coefficients, and the paths' overlap in time does the rest. (The paper does not
    say what it does with these offsets.) A strip's points are stamped from its middle scanline's exposure;
    the column it stands for does not matter, as the path is a shift. A kernel k of
    b = k * l has its mass at minus the pose.
    """
    if not strips:
        raise ValueError("a trajectory needs the kernel of at least 1 strip, got none")
    if len(strips) > MOST_STRIPS:
        raise ValueError(f"tracing tries both senses of every strip; at most {MOST_STRIPS} strips can be traced, got {len(strips)}")
    curve = Polynomial(t0=timing.interval[0], t1=timing.interval[1], coefficients=np.zeros((degree + 1, 2)))
    senses = [_both_senses(strip, timing) for strip in strips]
    quadratics = [[_Quadratic.of(traced, curve) for traced in pair] for pair in senses]
    roughness = STIFFNESS * len(strips) * np.diag(np.arange(1.0, degree + 1) ** 4)
    best, coefficients = np.inf, np.zeros((degree, 2))
    for choice in itertools.product((0, 1), repeat=len(strips)):
        chosen = [pair[sense] for pair, sense in zip(quadratics, choice, strict=True)]
        normal = sum(q.normal for q in chosen) + roughness
        linear = sum(q.linear for q in chosen)
        theta = np.linalg.solve(normal, linear)
        residual = sum(q.constant for q in chosen) - float((linear * theta).sum())  # at the least, with the roughness
        if residual < best:
            best, coefficients = residual, theta
    found = curve.with_coefficients(np.vstack([np.zeros((1, 2)), coefficients]))
    return found.shifted(-found.at(np.array([timing.middle]))[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class _Quadratic:
    """The weighted squared residual of one strip, its offset minimised away: theta^T N theta - 2 theta^T c + d."""

    normal: Float[np.ndarray, "terms terms"]
    linear: Float[np.ndarray, "terms 2"]
    constant: float

    @classmethod
    def of(cls, traced: Traced, curve: Polynomial) -> "_Quadratic":
        w = traced.confidence
        B, p = curve.basis(traced.t)[:, 1:], traced.poses
        B, p = B - np.average(B, axis=0, weights=w), p - np.average(p, axis=0, weights=w)
        return cls(normal=B.T @ (w[:, None] * B), linear=B.T @ (w[:, None] * p), constant=float((w[:, None] * p * p).sum()))


def _both_senses(strip: Strip, timing: ShutterTiming) -> tuple[Traced, Traced]:
    points, intensity = traced_curve(strip.kernel)
    opens = 0.5 * (strip.first + strip.last - 1) * timing.row_time
    passed = (np.cumsum(intensity) - 0.5 * intensity) / intensity.sum()
    confidence = intensity / intensity.sum()
    half = (np.array(strip.kernel.shape) - 1) / 2
    poses = -(points - half)[:, ::-1]  # (x, y) at minus the kernel's (row, col)
    forth = Traced(t=opens + passed * timing.exposure, poses=poses, confidence=confidence)
    back = Traced(t=opens + (1 - passed) * timing.exposure, poses=poses, confidence=confidence)
    return forth, back


def traced_curve(kernel: Float[np.ndarray, "k k"]) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, " n"]]:
    """The kernel's curve from one end to the other: its points (row, col) and the smoothed intensity at each."""
    padded = np.pad(kernel, 2).astype(np.float32)
    smooth = cv2.filter2D(padded, -1, np.full((3, 3), 1 / 9, np.float32), borderType=cv2.BORDER_CONSTANT)
    skeleton = cv2.ximgproc.thinning((smooth > FLOOR * smooth.max()).astype(np.uint8) * 255) > 0
    path = _longest_path(skeleton)
    return path.astype(float) - 2, smooth[path[:, 0], path[:, 1]].astype(float)


def _longest_path(skeleton: Bool[np.ndarray, "r c"]) -> Int[np.ndarray, "n 2"]:
    """The longest of the shortest paths through the skeleton, from end to end; branches are left out."""
    points = np.argwhere(skeleton)
    apart = points[:, None] - points[None]
    adjacent = np.abs(apart).max(axis=2) == 1  # the eight neighbours
    graph = csr_array(np.where(adjacent, np.sqrt((apart**2).sum(axis=2)), 0))  # px between neighbours
    last = _farthest(dijkstra(graph, indices=0))  # the point farthest from any is an end
    distance, before = dijkstra(graph, indices=last, return_predecessors=True)
    path = [_farthest(distance)]  # and the one farthest from it the other
    while path[-1] != last:
        path.append(int(before[path[-1]]))
    return points[np.array(path)]


def _farthest(distance: Float[np.ndarray, " n"]) -> int:
    return int(np.argmax(np.where(np.isfinite(distance), distance, -1)))
