"""Which ray each pixel receives light along, and where it moves when the camera turns.

A lens may bend rays (`distortion`): with D from a ray to where it is shown and U its inverse, pixel x samples the latent image at
w(x; p) = D(R U(x)), which is the homography C R C^-1 of Eq. (4) for a pinhole camera. The latent image keeps the lens's own geometry.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from rsvideo.physics.distortion import WIDEST, Distortion
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import Direction, ShutterTiming

_BORDER = 9  # points of each side of the frame where a lens is checked
_MET = 1e-6  # px, by which the lens must be invertible there
LEAST_DEPTH = 0.1  # of a ray after a turn of the camera, 1 before it: less is a turn by almost a right angle
MOST_FOCAL_PX = 1e7  # px; no lens is so long, a number in other units may be
_REACH_SLACK = 1e-9  # on the plane z = 1; rounding alone does not put a ray beyond the reach of a lens


@dataclass(frozen=True, kw_only=True)
class Intrinsics:
    """A camera: the matrix C of Eq. (4), and what its lens adds. The centre of the top-left pixel is (0, 0)."""

    fx: float  # focal length in columns
    fy: float  # focal length in rows
    cx: float  # principal point, px
    cy: float
    rows: int
    cols: int
    distortion: Distortion | None = None  # None: a pinhole camera

    def __post_init__(self) -> None:
        for name, value in (("fx", self.fx), ("fy", self.fy)):
            if not (math.isfinite(value) and 1 <= value < MOST_FOCAL_PX):
                raise ValueError(f"focal length {name} must lie in [1, 1e7) px, got {value:g} px; is it in millimetres?")
        if min(self.rows, self.cols) < 1:
            raise ValueError(f"an image has at least one row and column, got {self.rows} x {self.cols}")
        if self.distortion:
            _check_invertible(self, self.distortion)

    @classmethod
    def centred(cls, *, focal: float, rows: int, cols: int) -> "Intrinsics":
        """Square pixels, the principal point at the frame's centre."""
        return cls(fx=focal, fy=focal, cx=(cols - 1) / 2, cy=(rows - 1) / 2, rows=rows, cols=cols)

    @property
    def matrix(self) -> Float[np.ndarray, "3 3"]:
        """C: camera coordinates to homogeneous pixels."""
        return np.array([[self.fx, 0, self.cx], [0, self.fy, self.cy], [0, 0, 1.0]])

    def scaled(self, rows: int, cols: int) -> "Intrinsics":
        """The camera of the same picture in so many rows and columns; its edges stay where they are."""
        down, across = rows / self.rows, cols / self.cols
        cx, cy = (self.cx + 0.5) * across - 0.5, (self.cy + 0.5) * down - 0.5
        return replace(self, fx=self.fx * across, fy=self.fy * down, cx=cx, cy=cy, rows=rows, cols=cols)

    def along(self, direction: Direction) -> "Intrinsics":
        """The camera of the frame turned so that its scanlines run from top to bottom, as `Direction.scanlines` turns it."""
        c, lens = self, self.distortion
        if direction in (Direction.LEFT_TO_RIGHT, Direction.RIGHT_TO_LEFT):
            lens = lens and lens.transposed()
            c = Intrinsics(fx=c.fy, fy=c.fx, cx=c.cy, cy=c.cx, rows=c.cols, cols=c.rows, distortion=lens)
        if direction in (Direction.BOTTOM_TO_TOP, Direction.RIGHT_TO_LEFT):
            c = replace(c, cy=c.rows - 1 - c.cy, distortion=lens and lens.flipped())
        return c


