"""The paper's objective, Eq. (8), at its minimum over the latent image: how well a trajectory explains a frame."""

import numpy as np

from rsvideo.physics import tiles
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.nonblind import tile_system, total_variation
from rsvideo.restoration.scene import Scene

MU = 1e-3  # weight of total variation: the paper's last one, mu_min (Sec. 5)
PLAIN_NOISE = 5e-3  # standard deviation, white being 1, up to which MU serves; beyond, it rises with the noise's power
MOST_MU = 10.0  # times MU
STEPS = 25  # of ADMM; origin: by trial
BORDER = 8, 16  # rows and columns along the frame's sides that are left out, at most a quarter of the tile's
_MOST_BORDER = 4  # the part of a tile's side that BORDER leaves out is a quarter at most


def energy(scene: Scene, trajectory: Trajectory) -> float:
    """min_l |K l - b|^2 / 2 + mu |grad l|_1, a pixel's mean."""
    mu = MU * float(np.clip((scene.noise / PLAIN_NOISE) ** 2, 1, MOST_MU))
    count = 1 if trajectory.coefficients.shape[1] == 2 else scene.tiles
    total = pixels = 0.0
    trajectory = scene.scaled(trajectory)
    for tile in tiles.split(scene.camera.intrinsics.cols, count, 0):
        offsets = tiles.displacement(tile, trajectory, scene.camera, scene.samples)
        system = tile_system(offsets, scene.frame[:, tile.columns], scene.valid[:, tile.columns])
        op = system.op
        latent = total_variation(system, mu, steps=STEPS)
        blurred = system.blurred(latent)[:, op.left : op.left + op.cols]
        down, across = min(BORDER[0], op.rows // _MOST_BORDER), min(BORDER[1], op.cols // _MOST_BORDER)
        inner = np.s_[down : op.rows - down, across : op.cols - across]
        residual = (system.valid * (blurred - system.frame))[inner]
        inside = system.crop(latent)[inner]
        variation = np.abs(np.diff(inside, axis=0)).mean() + np.abs(np.diff(inside, axis=1)).mean()
        total += residual.size * float(0.5 * np.mean(residual**2) + mu * variation)
        pixels += residual.size
    return total / pixels
