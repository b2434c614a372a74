"""Where blur does not tell the camera's direction, what both directions agree on is shown, if it is nearer to the truth than the blur."""

import numpy as np
import pytest
import skimage.data

from rsvideo.frame import Frame
from rsvideo.physics import simulate
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory, centred
from rsvideo.restoration import single_frame, undirected
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.rectification import read_out, rectified, scanline_poses
from rsvideo.restoration.scanlines import View, to_scanlines
from rsvideo.restoration.settings import Settings

ROWS, COLS = 120, 160
LENS = Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS)
INNER = np.s_[14:-14, 14:-14]
NEAR = Flow(points=np.array([[40.0, 60.0]]), weights=np.array([[250.0, -150.0]]), length=60.0)  # px, px/s


def shot(readout: float, exposure: float = 0.02) -> tuple[View, Trajectory, np.ndarray]:
    """A frame blurred by 8 px of even motion with a little roll, its path, and the truth."""
    timing = ShutterTiming.from_readout(exposure=exposure, readout=readout, rows=ROWS)
    end = 8.0 * timing.interval[1] / exposure / 2
    coefficients = np.array([[0.0, 0.0, 0.0], [end, -0.3 * end, 1e-3]])
    path = centred(Polynomial(t0=0.0, t1=timing.interval[1], coefficients=coefficients), timing.middle)
    scene = (skimage.data.astronaut()[20:260, 60:380] / 255) ** 2.2
    camera, rng = Camera(timing=timing, intrinsics=LENS), np.random.default_rng(0)
    rendering = simulate.render(scene, camera=camera, trajectory=path, noise=Noise.at_half(0.001), rng=rng, samples=32)
    frame = Frame(pixels=rendering.blurred, clipped=rendering.blurred >= 1)
    return to_scanlines(frame, camera), path, rendering.truth


def distance(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sqrt(((one[INNER] ** 0.45 - other[INNER] ** 0.45) ** 2).mean()))


def latent(view: View, path: Trajectory) -> np.ndarray:
    return np.clip(single_frame.restored(view, Settings(prior="tv"), path=path).latent, 0, 1)


@pytest.mark.parametrize("flow", [None, NEAR])
def test_what_a_shutter_reads_of_an_image_rectifies_to_it(flow: Flow | None) -> None:
    view, path, truth = shot(readout=0.02)
    read = read_out(truth, scanline_poses(path, view.camera), view.camera, flow)
    back = rectified(to_scanlines(Frame(pixels=read, clipped=read >= 1), view.camera), path, flow=flow).pixels
    assert distance(back, truth) < 0.1 * distance(read, truth)


@pytest.mark.parametrize("times", [1.0, -1.0])
def test_where_scanlines_sway_little_a_frame_is_deblurred_in_either_direction(times: float) -> None:
    view, path, truth = shot(readout=0.002)
    along = path.with_coefficients(times * path.coefficients)
    read = undirected.read(view, along, latent(view, along))
    assert read.worth
    assert distance(read.latent, truth) < 0.7 * distance(view.pixels, truth)


@pytest.mark.parametrize("times", [1.0, -1.0])
def test_where_scanlines_sway_far_it_is_left(times: float) -> None:
    view, path, _ = shot(readout=0.04)
    along = path.with_coefficients(times * path.coefficients)
    assert not undirected.read(view, along, latent(view, along)).worth
