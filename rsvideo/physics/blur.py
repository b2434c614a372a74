"""What a moving rolling-shutter camera writes of a latent image, pixel by pixel: K(theta), its transpose and its derivative."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Int
from numba import njit
from scipy.spatial.transform import Rotation

from rsvideo.physics.bent import bent, packed
from rsvideo.physics.camera import LEAST_DEPTH, Camera, Intrinsics, pinhole_from_px, px_from_pinhole
from rsvideo.physics.gyro import angles_from_poses
from rsvideo.physics.rotation import cross, left_jacobian
from rsvideo.physics.trajectory import Trajectory
from rsvideo.physics.warp import taps
from rsvideo.threads import loop, most, spread

SAMPLES = 30  # K of Eq. (3); the paper's (Sec. 5)
PARTS = 8  # private copies of the latent image, at most, into which threads scatter
_REACH_COLS = 5  # columns of each scanline at which the largest move is looked for; a homography moves the ends most


@dataclass(frozen=True, kw_only=True, eq=False)
class BlurOperator:
    """b = K(theta) l, Eq. (5) and (7), with bilinear interpolation.

    A trajectory of three axes turns the camera: every pixel and time sample goes through the homography C R C^-1 of Eq. (4), with
    R = exp([(pitch, yaw, roll)]_x), yaw = x / fx, pitch = -y / fy, and through the lens where it distorts. One of two axes is the
    paper's shift: all pixels of a scanline move alike. The latent image reaches `margin` beyond the frame on every side; samples
    beyond that see nothing.
    """

    camera: Camera
    trajectory: Trajectory
    samples: int = SAMPLES
    margin: tuple[int, int]  # rows above and below, columns left and right of the frame

    @classmethod
    def covering(cls, trajectory: Trajectory, *, camera: Camera, samples: int = SAMPLES, slack: int = 2) -> "BlurOperator":
        """The operator whose latent image holds all that the frame sees, and `slack` pixels more for the path to change."""
        bare = cls(camera=camera, trajectory=trajectory, samples=samples, margin=(0, 0))
        if bare.is_shift:
            x, y = np.abs(bare.displacement).max(axis=(0, 1)) @ np.abs(camera.timing.direction.pose_from_scanlines[:2, :2]).T
        else:
            x, y = _reach(bare._maps, bare._scan_intrinsics, bare._image_from_scan)
        margin = math.ceil(y) + 1 + slack, math.ceil(x) + 1 + slack
        return cls(camera=camera, trajectory=trajectory, samples=samples, margin=margin)

    def __post_init__(self) -> None:
        timing = self.camera.timing
        across = timing.direction.scanlines(np.empty(self.frame_shape)).shape[0]
        if across != timing.rows:
            raise ValueError(f"the shutter reads {timing.rows} scanlines, the frame has {across} {timing.direction.value}")

    @property
    def is_shift(self) -> bool:
        """Whether all pixels of a scanline share their path."""
        return self.trajectory.coefficients.shape[1] == 2

    @property
    def frame_shape(self) -> tuple[int, int]:
        """Rows and columns of what the camera writes."""
        return self.camera.intrinsics.rows, self.camera.intrinsics.cols

    @property
    def latent_shape(self) -> tuple[int, int]:
        """Rows and columns of the latent image."""
        rows, cols = self.frame_shape
        return rows + 2 * self.margin[0], cols + 2 * self.margin[1]

    @property
    def inside(self) -> tuple[slice, slice]:
        """Where the frame lies in the latent image."""
        (top, left), (rows, cols) = self.margin, self.frame_shape
        return slice(top, top + rows), slice(left, left + cols)

    def forward(self, latent: Float[np.ndarray, "latent_rows latent_cols"]) -> Float[np.ndarray, "rows cols"]:
        """K l: the mean of the latent image over each scanline's exposure, Eq. (3)."""
        L = self._scanlines(latent)
        out = np.zeros((self.camera.timing.rows, self._along), latent.dtype)
        if self.is_shift:
            spread(_shift_forward, len(out), L, *self._taps(latent.dtype), out)
        else:
            spread(_turn_forward, len(out), L, self._maps, self._ideal, packed(self._scan_intrinsics), *self._scan_margin, out)
        return self._image(out)

    def adjoint(self, frame: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "latent_rows latent_cols"]:
        """K^T b."""
        b = self._scanlines(frame)
        top, left = self._scan_margin
        shape = (self.camera.timing.rows + 2 * top, self._along + 2 * left)
        if self.is_shift:
            out = np.zeros(shape, frame.dtype)
            spread(_shift_adjoint, len(out), b, *self._taps(frame.dtype), out)
            return self._image(out)
        parts = np.zeros((min(PARTS, most()), *shape), frame.dtype)
        spread(_turn_adjoint, len(parts), b, self._maps, self._ideal, packed(self._scan_intrinsics), top, left, parts)
        return self._image(parts.sum(axis=0))

    def jacobian(self, latent: Float[np.ndarray, "latent_rows latent_cols"]) -> Float[np.ndarray, "terms axes rows cols"]:
        """d(K l) / d theta: the mean of J_L(w) J_w(p) J_p(theta), Eq. (13) without its minus."""
        L = self._scanlines(latent)
        J_p = self.trajectory.basis(self._times).astype(latent.dtype)
        axes = 2 if self.is_shift else 3
        out = np.zeros((J_p.shape[-1], axes, self.camera.timing.rows, self._along), latent.dtype)
        if self.is_shift:
            spread(_shift_jacobian, self.camera.timing.rows, L, *self._taps(latent.dtype), J_p, out)
            P = self.camera.timing.direction.pose_from_scanlines[:2, :2].astype(latent.dtype)
            out = np.einsum("as,tsij->taij", P, out)
        else:
            how = self._maps, self._map_derivatives, self._ideal, packed(self._scan_intrinsics), J_p, *self._scan_margin
            spread(_turn_jacobian, self.camera.timing.rows, L, *how, out)
        return np.ascontiguousarray(np.array([[self.camera.timing.direction.image(part) for part in term] for term in out]))

    def psf(self, row: int, col: int) -> Float[np.ndarray, "k k"]:
        """The kernel k of b = k * l about one pixel, odd and centred: its mass lies at minus the pose."""
        at = np.zeros(self.frame_shape)
        at[row, col] = 1
        weights = self.adjoint(at)  # a row of K: where the pixel's light comes from
        y, x = np.nonzero(weights)
        r, c = row + self.margin[0], col + self.margin[1]
        half = int(max(np.abs(y - r).max(), np.abs(x - c).max(), 0)) if len(y) else 0
        weights = np.pad(weights, half)[r : r + 2 * half + 1, c : c + 2 * half + 1]
        return weights[::-1, ::-1].copy()

    @property
    def _along(self) -> int:
        """Pixels of one scanline."""
        rows, cols = self.frame_shape
        return rows * cols // self.camera.timing.rows

    @property
    def _scan_margin(self) -> tuple[int, int]:
        swapped = self.camera.timing.direction.pose_from_scanlines[0, 0] == 0
        return (self.margin[1], self.margin[0]) if swapped else self.margin

    @property
    def _times(self) -> Float[np.ndarray, "scanlines samples"]:
        return self.camera.timing.sample_times(self.samples)

    def _scanlines(self, image: Float[np.ndarray, "r c"]) -> Float[np.ndarray, "scanlines along"]:
        return np.ascontiguousarray(self.camera.timing.direction.scanlines(image))

    def _image(self, scanlines: Float[np.ndarray, "scanlines along"]) -> Float[np.ndarray, "r c"]:
        return np.ascontiguousarray(self.camera.timing.direction.image(scanlines))

    @cached_property
    def displacement(self) -> Float[np.ndarray, "scanlines samples 2"]:
        """Offsets (along, across) the scanlines, of each scanline and sample, where the trajectory is a shift."""
        return self.trajectory.at(self._times)[..., :2] @ self.camera.timing.direction.pose_from_scanlines[:2, :2]

    def _taps(self, dtype: np.dtype) -> tuple[Int[np.ndarray, "s k"], Float[np.ndarray, "s k 2"], Int[np.ndarray, "s k"], np.ndarray]:
        """Rows and columns of the latent image under a scanline's first pixel, and their weights."""
        top, left = self._scan_margin
        row, row_weights = taps(self.displacement[..., 1])
        col, col_weights = taps(self.displacement[..., 0])
        row += top + np.arange(self.camera.timing.rows)[:, None]
        return row, row_weights.astype(dtype), col + left, col_weights.astype(dtype)

    @cached_property
    def _image_from_scan(self) -> Float[np.ndarray, "3 3"]:
        """Takes (along, scanline, 1) to the pixel (x, y, 1)."""
        A = np.eye(3)
        A[:2, :2] = self.camera.timing.direction.pose_from_scanlines[:2, :2]
        last = np.array([self.camera.intrinsics.cols - 1, self.camera.intrinsics.rows - 1])
        A[:2, 2] = np.where(A[:2, :2].sum(axis=1) < 0, last, 0)
        return A

    @cached_property
    def _rotations(self) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
        omega = angles_from_poses(self.trajectory.at(self._times.ravel()), camera=self.camera.intrinsics)
        return omega, Rotation.from_rotvec(omega).as_matrix()

    @cached_property
    def _maps(self) -> Float[np.ndarray, "scanlines samples 3 3"]:
        """The homographies H = C R C^-1 of Eq. (4), from scanline coordinates to scanline coordinates."""
        left, right = self._around
        return (left @ self._rotations[1] @ right).reshape(*self._times.shape, 3, 3)

    @cached_property
    def _map_derivatives(self) -> Float[np.ndarray, "scanlines samples 3 3 3"]:
        """J_w(p) in homogeneous coordinates: dH / d(x, y, roll)."""
        left, right = self._around
        omega, R = self._rotations
        fx, fy = self.camera.intrinsics.fx, self.camera.intrinsics.fy
        d_omega = np.array([[0, 1 / fx, 0], [-1 / fy, 0, 0], [0, 0, 1.0]])  # of (x, y, roll), a row each
        turned = d_omega @ left_jacobian(omega).swapaxes(-1, -2)
        dR = cross(turned) @ R[:, None]
        return (left @ dR @ right).reshape(*self._times.shape, 3, 3, 3)

    @cached_property
    def _scan_intrinsics(self) -> Intrinsics:
        return self.camera.intrinsics.along(self.camera.timing.direction)

    @cached_property
    def _ideal(self) -> Float[np.ndarray, "scanlines along 2"]:
        """Where a pinhole camera would show what the frame's pixels show, in scanline coordinates, which `_maps` take."""
        x, y = np.meshgrid(np.arange(self._along, dtype=float), np.arange(self.camera.timing.rows, dtype=float))
        return pinhole_from_px(self._scan_intrinsics, x, y)

    @property
    def _around(self) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"]]:
        around = np.linalg.inv(self._image_from_scan) @ self.camera.intrinsics.matrix
        return around, np.linalg.inv(around)


