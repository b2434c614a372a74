from dataclasses import replace

import numpy as np
import skimage.data

from rsvideo.comparison import residual
from rsvideo.config.sidecar import Camera, Sidecar
from rsvideo.physics import camera as physics
from rsvideo.physics import simulate
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.trajectory import Polynomial
from tests.report.test_plots import sidecar


def test_a_grid_of_kernels_blends_from_one_to_the_next() -> None:
    latent = np.zeros((60, 90), np.float32)
    latent[30, ::10] = 1
    psfs = np.zeros((1, 2, 5, 5), np.float32)
    psfs[0, 0, 2, 3] = 1  # one pixel to the right
    psfs[0, 1, 2, 1] = 1  # one to the left
    seen, border = residual._convolved(latent, psfs)
    assert border == 3
    assert (seen[30, 11], seen[30, 9]) == (1, 0)
    assert (seen[30, 81], seen[30, 79]) == (0, 1)
    assert 0 < seen[30, 41] < 1
    np.testing.assert_allclose(residual._convolved(np.full((60, 90), 0.3, np.float32), psfs)[0], 0.3, rtol=1e-5)


def test_the_motion_found_explains_what_it_has_blurred() -> None:
    said = sidecar(x=8)
    rng = np.random.default_rng(0)
    latent = rng.random((300, 400)).astype(np.float32)
    seen, border = residual._moved(latent, said.frames[0], said)
    row = 150  # open over the middle half of a steady pan of 8 px: 4 px
    expected = np.convolve(latent[row], np.ones(4) / 4, mode="same")
    inside = seen[row, border:-border]
    assert np.corrcoef(inside, expected[border:-border])[0, 1] > 0.9
    assert border < 12


def test_what_a_distorting_lens_blurred_is_explained_by_that_lens() -> None:
    plain = sidecar(x=8, roll=0.05)
    pinhole = replace(plain.settings.camera.intrinsics, fx=250.0, fy=250.0)
    lens = Distortion(model="brown-conrady", coefficients=(-0.25, 0.08, 0.0, 0.0))
    bent = replace(pinhole, distortion=lens)
    timing, poses = plain.timing(plain.frames[0]), plain.frames[0].trajectory.poses()
    t0, t1 = timing.interval
    path = Polynomial(t0=t0, t1=t1, coefficients=np.array([np.zeros(3), (poses[-1] - poses[0]) / np.sqrt(12)]))
    scene = (skimage.data.astronaut()[:340, :480, :1] / 255.0) ** 2.2
    taken_by = physics.Camera(timing=timing, intrinsics=bent)
    blurred = simulate.blur(scene, camera=taken_by, trajectory=path, samples=32)[..., 0].astype(np.float32)
    latent = simulate.still(scene, intrinsics=bent, pose=np.zeros(3))[..., 0].astype(np.float32)

    def left(camera: Camera) -> float:
        said: Sidecar = plain.model_copy(update={"settings": plain.settings.model_copy(update={"camera": camera})})
        again, border = residual._moved(latent, said.frames[0], said)
        return float(np.std((again - blurred)[border:-border, border:-border]))

    assert left(Camera.of(bent, "")) < 0.5 * left(Camera.of(pinhole, ""))
