"""Renders what a rolling-shutter camera records of a sharp photograph, and the sharp truth beside it.

For every scanline and every time sample the full homography C R C^-1 (Eq. 4), with R = exp([(pitch, yaw, roll)]_x), between
undistorted rays where the lens distorts; Catmull-Rom sampling at exact positions in linear light, of a photograph that was taken
through the same lens. This is the slow twin of the blur operator and shares nothing with it but the nouns.
"""

import math
from dataclasses import dataclass
from typing import no_type_check

import numpy as np
from jaxtyping import Float, Float32
from scipy.spatial.transform import Rotation

from rsvideo.physics.bent import bent, packed
from rsvideo.physics.camera import LEAST_DEPTH, Camera, Intrinsics, pinhole_from_px, px_from_pinhole
from rsvideo.physics.gyro import angles_from_poses
from rsvideo.physics.noise import Noise
from rsvideo.physics.resampling import add_sample
from rsvideo.physics.shutter import RENDERED
from rsvideo.physics.trajectory import Trajectory
from rsvideo.progress import Observer, Progress, ignore
from rsvideo.threads import loop, spread

BAND = 32  # scanlines rendered between two reports of progress, and before an interrupt stops the work; origin: by trial
MOST_GAIN = 1000.0  # that multiplies light; more is no exposure that anybody means
STILL = 1e-9  # px; a motion whose longest PSF is shorter does not move
_INSTANTS = 257  # of a frame's interval, at which the reach of its motion is measured; origin: by trial
_EXPOSURE_INSTANTS = 33  # of a scanline's exposure, between which the ends of its PSF are looked for; origin: by trial
_TAPS = 3  # px that a sample may read beyond its place, and rounding


@dataclass(frozen=True, kw_only=True, eq=False)
class Rendering:
    """A frame as the camera wrote it, and what it should have been."""

    blurred: Float32[np.ndarray, "rows cols channels"]  # linear light in [0, 1]
    truth: Float32[np.ndarray, "rows cols channels"]  # the scene at the pose of the middle of the frame's interval, without noise


def render(
    scene: Float[np.ndarray, "scene_rows scene_cols channels"],
    *,
    camera: Camera,
    trajectory: Trajectory,
    noise: Noise,
    rng: np.random.Generator,
    samples: int = RENDERED,
    gain: float = 1.0,
    observe: Observer = ignore,
) -> Rendering:
    """The frame of `camera` at the middle of a `scene` in linear light, which is larger so that its borders show real content.

    Poses are those of the image in every direction of readout. Light above white / gain clips, in the truth too.
    """
    blurred = gain * blur(scene, camera=camera, trajectory=trajectory, samples=samples, observe=observe)
    blurred = noise.added_to(blurred, rng)
    truth = gain * still(scene, intrinsics=camera.intrinsics, pose=trajectory.at(np.array([camera.timing.middle]))[0])
    return Rendering(blurred=np.clip(blurred, 0, 1).astype(np.float32), truth=np.clip(truth, 0, 1).astype(np.float32))


def blur(
    scene: Float[np.ndarray, "scene_rows scene_cols channels"],
    *,
    camera: Camera,
    trajectory: Trajectory,
    samples: int = RENDERED,
    observe: Observer = ignore,
) -> Float[np.ndarray, "rows cols channels"]:
    """The noiseless, unclipped light of each pixel: the mean over its scanline's exposure (Eq. 3), in float64."""
    if samples < 1:
        raise ValueError(f"a scanline needs at least 1 time sample, got {samples}")
    timing, intrinsics = camera.timing, camera.intrinsics
    x, y = (timing.direction.scanlines(part) for part in _pixels(intrinsics))
    if timing.rows != len(x):
        raise ValueError(f"the shutter reads {timing.rows} scanlines, the frame has {len(x)} {timing.direction.value}")
    times = timing.sample_times(samples)
    poses = trajectory.at(times.ravel())
    maps = homographies(poses, intrinsics=intrinsics).reshape(*times.shape, 3, 3)
    return timing.direction.image(_sampled_through(scene, x, y, maps, intrinsics=intrinsics, observe=observe))


def still(
    scene: Float[np.ndarray, "scene_rows scene_cols channels"], *, intrinsics: Intrinsics, pose: Float[np.ndarray, " axes"]
) -> Float[np.ndarray, "rows cols channels"]:
    """The sharp frame at one pose."""
    x, y = _pixels(intrinsics)
    maps = np.broadcast_to(homographies(pose[None], intrinsics=intrinsics), (len(x), 1, 3, 3))
    return _sampled_through(scene, x, y, maps, intrinsics=intrinsics, observe=ignore)


def homographies(poses: Float[np.ndarray, "n axes"], *, intrinsics: Intrinsics) -> Float[np.ndarray, "n 3 3"]:
    """C R C^-1 of each pose: takes a pixel of the camera at that time to the pixel of the latent image that it sees, without distortion."""
    R = Rotation.from_rotvec(angles_from_poses(poses, camera=intrinsics)).as_matrix()
    C = intrinsics.matrix
    return C @ R @ np.linalg.inv(C)