def _reach(maps: Float[np.ndarray, "s k 3 3"], lens: Intrinsics, image_from_scan: Float[np.ndarray, "3 3"]) -> tuple[float, float]:
    """The largest move of any pixel in the image's x and y."""
    x, y = np.meshgrid(np.linspace(0, lens.cols - 1, _REACH_COLS), np.arange(lens.rows, dtype=float))
    at = np.concatenate([np.moveaxis(pinhole_from_px(lens, x, y), -1, 0), np.ones_like(x)[None]])  # (3, scanlines, columns)
    mapped = np.einsum("skab,bsc->aksc", maps, at)
    if not (mapped[2] > LEAST_DEPTH).all():
        raise ValueError("the motion turns the camera by almost a right angle; is the focal length too short?")
    shown = np.moveaxis(px_from_pinhole(lens, mapped[0] / mapped[2], mapped[1] / mapped[2]), -1, 0)
    move = np.abs(image_from_scan[:2, :2]) @ np.abs(shown - np.stack([x, y])[:, None]).reshape(2, -1)
    return float(move[0].max()), float(move[1].max())


@no_type_check
@njit(cache=True, inline="always")
def _span(col, along, cols):
    """The pixels of a scanline whose tap at `col` lies within the latent image."""
    return max(0, -col), min(along, cols - col)


