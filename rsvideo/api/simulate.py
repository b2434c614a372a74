"""Pictures blurred by a given motion, with their truth."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from rsvideo.api import arrays
from rsvideo.api.arrays import Light
from rsvideo.api.camera import Camera
from rsvideo.api.shutter import Shutter
from rsvideo.api.trajectory import Trajectory
from rsvideo.physics import staging
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.simulate import MOST_GAIN, SAMPLES, USUAL_NOISE, extent, render
from rsvideo.physics.staging import Motion, Stage
from rsvideo.physics.tone import Transfer
from rsvideo.shooting import profiles
from rsvideo.shooting.profiles import Facts


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
    samples: int = SAMPLES,
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
    light, facts = arrays.light("sharp", sharp, arrays.curve(sharp, transfer) or Transfer.SRGB), _facts(camera)
    staged = _staged(light, shutter, camera, facts, motion=_motion(motion, seed), size=size, blur_px=blur_px)
    shot = {"camera": staged.camera, "timing": staged.timing, "trajectory": staged.trajectory}
    rng = np.random.default_rng([seed, 1])  # not the hand's numbers
    rendering = render(light.pixels, **shot, noise=_noise(facts, noise), rng=rng, samples=samples, gain=_checked_gain(gain))
    return Simulated(
        blurred=light.like_source(rendering.blurred),
        truth=light.like_source(rendering.truth),
        trajectory=Trajectory(curve=staged.trajectory),
        timing=staged.timing,
        camera=staged.camera,
        blur_px=extent(**shot),
    )


def _noise(facts: Facts | None, sigma: float | None) -> Noise:
    """Of `sigma` at half of white, else the profile's, else the usual one."""
    if sigma is None and facts and facts.noise:
        return facts.noise
    return Noise.at_half(USUAL_NOISE if sigma is None else sigma)


def _facts(camera: Camera) -> Facts | None:
    """What the camera's profile states, in its own pixels."""
    if camera.profile is None:
        return None
    profile = profiles.find(camera.profile)
    return profiles.for_clip(profile, profile.mode.rows, profile.mode.cols, None)[0]


def _staged(
    light: Light,
    shutter: Shutter,
    camera: Camera,
    facts: Facts | None,
    *,
    motion: Motion,
    size: tuple[int, int] | None,
    blur_px: float | None,
) -> Stage:
    """The frame in the middle of the picture."""
    readout = facts.readout.value if facts and facts.readout and shutter.readout is None else shutter.readout
    if shutter.exposure is None or readout is None:
        missing = "readout" if shutter.exposure else "exposure"
        raise ValueError(f"{missing} must be given to simulate; Shutter(exposure='1/50', readout='20ms')")
    lens = facts.intrinsics if facts and camera.focal_px is None else None
    if camera.focal_px is None and lens is None:
        raise ValueError("focal-px must be given to simulate; Camera(focal_px=...), or a profile that holds the lens")
    if camera.distortion and lens is None:
        if size is None:
            raise ValueError("size must be given to simulate with distortion, which belongs to a frame of that size")
        lens = Intrinsics.centred(focal=camera.focal_px or 0.0, rows=size[0], cols=size[1])
    direction = facts.direction.value if facts and facts.direction else Direction.TOP_TO_BOTTOM
    return staging.stage(
        *light.pixels.shape[:2],
        motion=motion,
        focal=None if lens else camera.focal_px,
        lens=camera.bent(lens) if lens else None,
        exposure=shutter.exposure,
        readout=readout,
        direction=shutter.direction or direction,
        frame=size,
        blur=blur_px,
    )


def _checked_gain(gain: float) -> float:
    if not (math.isfinite(gain) and 0 < gain <= MOST_GAIN):
        raise ValueError(f"gain must lie in (0, {MOST_GAIN:g}], got {gain:g}")
    return gain


def _motion(motion: Mapping[str, Sequence[float]] | Trajectory | None, seed: int) -> Motion:
    if motion is None:
        return staging.hand(seed)
    if isinstance(motion, Mapping):
        return staging.polynomial(motion)

    def given(_: Intrinsics, timing: ShutterTiming):
        motion.check_covers(timing.interval)
        return motion.curve

    return given