def ray_from_px(intrinsics: Intrinsics, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
    """(u, v) of the ray (u, v, 1) that the pixel (x, y) of the frame receives light along."""
    u, v = (x - intrinsics.cx) / intrinsics.fx, (y - intrinsics.cy) / intrinsics.fy
    return intrinsics.distortion.undistorted(u, v) if intrinsics.distortion else np.stack([u, v], axis=-1)


def px_from_ray(intrinsics: Intrinsics, u: Float[np.ndarray, "*n"], v: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
    """The pixel (x, y) where the ray (u, v, 1) is shown."""
    if intrinsics.distortion:
        u, v = np.moveaxis(intrinsics.distortion.distorted(u, v), -1, 0)
    return np.stack([intrinsics.fx * u + intrinsics.cx, intrinsics.fy * v + intrinsics.cy], axis=-1)


def pinhole_from_px(intrinsics: Intrinsics, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
    """Where a pinhole camera of the same C would show what the pixel (x, y) shows."""
    c = intrinsics
    return ray_from_px(c, x, y) * [c.fx, c.fy] + [c.cx, c.cy] if c.distortion else np.stack([x, y], axis=-1)


def px_from_pinhole(intrinsics: Intrinsics, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
    """The inverse of `pinhole_from_px`."""
    c = intrinsics
    return px_from_ray(c, (x - c.cx) / c.fx, (y - c.cy) / c.fy) if c.distortion else np.stack([x, y], axis=-1)


def _check_invertible(intrinsics: Intrinsics, lens: Distortion) -> None:
    """Refuse a lens that shows two rays at one pixel of the frame's border, or none."""
    c, along = intrinsics, np.linspace(0, 1, _BORDER)
    x, y = (np.concatenate(side) for side in ((along, along, 0 * along, 0 * along + 1), (0 * along, 0 * along + 1, along, along)))
    x, y = x * (c.cols - 1), y * (c.rows - 1)
    ray = ray_from_px(c, x, y)
    with np.errstate(all="ignore"):
        met = np.abs(px_from_ray(c, ray[:, 0], ray[:, 1]) - np.stack([x, y], axis=-1)).max(axis=-1) < _MET
        met &= (np.linalg.det(lens.slopes(ray[:, 0], ray[:, 1])) > 0) & (
            np.hypot(ray[:, 0], ray[:, 1]) <= math.tan(lens.reach) + _REACH_SLACK
        )
    if not met.all():
        edge = f"{math.degrees(lens.reach):.0f} degrees off its axis"
        why = f"sees farther than {edge}" if lens.reach == WIDEST else f"folds over {edge}"
        raise ValueError(
            f"the lens's distortion must map the frame of {c.cols} x {c.rows} px one to one, it {why} within it;"
            " do its coefficients belong to this mode and focal length?"
        )


@dataclass(frozen=True, kw_only=True)
class Camera:
    """A rolling-shutter camera as it takes a frame: when each scanline collects light, where its pixels look, how noisy they are."""

    timing: ShutterTiming
    intrinsics: Intrinsics  # of the frame as it is stored
    noise: Noise | None = None  # of the sensor; None where it is to be measured in each frame

    def along_scanlines(self) -> "Camera":
        """The same camera, turned with its frames so that the scanlines are read from top to bottom."""
        timing = replace(self.timing, direction=Direction.TOP_TO_BOTTOM)
        return replace(self, timing=timing, intrinsics=self.intrinsics.along(self.timing.direction))

    def exposed(self, seconds: float) -> "Camera":
        """The same camera at another exposure."""
        return replace(self, timing=replace(self.timing, exposure=seconds))

    def halved(self) -> "Camera":
        """The camera, along its scanlines, whose pixels are the means of two by two; an odd last row or column is left out."""
        timing, lens = self.timing, self.intrinsics
        rows, cols = lens.rows // 2, lens.cols // 2
        half = replace(lens, fx=lens.fx / 2, fy=lens.fy / 2, cx=lens.cx / 2 - 0.25, cy=lens.cy / 2 - 0.25, rows=rows, cols=cols)
        noise = self.noise and Noise(read=self.noise.read / 2, shot=self.noise.shot / 4)
        return Camera(timing=replace(timing, row_time=2 * timing.row_time, rows=rows), intrinsics=half, noise=noise)


def turned(
    intrinsics: Intrinsics, x: Float[np.ndarray, "*#n"], y: Float[np.ndarray, "*#n"], poses: Float[np.ndarray, "*#n axes"]
) -> Float[np.ndarray, "*n 2"]:
    """How far the sample of pixel (x, y) moves under each pose: w(x; p) - x of Eq. (4).

    Two axes are the paper's shift, the same for every pixel, whatever the lens; three are R = exp([(pitch, yaw, roll)]_x) between the
    lens's U and D, with yaw = x_px / fx, pitch = -y_px / fy.
    """
    if poses.shape[-1] == 2:
        return poses + 0.0 * (x + y)[..., None]
    lens = intrinsics.distortion
    shown = (x - intrinsics.cx) / intrinsics.fx, (y - intrinsics.cy) / intrinsics.fy
    u, v = np.moveaxis(lens.undistorted(*np.broadcast_arrays(*shown)), -1, 0) if lens else shown
    a, b, c = -poses[..., 1] / intrinsics.fy, poses[..., 0] / intrinsics.fx, poses[..., 2]
    angle2 = a * a + b * b + c * c
    angle = np.sqrt(angle2)
    sine = np.sinc(angle / np.pi)  # sin(angle) / angle
    cosine = 0.5 * np.sinc(angle / (2 * np.pi)) ** 2  # (1 - cos(angle)) / angle^2
    cross = (b - c * v, c * u - a, a * v - b * u)  # omega x (u, v, 1)
    twice = (b * cross[2] - c * cross[1], c * cross[0] - a * cross[2], a * cross[1] - b * cross[0])
    ray = [m + sine * p + cosine * q for m, p, q in zip((u, v, np.ones_like(u)), cross, twice, strict=True)]  # Rodrigues
    after = ray[0] / ray[2], ray[1] / ray[2]
    if lens:
        after = np.moveaxis(lens.distorted(*after), -1, 0)
    return np.stack([intrinsics.fx * (after[0] - shown[0]), intrinsics.fy * (after[1] - shown[1])], axis=-1)


def homography(intrinsics: Intrinsics, pose: Float[np.ndarray, " axes"]) -> Float[np.ndarray, "3 3"]:
    """C R C^-1 of Eq. (4): where every pixel of a pinhole camera samples the scene under one pose; `resampled_at` knows the lens."""
    if len(pose) == 2:
        return np.array([[1, 0, pose[0]], [0, 1, pose[1]], [0, 0, 1.0]])
    rotation = Rotation.from_rotvec([-pose[1] / intrinsics.fy, pose[0] / intrinsics.fx, pose[2]]).as_matrix()
    return intrinsics.matrix @ rotation @ np.linalg.inv(intrinsics.matrix)


def projected(matrix: Float[np.ndarray, "3 3"], x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n 2"]:
    """The image of the points (x, y) under a homography."""
    u, v, w = (row[0] * x + row[1] * y + row[2] for row in matrix)
    return np.stack([u / w, v / w], axis=-1)


def resampled_at(
    intrinsics: Intrinsics, pose: Float[np.ndarray, " axes"], x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"]
) -> Float[np.ndarray, "*n 2"]:
    """w(x; p): where the pixels (x, y) sample the scene under one pose, through the lens if there is one."""
    if intrinsics.distortion and len(pose) == 3:
        return np.stack([x, y], axis=-1) + turned(intrinsics, x, y, pose.reshape(*[1] * x.ndim, 3))
    return projected(homography(intrinsics, pose), x, y)


def lever(intrinsics: Intrinsics, x: Float[np.ndarray, "*n"], y: Float[np.ndarray, "*n"], axes: int) -> Float[np.ndarray, "*n 2 axes"]:
    """The derivative of `turned` in the pose at rest: how each axis moves the sample of pixel (x, y)."""
    out = np.zeros((*np.broadcast_shapes(x.shape, y.shape), 2, axes))
    if axes == 2:
        out[..., 0, 0] = out[..., 1, 1] = 1
        return out
    lens = intrinsics.distortion
    u, v = (
        np.moveaxis(ray_from_px(intrinsics, x, y), -1, 0)
        if lens
        else ((x - intrinsics.cx) / intrinsics.fx, (y - intrinsics.cy) / intrinsics.fy)
    )
    ratio = intrinsics.fx / intrinsics.fy
    out[..., 0, 0], out[..., 0, 1], out[..., 0, 2] = 1 + u * u, u * v * ratio, -v * intrinsics.fx
    out[..., 1, 0], out[..., 1, 1], out[..., 1, 2] = u * v / ratio, 1 + v * v, u * intrinsics.fy
    if lens:
        size = np.array([intrinsics.fx, intrinsics.fy])
        out = np.einsum("...ij,...ja->...ia", lens.slopes(u, v) * (size[:, None] / size), out)  # the chain rule, in px
    return out