@no_type_check
@loop()
def _shift_forward(first, last, L, row, row_weights, col, col_weights, out):
    rows, cols = L.shape
    samples = row.shape[1]
    along = out.shape[1]
    share = out.dtype.type(1) / out.dtype.type(samples)
    for i in range(first, last):
        for k in range(samples):
            for m in range(2):
                r = row[i, k] + m
                if 0 <= r < rows:
                    for n in range(2):
                        w = row_weights[i, k, m] * col_weights[i, k, n] * share
                        c = col[i, k] + n
                        start, stop = _span(c, along, cols)
                        for j in range(start, stop):
                            out[i, j] += w * L[r, c + j]


@no_type_check
@loop()
def _shift_adjoint(first, last, b, row, row_weights, col, col_weights, out):
    cols = out.shape[1]
    lines, samples = row.shape
    along = b.shape[1]
    share = b.dtype.type(1) / b.dtype.type(samples)
    lowest = np.empty(lines, np.int64)
    highest = np.empty(lines, np.int64)
    for i in range(lines):
        lowest[i] = row[i].min()
        highest[i] = row[i].max() + 1
    for r in range(first, last):  # gathers, so that no two threads write one row
        for i in range(lines):
            if lowest[i] <= r <= highest[i]:
                for k in range(samples):
                    m = r - row[i, k]
                    if 0 <= m < 2:
                        for n in range(2):
                            w = row_weights[i, k, m] * col_weights[i, k, n] * share
                            c = col[i, k] + n
                            start, stop = _span(c, along, cols)
                            for j in range(start, stop):
                                out[r, c + j] += w * b[i, j]