def margin(*, camera: Camera, trajectory: Trajectory) -> tuple[int, int]:
    """Rows and columns of scene needed beyond each edge of the frame, so that no sample falls outside the scene."""
    lens = camera.intrinsics
    poses = trajectory.at(np.linspace(*camera.timing.interval, _INSTANTS))
    xs, ys = np.array([0.0, lens.cx, lens.cols - 1]), np.array([0.0, lens.cy, lens.rows - 1])
    x, y = (part.ravel() for part in np.meshgrid(xs, ys))
    mapped = homographies(poses, intrinsics=lens) @ np.stack([*pinhole_from_px(lens, x, y).T, np.ones(9)])
    if not (mapped[:, 2] > LEAST_DEPTH).all():
        raise ValueError("the motion turns the camera by almost a right angle; is the focal length too short?")
    shown = px_from_pinhole(lens, mapped[:, 0] / mapped[:, 2], mapped[:, 1] / mapped[:, 2])
    move = np.abs(shown - np.stack([x, y], axis=-1)).max(axis=(0, 1))
    return math.ceil(move[1]) + _TAPS, math.ceil(move[0]) + _TAPS


def extent(*, camera: Camera, trajectory: Trajectory) -> float:
    """Pixels from end to end of the longest PSF, over all scanlines and the frame's centre and corners, to first order, undistorted."""
    timing, lens = camera.timing, camera.intrinsics
    times = timing.row_start()[:, None] + np.linspace(0, timing.exposure, _EXPOSURE_INSTANTS)
    poses = trajectory.at(times.ravel()).reshape(timing.rows, _EXPOSURE_INSTANTS, -1)
    x = np.array([lens.cx, 0, 0, lens.cols - 1, lens.cols - 1]) - lens.cx
    y = np.array([lens.cy, 0, lens.rows - 1, 0, lens.rows - 1]) - lens.cy
    roll = poses[..., 2:] if poses.shape[-1] == 3 else np.zeros((*poses.shape[:2], 1))
    path = (poses[..., :1] - roll * y) + 1j * (poses[..., 1:2] + roll * x)
    longest = 0.0
    for lag in range(1, _EXPOSURE_INSTANTS):
        longest = max(longest, float(np.abs(path[:, lag:] - path[:, :-lag]).max()))
    return longest


def scaled_to(pixels: float, *, camera: Camera, trajectory: Trajectory) -> Trajectory:
    """The same motion, larger or smaller, so that its longest PSF spans `pixels`; its middle is the origin."""
    if not (math.isfinite(pixels) and pixels >= 0):
        raise ValueError(f"blur must be at least 0 px, got {pixels:g} px")
    longest = extent(camera=camera, trajectory=trajectory)
    if longest < STILL:
        raise ValueError(f"a motion of {longest:.2g} px cannot be scaled to {pixels:g} px; does it move at all?")
    middle = trajectory.at(np.array([camera.timing.middle]))[0]
    gauge = trajectory.shifted(-middle)
    return gauge.with_coefficients(gauge.coefficients * (pixels / longest))


def _pixels(intrinsics: Intrinsics) -> tuple[Float[np.ndarray, "rows cols"], Float[np.ndarray, "rows cols"]]:
    x, y = np.meshgrid(np.arange(intrinsics.cols, dtype=float), np.arange(intrinsics.rows, dtype=float))
    return x, y


def _sampled_through(
    scene: Float[np.ndarray, "scene_rows scene_cols channels"],
    x: Float[np.ndarray, "lines along"],
    y: Float[np.ndarray, "lines along"],
    maps: Float[np.ndarray, "lines samples 3 3"],
    *,
    intrinsics: Intrinsics,
    observe: Observer,
) -> Float[np.ndarray, "lines along channels"]:
    """The mean over `maps` of a line of the scene at the mapped positions of the line's pixels; the frame is the scene's middle."""
    rows, cols = scene.shape[:2]
    if rows < intrinsics.rows or cols < intrinsics.cols:
        raise ValueError(f"the scene must be at least as large as the frame ({intrinsics.rows} x {intrinsics.cols}), got {rows} x {cols}")
    top, left = float((rows - intrinsics.rows) // 2), float((cols - intrinsics.cols) // 2)
    ideal = pinhole_from_px(intrinsics, x, y)
    scene, x, y, maps = (np.ascontiguousarray(part) for part in (scene, ideal[..., 0], ideal[..., 1], maps))
    lens, bands = packed(intrinsics), []
    for start in range(0, len(x), BAND):
        band = slice(start, start + BAND)
        mean = np.empty((*x[band].shape, scene.shape[2]))
        spread(_mean_of_samples, len(mean), scene, x[band], y[band], maps[band], lens, left, top, mean)
        bands.append(mean)
        observe(Progress(stage="rendering", fraction=min(start + BAND, len(x)) / len(x)))
    return np.concatenate(bands)


@no_type_check
@loop(fastmath=False)
def _mean_of_samples(first, last, scene, x, y, maps, lens, left, top, result):
    channels = scene.shape[2]
    along, samples = x.shape[1], maps.shape[1]
    for i in range(first, last):
        total = np.empty(channels)
        for j in range(along):
            total[:] = 0.0
            for k in range(samples):
                H = maps[i, k]
                w = H[2, 0] * x[i, j] + H[2, 1] * y[i, j] + H[2, 2]
                u = (H[0, 0] * x[i, j] + H[0, 1] * y[i, j] + H[0, 2]) / w
                v = (H[1, 0] * x[i, j] + H[1, 1] * y[i, j] + H[1, 2]) / w
                u, v, _, _, _, _ = bent(u, v, lens)
                add_sample(total, scene, u + left, v + top, 1.0)
            for q in range(channels):
                result[i, j, q] = total[q] / samples
