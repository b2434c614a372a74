"""A frame along its scanlines: turned once before restoration, which reads from top to bottom, and back after it."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Camera
from rsvideo.physics.luminance import luminance
from rsvideo.physics.noise_level import noise_level
from rsvideo.physics.shutter import Direction
from rsvideo.physics.trajectory import Trajectory

COLOUR_NOISE = math.sqrt(1.8)  # a channel's noise over that of the luminance: the squares of BT.709's weights sum to 1 / 1.78
LEAST_NOISE = 1e-3  # linear light; measured noise below this is not believed; origin: by trial


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """A frame and its camera, both turned so that the scanlines are read from top to bottom."""

    pixels: Float[np.ndarray, "rows cols channels"]  # linear light, float32
    clipped: Bool[np.ndarray, "rows cols channels"]
    camera: Camera  # along the scanlines
    source: Frame  # as decoded
    source_camera: Camera  # as the frame is stored

    @property
    def direction(self) -> Direction:
        """Of the readout over the stored frame."""
        return self.source_camera.timing.direction

    @property
    def frame(self) -> Frame:
        """The pixels in the stored frame's axes."""
        image = self.direction.image
        pixels, clipped = np.ascontiguousarray(image(self.pixels)), np.ascontiguousarray(image(self.clipped))
        return replace(self.source, pixels=pixels, clipped=clipped)

    @cached_property
    def noise(self) -> float:
        """Standard deviation of a channel's noise, in linear light: the camera's where it is given, else measured."""
        if self.camera.noise is not None:
            return max(self.camera.noise.over(self.pixels), LEAST_NOISE)
        return max(noise_level(luminance(self.pixels)) * self.colour_noise, LEAST_NOISE)

    @property
    def colour_noise(self) -> float:
        """A channel's noise over that of the luminance."""
        return COLOUR_NOISE if self.pixels.shape[2] == 3 else 1.0


def to_scanlines(frame: Frame, camera: Camera) -> View:
    """The frame, turned. A frame that is read from top to bottom is not copied."""
    direction = camera.timing.direction
    return View(
        pixels=np.ascontiguousarray(direction.scanlines(frame.pixels), np.float32),
        clipped=np.ascontiguousarray(direction.scanlines(frame.clipped)),
        camera=camera.along_scanlines(),
        source=frame,
        source_camera=camera,
    )


def result(
    view: View,
    *,
    trajectory: Trajectory,
    verdict: Verdict,
    seconds: float,
    latent: Float[np.ndarray, "rows cols channels"] | None = None,
    psfs: Float[np.ndarray, "down across k k"] | None = None,
    convergence: tuple[float, ...] = (),
) -> FrameResult:
    """All that was found along the scanlines, in the stored frame's axes; without a latent image, the frame itself."""
    direction = view.direction
    if psfs is not None:
        psfs = np.array([[direction.image(kernel) for kernel in row] for row in direction.image(psfs)])
    return FrameResult(
        frame=view.source,
        timing=view.source_camera.timing,
        trajectory=path_in_image(trajectory, direction),
        latent=view.source.pixels if latent is None else np.ascontiguousarray(direction.image(latent)),
        verdict=verdict,
        seconds=seconds,
        convergence=convergence,
        psfs=psfs,
    )


def path_along_scanlines(path: Trajectory, direction: Direction) -> Trajectory:
    """A path in image axes along the scanlines."""
    return path.with_coefficients(direction.poses_along_scanlines(path.coefficients))


def path_in_image(path: Trajectory, direction: Direction) -> Trajectory:
    """The inverse of `path_along_scanlines`."""
    return path.with_coefficients(direction.poses_in_image(path.coefficients))