@no_type_check
@loop()
def _shift_jacobian(first, last, L, row, row_weights, col, col_weights, J_p, out):
    """out[p, (along, across), i, j]: the slopes of the bilinear cell under each sample, times the basis."""
    rows, cols = L.shape
    samples = row.shape[1]
    terms, along = out.shape[0], out.shape[3]
    share = out.dtype.type(1) / out.dtype.type(samples)
    for i in range(first, last):
        slope = np.zeros((2, along), out.dtype)
        for k in range(samples):
            slope[:] = 0
            for m in range(2):
                r = row[i, k] + m
                if 0 <= r < rows:
                    for n in range(2):
                        w_x = row_weights[i, k, m] * (2 * n - 1) * share
                        w_y = col_weights[i, k, n] * (2 * m - 1) * share
                        c = col[i, k] + n
                        start, stop = _span(c, along, cols)
                        for j in range(start, stop):
                            slope[0, j] += w_x * L[r, c + j]
                            slope[1, j] += w_y * L[r, c + j]
            for p in range(terms):
                for a in range(2):
                    for j in range(along):
                        out[p, a, i, j] += J_p[i, k, p] * slope[a, j]


@no_type_check
@njit(cache=True, inline="always")
def _mapped(H, x, y):
    """w(x; p) of Eq. (4)."""
    w = H[2, 0] * x + H[2, 1] * y + H[2, 2]
    return (H[0, 0] * x + H[0, 1] * y + H[0, 2]) / w, (H[1, 0] * x + H[1, 1] * y + H[1, 2]) / w, w


@no_type_check
@loop()
def _turn_forward(first, last, L, maps, ideal, lens, top, left, out):
    rows, cols = L.shape
    along, samples = out.shape[1], maps.shape[1]
    for i in range(first, last):
        for j in range(along):
            total = 0.0
            for k in range(samples):
                x, y, _ = _mapped(maps[i, k], ideal[i, j, 0], ideal[i, j, 1])
                x, y, _, _, _, _ = bent(x, y, lens)
                c, r = int(np.floor(x)), int(np.floor(y))
                a, b = x - c, y - r
                for m in range(2):
                    for n in range(2):
                        u, v = r + m + top, c + n + left
                        if 0 <= u < rows and 0 <= v < cols:
                            total += (b if m else 1 - b) * (a if n else 1 - a) * L[u, v]
            out[i, j] = total / samples


@no_type_check
@loop()
def _turn_adjoint(first, last, frame, maps, ideal, lens, top, left, parts):
    count, rows, cols = parts.shape
    lines, along = frame.shape
    samples = maps.shape[1]
    for part in range(first, last):
        for i in range(part * lines // count, (part + 1) * lines // count):
            for j in range(along):
                value = frame[i, j] / samples
                for k in range(samples):
                    x, y, _ = _mapped(maps[i, k], ideal[i, j, 0], ideal[i, j, 1])
                    x, y, _, _, _, _ = bent(x, y, lens)
                    c, r = int(np.floor(x)), int(np.floor(y))
                    a, b = x - c, y - r
                    for m in range(2):
                        for n in range(2):
                            u, v = r + m + top, c + n + left
                            if 0 <= u < rows and 0 <= v < cols:
                                parts[part, u, v] += (b if m else 1 - b) * (a if n else 1 - a) * value


@no_type_check
@loop()
def _turn_jacobian(first, last, L, maps, derivatives, ideal, lens, J_p, top, left, out):
    rows, cols = L.shape
    terms, _, _, along = out.shape
    samples = maps.shape[1]
    for i in range(first, last):
        total = np.zeros((terms, 3))
        for j in range(along):
            total[:] = 0
            for k in range(samples):
                u, v, w = _mapped(maps[i, k], ideal[i, j, 0], ideal[i, j, 1])
                x, y, xu, xv, yu, yv = bent(u, v, lens)
                c, r = int(np.floor(x)), int(np.floor(y))
                a, b = x - c, y - r
                L_x, L_y = 0.0, 0.0
                for m in range(2):
                    for n in range(2):
                        row, col = r + m + top, c + n + left
                        if 0 <= row < rows and 0 <= col < cols:
                            L_x += (b if m else 1 - b) * (2 * n - 1) * L[row, col]
                            L_y += (a if n else 1 - a) * (2 * m - 1) * L[row, col]
                L_u, L_v = L_x * xu + L_y * yu, L_x * xv + L_y * yv
                for q in range(3):
                    D = derivatives[i, k, q]
                    s, t = ideal[i, j, 0], ideal[i, j, 1]
                    d_w = D[2, 0] * s + D[2, 1] * t + D[2, 2]
                    d_u = (D[0, 0] * s + D[0, 1] * t + D[0, 2] - u * d_w) / w
                    d_v = (D[1, 0] * s + D[1, 1] * t + D[1, 2] - v * d_w) / w
                    slope = L_u * d_u + L_v * d_v
                    for p in range(terms):
                        total[p, q] += slope * J_p[i, k, p]
            for p in range(terms):
                for q in range(3):
                    out[p, q, i, j] = total[p, q] / samples
