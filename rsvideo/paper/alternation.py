"""Algorithm 1 of Su & Heidrich 2015: the latent image and the trajectory, in turn."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from rsvideo.paper.latent_image import LatentSettings, restore
from rsvideo.physics.blur import SAMPLES, BlurOperator
from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Trajectory
from rsvideo.solvers import total_variation
from rsvideo.solvers.differences import Differences
from rsvideo.solvers.gauss_newton import Quadratic, gauss_newton, quadratic
from rsvideo.solvers.stopping import solve

TIMES = 65  # at which two paths are compared
SETTLED = 1e-4  # relative fall of the objective that ends Gauss-Newton


@dataclass(frozen=True, kw_only=True)
class PaperSettings:
    """The parameters of Sec. 5 under the paper's names; the degree P is the start trajectory's."""

    K: int = SAMPLES  # time samples an exposure
    mu_0: float = 1e-2  # weight of total variation at first
    tau: float = 0.7  # by which it falls at each iteration
    mu_min: float = 1e-3  # down to this
    motion_steps: int = 3  # of Gauss-Newton, an iteration
    slack: int = 6  # px by which a scanline's path may grow within one iteration
    latent: LatentSettings = field(default_factory=LatentSettings)

    def __post_init__(self) -> None:
        if not 0 < self.tau <= 1:
            raise ValueError(f"tau must lie in (0, 1], got {self.tau:g}")
        if not 0 < self.mu_min <= self.mu_0:
            raise ValueError(f"mu_min must lie in (0, mu_0 = {self.mu_0:g}], got {self.mu_min:g}")


@dataclass(frozen=True, kw_only=True, eq=False)
class Round:
    """What one round of Algorithm 1 found; Fig. 5 shows a few of them."""

    trajectory: Trajectory  # theta^{k+1}
    latent: Float[np.ndarray, "latent_rows latent_cols"]  # l^{k+1}; it reaches beyond the frame
    sharp: Float[np.ndarray, "rows cols"]  # its part within the frame
    objective: float  # Eq. (8) at both
    mu: float
    change: float  # px RMS by which the path moved over the frame's interval


def alternate(
    b: Float[np.ndarray, "rows cols"],
    *,
    camera: Camera,
    start: Trajectory,
    settings: PaperSettings,
) -> Iterator[Round]:
    """Rounds of Algorithm 1 from a trajectory theta_0 (Sec. 4.2.2); `b` is grey and linear in [0, 1].

    The paper's alternation, with one difference: the trajectory's constant term is a gauge, which only moves the latent image
    as a whole, and stays at the start's where the paper lets it wander.
    """
    theta, mu = start, settings.mu_0
    while True:
        K = BlurOperator.covering(theta, camera=camera, samples=settings.K, slack=settings.slack)
        latent = restore(b, K, mu=mu, settings=settings.latent)  # Eq. (15)
        moved = update_motion(b, latent, K, steps=settings.motion_steps)  # Eq. (9)
        after = _moved(K, moved)
        yield Round(
            trajectory=moved,
            latent=latent,
            sharp=latent[K.inside],
            objective=total_variation.objective(latent, b, mu=mu, blur=after, gradient=Differences()),
            mu=mu,
            change=_distance(theta, moved, camera),
        )
        theta, mu = moved, max(settings.tau * mu, settings.mu_min)


def update_motion(
    b: Float[np.ndarray, "rows cols"], latent: Float[np.ndarray, "latent_rows latent_cols"], K: BlurOperator, *, steps: int
) -> Trajectory:
    """argmin_theta sum_ij r_ij(theta)^2, Eq. (9), by damped Gauss-Newton over all terms but the constant."""
    shape = K.trajectory.coefficients[1:].shape

    def path(theta: np.ndarray) -> Trajectory:
        return K.trajectory.with_coefficients(np.vstack([K.trajectory.coefficients[:1], theta.reshape(shape)]))

    def residual(theta: np.ndarray) -> np.ndarray:
        return b - _moved(K, path(theta)).forward(latent)  # Eq. (10)

    def objective(theta: np.ndarray) -> float:
        return 0.5 * float(np.sum(residual(theta) ** 2, dtype=float))

    def linearise(theta: np.ndarray) -> Quadratic:
        J_r = -_moved(K, path(theta)).jacobian(latent)[1:]  # Eq. (13)
        return quadratic(residual(theta), J_r.reshape(theta.size, *b.shape))

    states = gauss_newton(objective, linearise, K.trajectory.coefficients[1:].ravel())
    return path(solve(states, steps=steps, tolerance=SETTLED).state.theta)


def _moved(K: BlurOperator, trajectory: Trajectory) -> BlurOperator:
    """The same latent image under another trajectory."""
    return BlurOperator(camera=K.camera, trajectory=trajectory, samples=K.samples, margin=K.margin)


def _distance(one: Trajectory, other: Trajectory, camera: Camera) -> float:
    """px RMS over the frame's interval."""
    t = np.linspace(one.t0, one.t1, TIMES)
    apart = one.at(t) - other.at(t)
    apart[:, 2:] *= math.hypot(camera.intrinsics.rows, camera.intrinsics.cols) / 4  # roll moves a pixel halfway to the corner by this
    return float(np.sqrt((apart**2).sum(axis=1).mean()))
