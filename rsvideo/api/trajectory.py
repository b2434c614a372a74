"""Where the camera pointed while a picture was taken, as a user sees it."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.interpolate import CubicSpline

from rsvideo.config.sidecar import Sampled
from rsvideo.physics.trajectory import Spline, fit
from rsvideo.physics.trajectory import Trajectory as Curve

_TERMS = (8, 512)  # of a spline through samples: the fewest and the most
_DENSE = 4  # positions a term at which the spline follows the samples
_SLACK = 1e-3  # of a picture's interval, that a motion may lack: rounding of its times


@dataclass(frozen=True, kw_only=True, eq=False)
class Trajectory:
    """The motion of the camera during one picture: a pose (x, y, roll) at each time.

    Time 0 is the opening of the row that is read first; the picture's interval is [0, readout + exposure] in seconds. A pose says where
    the restored image is sampled: x and y in pixels (positive x takes the sample from the right), roll in radians.

    Attributes:
        curve: The spline or polynomial itself.

    Examples:
        >>> import numpy as np, rsvideo
        >>> t = np.linspace(0, 0.04, 9)
        >>> path = rsvideo.Trajectory.through(t, np.stack([100 * t, 0 * t, 0 * t], axis=1))
        >>> path.at(0.02).round(6).tolist()
        [2.0, 0.0, 0.0]
        >>> path.poses.shape
        (161, 3)
    """

    curve: Curve

    @classmethod
    def through(cls, times: np.ndarray, poses: np.ndarray) -> "Trajectory":
        """A smooth curve through poses that were sampled at rising times.

        Args:
            times: (n,) seconds, rising, at least 2; 0 is the opening of the row that is read first.
            poses: (n, 3) of x and y in px and roll in rad, or (n, 2) for a shift.

        Raises:
            ValueError: The shapes do not fit, the times do not rise, or a number is not finite.
        """
        t, p = np.asarray(times, float), np.asarray(poses, float)
        if t.ndim != 1 or len(t) < 2 or p.shape not in ((len(t), 2), (len(t), 3)):
            raise ValueError(f"a trajectory must have times (n,) and poses (n, 3), n at least 2, got {t.shape} and {p.shape}")
        if not (np.isfinite(t).all() and np.isfinite(p).all()):
            raise ValueError("times and poses of a trajectory must be finite, some are NaN or infinite")
        if (np.diff(t) <= 0).any():
            late = int(np.argmax(np.diff(t) <= 0))
            raise ValueError(f"times of a trajectory must rise, they do not after {t[late]:g} s")
        terms = int(np.clip(len(t), *_TERMS))
        dense = np.linspace(t[0], t[-1], _DENSE * terms)
        blank = Spline(t0=float(t[0]), t1=float(t[-1]), coefficients=np.zeros((terms, p.shape[1])))
        return cls(curve=fit(blank, dense, CubicSpline(t, p)(dense)))

    @property
    def interval(self) -> tuple[float, float]:
        """Seconds, from where to where the motion is defined."""
        return self.curve.t0, self.curve.t1

    @property
    def times(self) -> Float[np.ndarray, " n"]:
        """(n,) seconds, evenly spaced over the interval, at most a quarter of a millisecond apart."""
        return Sampled.times(*self.interval)

    @property
    def poses(self) -> Float[np.ndarray, "n 3"]:
        """(n, 3): the poses at `times`, x and y in px, roll in rad."""
        return self.at(self.times)

    def at(self, t: float | np.ndarray) -> Float[np.ndarray, "... 3"]:
        """The pose at a time, (3,), or at each of several, (n, 3): x and y in px, roll in rad (0 of a shift)."""
        times = np.atleast_1d(np.asarray(t, float))
        poses = self.curve.at(times)
        poses = np.concatenate([poses, np.zeros((*times.shape, 3 - poses.shape[-1]))], axis=-1)
        return poses if np.ndim(t) else poses[0]

    def check_covers(self, interval: tuple[float, float]) -> None:
        """Refuse a motion that does not reach over a picture's whole interval."""
        (t0, t1), (start, end) = self.interval, interval
        slack = _SLACK * (end - start)
        if t0 > start + slack or t1 < end - slack:
            raise ValueError(
                f"trajectory must cover the picture's whole interval, {start:g} to {end:g} s, it covers {t0:g} to {t1:g} s;"
                " is its time 0 the opening of the first row?"
            )
