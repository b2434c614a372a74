"""Pictures blurred by a given motion, with their truth."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from rsvideo.api import arrays
from rsvideo.api.camera import Camera
from rsvideo.api.shutter import Shutter
from rsvideo.api.trajectory import Trajectory
from rsvideo.config import simulation
from rsvideo.physics import staging
from rsvideo.physics.camera import Camera as RollingShutterCamera
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import RENDERED, ShutterTiming
from rsvideo.physics.staging import Motion
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline import simulated_photograph
from rsvideo.pipeline.simulated_photograph import Optics


@dataclass(frozen=True, kw_only=True, eq=False)
class Simulated:
    """A picture as a moving camera would have taken it, and what it should have been.

    Attributes:
        blurred: In the kind of the sharp picture, smaller by what the motion shows beyond the frame.
        truth: The scene at the pose of the middle of the frame's interval, without noise; same shape and kind.
        trajectory: The motion; that pose is its origin.
        timing: The shutter: exposure, row_time and readout in s, rows, direction.
        camera: The lens in pixels of the frame.
        blur_px: Pixels from end to end of the longest streak of any row.
    """

    blurred: np.ndarray = field(repr=False)
    truth: np.ndarray = field(repr=False)
    trajectory: Trajectory = field(repr=False)
    timing: ShutterTiming
    camera: Intrinsics = field(repr=False)
    blur_px: float


def simulate(
    sharp: np.ndarray,
    *,
    shutter: Shutter,
    camera: Camera,
    motion: Mapping[str, Sequence[float]] | Trajectory | None = None,
    blur_px: float | None = None,
    noise: float | None = None,
    seed: int = 0,
    gain: float = 1.0,
    size: tuple[int, int] | None = None,
    samples: int = RENDERED,
    transfer: str | None = None,
) -> Simulated:
    """Render what a rolling-shutter camera would record of a sharp picture while it moves.

    The frame is the middle of the sharp picture, so much smaller that its borders show real content however the camera moves.

    Args:
        sharp: (rows, cols) or (rows, cols, 3): linear light as floating point, or uint8 or uint16 codes.
        shutter: Exposure and readout; the readout may be the profile's. The direction is top-to-bottom unless stated.
        camera: The focal length in pixels of `sharp`; or a profile, of whose whole picture the frame then has the shape and the lens.
        motion: A random hand-shake by `seed` unless given; x and y in px and roll in rad by the coefficients of 1, u, u^2, ..., where u
            goes from 0 to 1 over the frame's interval, such as {"x": [0, 12, -4]}; or a `Trajectory`.
        blur_px: Scale the motion so that the longest streak of any row spans this.
        noise: Standard deviation of read and shot noise at half of white, in linear light. [default: the profile's, or 0.003]
        seed: Of the hand-shake and of the noise.
        gain: Multiplies the light, so that highlights clip.
        size: (rows, cols) of the frame. [default: all that the motion leaves in view]
        samples: Time samples a row.
        transfer: What codes mean, by name. [default: "srgb"]

    Raises:
        ValueError: A value cannot be meant, or the picture is too small for the motion; the line says which.
        TypeError: The picture is no array, or of another kind.

    Examples:
        >>> import numpy as np, rsvideo
        >>> sharp = np.random.default_rng(0).random((80, 120))
        >>> shutter = rsvideo.Shutter(exposure="1/60", readout="10ms")
        >>> shot = rsvideo.simulate(sharp, shutter=shutter, camera=rsvideo.Camera(focal_px=150), motion={"x": [0, 6]}, size=(64, 96))
        >>> shot.blurred.shape, shot.blurred.dtype.name, round(shot.blur_px, 2)
        ((64, 96), 'float32', 3.75)
        >>> shot.trajectory.at(shot.timing.interval[1]).round(6).tolist()  # px right, px down, rad of roll; 0 in the middle
        [3.0, 0.0, 0.0]
    """
    light = arrays.light("sharp", sharp, arrays.curve(sharp, transfer) or Transfer.SRGB)
    optics = _optics(shutter, camera, noise, size)
    simulated_photograph.check_gain(gain)
    staged = optics.stage(light.pixels.shape[:2], _motion(motion, seed), frame=size, blur=blur_px)
    rendering = simulated_photograph.rendered(light.pixels, staged, optics.noise, seed=seed, samples=samples, gain=gain)
    return Simulated(
        blurred=light.like_source(rendering.blurred),
        truth=light.like_source(rendering.truth),
        trajectory=Trajectory(curve=staged.trajectory),
        timing=staged.camera.timing,
        camera=staged.camera.intrinsics,
        blur_px=staged.blur,
    )


def _optics(shutter: Shutter, camera: Camera, noise: float | None, size: tuple[int, int] | None) -> Optics:
    stated = simulation.Camera(
        profile=camera.profile,
        exposure=shutter.exposure,
        readout=shutter.readout,
        direction=shutter.direction,
        focal_px=camera.focal_px,
    )
    optics = simulated_photograph.optics(stated, noise)
    if camera.distortion is None:
        return optics
    if (lens := optics.lens) is None:
        if size is None:
            raise ValueError("size must be given to simulate with distortion, which belongs to a frame of that size")
        lens = Intrinsics.centred(focal=camera.focal_px or 0.0, rows=size[0], cols=size[1])
    return replace(optics, focal=None, lens=camera.bent(lens))


def _motion(motion: Mapping[str, Sequence[float]] | Trajectory | None, seed: int) -> Motion:
    if motion is None:
        return staging.hand(seed)
    if isinstance(motion, Mapping):
        return staging.polynomial(motion)

    def given(camera: RollingShutterCamera):
        motion.check_covers(camera.timing.interval)
        return motion.curve

    return given
