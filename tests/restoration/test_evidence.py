"""Evidence is how surely the blocks of a frame agree, and tells a true path from its mirror image and from one of another length."""

import numpy as np
import pytest

from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise import Noise
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.simulate import render
from rsvideo.physics.trajectory import Polynomial, Trajectory, centred
from rsvideo.restoration.evidence import BLOCK, certainty, sharper, sparser
from rsvideo.restoration.scene import Scene
from rsvideo.restoration.spectral_paths import mirrored

ROWS, COLS = 192, 288
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
CAMERA = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=400, rows=ROWS, cols=COLS))


def test_what_all_blocks_agree_on_counts_by_its_standard_error() -> None:
    rng = np.random.default_rng(0)
    each = 1 + 0.5 * rng.standard_normal((6, 8))
    difference = np.kron(each, np.ones((BLOCK, BLOCK), np.float32)).astype(np.float32)
    expected = each.mean() / (each.std() / np.sqrt(each.size))
    assert certainty(difference, np.ones_like(difference)) == pytest.approx(expected, rel=1e-4)


def test_blocks_without_weight_do_not_count() -> None:
    rng = np.random.default_rng(0)
    difference = rng.standard_normal((4 * BLOCK, 4 * BLOCK)).astype(np.float32) + 1
    weight = np.ones_like(difference)
    weight[:, : 2 * BLOCK] = 0
    halfway = certainty(difference * weight, weight)
    assert halfway == pytest.approx(certainty(difference[:, 2 * BLOCK :], weight[:, 2 * BLOCK :]))


@pytest.mark.parametrize("shape", [(BLOCK // 2, BLOCK // 2), (BLOCK, BLOCK)])
def test_one_block_alone_is_sure_of_nothing(shape: tuple[int, int]) -> None:
    assert certainty(np.ones(shape, np.float32), np.ones(shape, np.float32)) == 0


def scene_of_squares(path: Trajectory) -> Scene:
    """What a moving camera shows of squares with sharp edges."""
    rng = np.random.default_rng(1)
    picture = np.full((ROWS + 80, COLS + 80), 0.5, np.float32)
    for _ in range(120):
        top, left, size = (*rng.integers(0, [ROWS + 60, COLS + 60]), rng.integers(8, 40))
        picture[top : top + size, left : left + size] = rng.uniform(0.1, 0.9)
    light = np.repeat(picture[..., None], 3, axis=2)
    shot = render(light, camera=CAMERA, trajectory=path, noise=Noise.at_half(0.003), rng=rng, samples=48)
    grey = shot.blurred.mean(axis=2)
    return Scene(frame=grey, valid=np.ones_like(grey), camera=CAMERA, samples=24, tiles=2, noise=0.003)


def path_of(*coefficients: tuple[float, float]) -> Trajectory:
    terms = np.array([(0, 0), *coefficients], float)
    return centred(Polynomial(t0=TIMING.interval[0], t1=TIMING.interval[1], coefficients=terms), TIMING.middle)


def test_a_curved_path_is_told_from_its_mirror_image_and_from_its_length() -> None:
    path = path_of((7, 3), (4, -4), (-2, 2))
    scene = scene_of_squares(path)
    mirror, focus = sparser(scene, path, mirrored(path)), sharper(scene, path)
    assert mirror > 3
    assert focus > 5
    assert sparser(scene, mirrored(path), path) == pytest.approx(-mirror, rel=0.3)
    assert sharper(scene, path.with_coefficients(2 * path.coefficients)) < focus / 3


def test_an_even_motion_has_no_direction() -> None:
    path = path_of((9, 4))
    assert abs(sparser(scene_of_squares(path), path, mirrored(path))) < 2


def test_a_path_is_compared_with_any_other() -> None:
    path = path_of((7, 3), (4, -4), (-2, 2))
    scene = scene_of_squares(path)
    astray = path_of((7, 3), (-4, 4), (2, -2))
    assert sparser(scene, path, astray) > 3
    assert sparser(scene, astray, path) < -3
