"""What became of a picture, and how it was moved."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Float32

from rsvideo.api.trajectory import Trajectory
from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics.camera import Intrinsics, turned
from rsvideo.physics.psf import INSTANTS, psfs_from_traces
from rsvideo.physics.shutter import Direction, ShutterTiming

_GRID = (5, 7)  # PSFs down and across, unless chosen; as in the figures
_MOST_POINTS = 1000  # PSFs down or across


@dataclass(frozen=True, kw_only=True, eq=False)
class Result:
    """A picture after restoration.

    Attributes:
        latent: The sharp picture at the pose of the middle of its interval, in the shape and kind that was given: uint8 or uint16 codes,
            or float32 linear light in [0, 1]. Where nothing was restored it is the picture itself.
            Where the verdict is UNDIRECTED its rows stay where they were read; where it is DOUBTFUL it is restored in part.
        light: The same in linear light, float32, whatever was given.
        verdict: What became of the picture; its value is the sentence that a person reads.
        trajectory: The motion that was found, or given; its pose in the middle of the interval is the origin.
        timing: The shutter of this picture: exposure, row_time and readout in s, rows, direction.
        timing_source: Where exposure and readout come from, in words.
        camera: The lens in pixels of this picture: fx, fy, cx, cy, rows, cols.
        seconds: Of work.
        convergence: The objective after each step of the last refinement of the trajectory.
        index: Of a clip: which frame this is, counted from 0.
        time: Of a clip: seconds from the first frame's beginning to this one's.
        to_next: Of a clip: (3,) from this pose to the next frame's, x and y in px, roll in rad; None at a cut.
        notes: What the user should know: what was assumed, and from where.
    """

    latent: np.ndarray = field(repr=False)
    light: Float32[np.ndarray, "..."] = field(repr=False)
    verdict: Verdict
    trajectory: Trajectory = field(repr=False)
    timing: ShutterTiming
    timing_source: str
    camera: Intrinsics = field(repr=False)
    seconds: float
    convergence: tuple[float, ...] = field(default=(), repr=False)
    index: int = 0
    time: float = 0.0
    to_next: Float[np.ndarray, "3"] | None = None
    notes: tuple[str, ...] = ()

    @property
    def restored(self) -> bool:
        """Whether the picture was deblurred, rather than left as it was."""
        return self.verdict.deblurred

    def psfs(self, grid: tuple[int, int] = _GRID) -> Float[np.ndarray, "down across k k"]:
        """The blur that the trajectory makes across the picture, at the centres of `grid` equal parts of it.

        Args:
            grid: How many points down and across.

        Returns:
            (down, across, k, k): the kernel k of b = k * l at each point, k odd, the point's own pixel in its middle. Each sums to 1.

        Examples:
            >>> import numpy as np, rsvideo
            >>> shutter, camera = rsvideo.Shutter(exposure="1/50", readout=0), rsvideo.Camera(focal_px=100)
            >>> sharp = np.random.default_rng(0).random((64, 96))
            >>> shot = rsvideo.simulate(sharp, shutter=shutter, camera=camera, motion={"x": [0, 4]}, noise=0)
            >>> result = rsvideo.deblur(shot.blurred, shutter=shutter, camera=camera, trajectory=shot.trajectory)
            >>> result.psfs((1, 1)).round(2)[0, 0, 3]  # 4 px of motion at an even pace
            array([0.  , 0.13, 0.25, 0.25, 0.25, 0.13, 0.  ])
        """
        down, across = grid
        if min(grid) < 1 or max(grid) > _MOST_POINTS:
            raise ValueError(f"grid must be from 1 to {_MOST_POINTS} points down and across, got {grid}")
        y = np.repeat((np.arange(down) + 0.5) * self.camera.rows / down - 0.5, across)
        x = np.tile((np.arange(across) + 0.5) * self.camera.cols / across - 0.5, down)
        traces = self._traces(x, y)
        half = int(np.ceil(np.abs(traces).max())) + 1
        kernels = psfs_from_traces(traces, half)
        return kernels.reshape(down, across, *kernels.shape[1:])

    def _traces(self, x: np.ndarray, y: np.ndarray) -> Float[np.ndarray, "points instants 2"]:
        """Where light that falls on (x, y) comes from, mirrored at the pixel: the image moves against the sampling."""
        scanline = {
            Direction.TOP_TO_BOTTOM: y,
            Direction.BOTTOM_TO_TOP: self.camera.rows - 1 - y,
            Direction.LEFT_TO_RIGHT: x,
            Direction.RIGHT_TO_LEFT: self.camera.cols - 1 - x,
        }[self.timing.direction]
        opened = scanline[:, None] * self.timing.row_time
        t = opened + (np.arange(INSTANTS) + 0.5) / INSTANTS * self.timing.exposure
        at_x, at_y = (np.broadcast_to(part[:, None], t.shape) for part in (x, y))
        return -turned(self.camera, at_x, at_y, self.trajectory.curve.at(t))


def within(latent: Float[np.ndarray, "..."]) -> Float32[np.ndarray, "..."]:
    """The latent image in [0, 1]: solvers leave that range beside clipped lamps and sharp edges."""
    return np.clip(latent, 0, 1).astype(np.float32, copy=False)


def public(
    result: FrameResult, latent: np.ndarray, *, camera: Intrinsics, to_next: np.ndarray | None = None, notes: tuple[str, ...] = ()
) -> Result:
    """What the inner rooms answer, with the picture in its user's kind."""
    light = within(result.latent)
    return Result(
        latent=latent,
        light=light.reshape(latent.shape),
        verdict=result.verdict,
        trajectory=Trajectory(curve=result.trajectory),
        timing=result.timing,
        timing_source=result.timing_source,
        camera=camera,
        seconds=result.seconds,
        convergence=result.convergence,
        index=result.frame.index,
        time=result.frame.time,
        to_next=None if to_next is None else np.array([*to_next, 0.0])[:3],
        notes=notes,
    )
