"""Which ray each pixel looks along, and where it moves when the camera turns."""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rsvideo.physics.shutter import Direction, ShutterTiming


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """A pinhole camera, the matrix C of Eq. (4). The centre of the top-left pixel is (0, 0)."""

    fx: float  # focal length in columns
    fy: float  # focal length in rows
    cx: float  # principal point, px
    cy: float
    rows: int
    cols: int

    def __post_init__(self) -> None:
        for name, value in (("fx", self.fx), ("fy", self.fy)):
            if not (math.isfinite(value) and 1 <= value < 1e7):
                raise ValueError(f"focal length {name} must lie in [1, 1e7) px, got {value:g} px; is it in millimetres?")
        if min(self.rows, self.cols) < 1:
            raise ValueError(f"an image has at least one row and column, got {self.rows} x {self.cols}")

    @classmethod
    def centred(cls, *, focal: float, rows: int, cols: int) -> "Intrinsics":
        """Square pixels, the principal point at the frame's centre."""
        return cls(fx=focal, fy=focal, cx=(cols - 1) / 2, cy=(rows - 1) / 2, rows=rows, cols=cols)

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """C: camera coordinates to homogeneous pixels."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A rolling-shutter camera as it takes a frame: when each scanline collects light, where its pixels look, how noisy they are."""

    timing: ShutterTiming
    intrinsics: Intrinsics  # of the frame as it is stored
    noise: float | None = None  # standard deviation of a channel in linear light; None where it is to be measured in each frame

    def __post_init__(self) -> None:
        if self.noise is not None and not 0 <= self.noise < 1:
            raise ValueError(f"noise must lie in [0, 1) of white, got {self.noise:g}; is it in 8-bit codes?")

    def along_scanlines(self) -> "Camera":
        """The same camera, turned with its frames so that the scanlines are read from top to bottom."""
        direction, lens = self.timing.direction, self.intrinsics
        if direction in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT):
            lens = replace(lens, fx=lens.fy, fy=lens.fx, cx=lens.cy, cy=lens.cx, rows=lens.cols, cols=lens.rows)
        if direction in (Direction.BOTTOM_TO_TOP, Direction.RIGHT_TO_LEFT):
            lens = replace(lens, cy=lens.rows - 1 - lens.cy)
        return replace(self, timing=replace(self.timing, direction=Direction.TOP_TO_BOTTOM), intrinsics=lens)


def turned(
    intrinsics: Intrinsics, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"], poses: Float[np.ndarray, "*n axes"]
) -> Float[np.ndarray, "*n 2"]:
    """How far the sample of pixel (x, y) moves under each pose: w(x; p) - x of Eq. (4).

    Two axes are the paper's shift, the same for every pixel; three are the homography C R C^-1 with R = exp([(pitch, yaw, roll)]_x),
    yaw = x_px / fx, pitch = -y_px / fy.
    """
    if poses.shape[-1] == 2:
        return poses + 0.0 * (x + y)[..., None]
    u, v = (x - intrinsics.cx) / intrinsics.fx, (y - intrinsics.cy) / intrinsics.fy
    a, b, c = -poses[..., 1] / intrinsics.fy, poses[..., 0] / intrinsics.fx, poses[..., 2]
    angle2 = a * a + b * b + c * c
    angle = np.sqrt(angle2)
    sine = np.sinc(angle / np.pi)  # sin(angle) / angle
    cosine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos(angle)) / angle^2
    cross = (b - c * v, c * u - a, a * v - b * u)  # omega x (u, v, 1)
    twice = (b * cross[2] - c * cross[1], c * cross[0] - a * cross[2], a * cross[1] - b * cross[0])
    ray = [m + sine * p + cosine * q for m, p, q in zip((u, v, np.ones_like(u)), cross, twice, strict=True)]  # Rodrigues
    return np.stack([intrinsics.fx * (ray[0] / ray[2] - u), intrinsics.fy * (ray[1] / ray[2] - v)], axis=-1)


def homography(intrinsics: Intrinsics, pose: Float[np.ndarray, " axes"]) -> Float[np.ndarray, "3 3"]:
    """C R C^-1 of Eq. (4): where every pixel samples the scene under one pose; what `turned` says pixel by pixel."""
    if len(pose) == 2:
        return np.array([[1, 0, pose[0]], [0, 1, pose[1]], [0, 0, 1.0]])
    rotation = Rotation.from_rotvec([-pose[1] / intrinsics.fy, pose[0] / intrinsics.fx, pose[2]]).as_matrix()
    return intrinsics.matrix @ rotation @ np.linalg.inv(intrinsics.matrix)


def projected(matrix: Float[np.ndarray, "3 3"], x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
    """The image of the points (x, y) under a homography."""
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in matrix)
    return np.stack([u / w, v / w], axis=-1)


def lever(intrinsics: Intrinsics, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"], axes: int) -> Float[np.ndarray, "*n 2 axes"]:
    """The derivative of `turned` in the pose at rest: how each axis moves the sample of pixel (x, y)."""
    out = np.zeros((*np.broadcast_shapes(x.shape, y.shape), 2, axes))
    if axes == 2:
        out[..., 0, 0] = out[..., 1, 1] = 1
        return out
    u, v = (x - intrinsics.cx) / intrinsics.fx, (y - intrinsics.cy) / intrinsics.fy
    ratio = intrinsics.fx / intrinsics.fy
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 + u * u, u * v * ratio, -v * intrinsics.fx
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = u * v / ratio, 1 + v * v, u * intrinsics.fy
    return out
