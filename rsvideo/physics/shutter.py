"""When each row of a frame collects light."""

import enum
import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

RENDERED = 64  # instants of a scanline's exposure that a rendering averages; at 20 px of blur they lie 0.3 px apart
LONGEST_MODELLED = 10.0  # seconds; an exposure or readout of this length or more is a slip of the unit on any stand


class Direction(enum.StrEnum):
    """How the readout travels over the stored image."""

    TOP_TO_BOTTOM = "top-to-bottom"
    BOTTOM_TO_TOP = "bottom-to-top"
    LEFT_TO_RIGHT = "left-to-right"
    RIGHT_TO_LEFT = "right-to-left"

    @property
    def by_row(self) -> bool:
        """Whether scanlines are rows of the stored image; else they are its columns."""
        return self in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP)

    @property
    def opposite(self) -> "Direction":
        """The one back along the same axis."""
        begin, end = self.split("-to-")
        return Direction(f"{end}-to-{begin}")

    def scanlines(self, image: np.ndarray) -> np.ndarray:
        """The view of `image` (rows, cols, ...) whose first axis counts scanlines in the order they are read."""
        if self in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT):
            image = image.swapaxes(0, 1)
        return image[::-1] if self in (Direction.BOTTOM_TO_TOP, Direction.RIGHT_TO_LEFT) else image

    def image(self, scanlines: np.ndarray) -> np.ndarray:
        """The inverse of `scanlines`."""
        if self in (Direction.BOTTOM_TO_TOP, Direction.RIGHT_TO_LEFT):
            scanlines = scanlines[::-1]
        return scanlines.swapaxes(0, 1) if self in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT) else scanlines

    @property
    def pose_from_scanlines(self) -> Float[np.ndarray, "3 3"]:
        """The signed permutation that takes a pose (x, y, roll) along the scanlines to the pose in the image."""
        match self:
            case Direction.TOP_TO_BOTTOM:
                return np.eye(3)
            case Direction.BOTTOM_TO_TOP:  # y turns round, so does the sense of rotation
                return np.diag([1.0, -1.0, -1.0])
            case Direction.LEFT_TO_RIGHT:  # x and y change places
                return np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
            case Direction.RIGHT_TO_LEFT:
                return np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

    def poses_along_scanlines(self, poses: Float[np.ndarray, "*n axes"]) -> Float[np.ndarray, "*n axes"]:
        """Poses (x, y[, roll]) in the image's axes, or a path's coefficients, along the scanlines."""
        axes = poses.shape[-1]
        return poses @ self.pose_from_scanlines[:axes, :axes]

    def poses_in_image(self, poses: Float[np.ndarray, "*n axes"]) -> Float[np.ndarray, "*n axes"]:
        """The inverse of `poses_along_scanlines`."""
        axes = poses.shape[-1]
        return poses @ self.pose_from_scanlines[:axes, :axes].T


@dataclass(frozen=True, kw_only=True)
class ShutterTiming:
    """The timing of one frame. Time 0 is the opening of the scanline that is read first.

    Scanline i is open over [i * row_time, i * row_time + exposure] (Eq. 2 of Su & Heidrich 2015).
    """

    exposure: float  # seconds each scanline is open, t_e
    row_time: float  # seconds from one stored scanline to the next, t_r; 0 is a global shutter
    rows: int  # scanlines, M + 1
    direction: Direction = Direction.TOP_TO_BOTTOM

    def __post_init__(self) -> None:
        if not (math.isfinite(self.exposure) and 0 < self.exposure < LONGEST_MODELLED):
            raise ValueError(f"exposure must lie in (0, {LONGEST_MODELLED:g}) s, got {self.exposure:g} s; is it in milliseconds?")
        if self.rows < 1:
            raise ValueError(f"rows must be at least 1, got {self.rows}; is the image empty?")
        if not (math.isfinite(self.row_time) and 0 <= self.readout < LONGEST_MODELLED):
            raise ValueError(
                f"readout must lie in [0, {LONGEST_MODELLED:g}) s, got {self.readout:g} s"
                f" ({self.rows} rows of {self.row_time:g} s); is it in milliseconds?"
            )

    @classmethod
    def from_readout(cls, *, exposure: float, readout: float, rows: int, direction: Direction = Direction.TOP_TO_BOTTOM) -> "ShutterTiming":
        """Timing of a frame whose `rows` scanlines are read in `readout` seconds."""
        return cls(exposure=exposure, row_time=readout / max(rows, 1), rows=rows, direction=direction)

    @property
    def readout(self) -> float:
        """Seconds from the opening of the first scanline to that of the one that would follow the last."""
        return self.rows * self.row_time

    @property
    def interval(self) -> tuple[float, float]:
        """The time over which any scanline is open, [0, (M + 1) t_r + t_e]."""
        return 0.0, self.readout + self.exposure

    @property
    def middle(self) -> float:
        """The time whose pose the restored frame shows."""
        return 0.5 * self.interval[1]

    def lasting(self, seconds: float) -> "ShutterTiming":
        """The same with a readout by which the frame's interval is at least so long."""
        return replace(self, row_time=max(self.row_time, (seconds - self.exposure) / self.rows))

    def row_start(self) -> Float[np.ndarray, " rows"]:
        """When each scanline opens."""
        return np.arange(self.rows) * self.row_time

    def sample_times(self, samples: int) -> Float[np.ndarray, "rows samples"]:
        """The set T_i of Eq. (3): the midpoints of `samples` equal parts of each scanline's exposure.

        The paper takes both ends, {i t_r + j t_e / K : j = 0..K}; midpoints integrate linear motion exactly.
        """
        return self.row_start()[:, None] + (np.arange(samples) + 0.5) * (self.exposure / samples)
