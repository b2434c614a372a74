"""How far a path leads, and how finely it has to be sampled for that."""

import math
from dataclasses import replace

import numpy as np

from rsvideo.physics.camera import Camera
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.scene import Scene

TIMES = 65  # at which a path is followed over a frame's interval
SAMPLES, LINES = 16, 32  # of an exposure, and roughly how many scanlines, at which a path's extent is measured
FARTHEST = 0.5  # of the frame's shorter side, beyond which no hand's path leads within one frame


def longest(camera: Camera, path: Trajectory) -> float:
    """The largest extent in px of any scanline's path."""
    timing = camera.timing
    poses = path.at(timing.sample_times(SAMPLES)[:: max(1, timing.rows // LINES)])[..., :2]
    return float(np.linalg.norm(poses.max(axis=1) - poses.min(axis=1), axis=-1).max())


def beyond(camera: Camera, path: Trajectory) -> bool:
    """Whether the path leads over more than half the frame: no hand's does, and kernels that show such a path describe the picture."""
    poses = path.at(np.linspace(*camera.timing.interval, TIMES))[:, :2]
    return float(np.ptp(poses, axis=0).max()) > FARTHEST * min(camera.intrinsics.rows, camera.intrinsics.cols)


def sampled(scene: Scene, path: Trajectory) -> Scene:
    """The scene with as many path samples an exposure as the path has px: fewer would make a comb of it."""
    return replace(scene, samples=max(scene.samples, math.ceil(longest(scene.camera, scene.scaled(path)))))
