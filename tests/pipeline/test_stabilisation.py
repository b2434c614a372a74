"""A steadier camera that shows no border and leaves a steady one alone."""

from dataclasses import replace

import numpy as np
import pytest
import skimage.data

from rsvideo.physics import simulate
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.distortion import Distortion
from rsvideo.pipeline.stabilisation import MOST_CROP, corrections, shown

CAMERA = Intrinsics.centred(focal=300.0, rows=90, cols=160)
RATE = 25.0
FRAMES = 100


def steps(poses: np.ndarray) -> list[list[float] | None]:
    """From each pose to the next; the last leads nowhere."""
    return [*np.diff(poses, axis=0).tolist(), None]


def pan(speed: float) -> np.ndarray:
    return np.outer(np.arange(FRAMES) / RATE, [speed, -0.5 * speed, 0.0])


def jitter(px: float, seed: int = 0) -> np.ndarray:
    return px * np.random.default_rng(seed).standard_normal((FRAMES, 3)) * [1, 1, 1 / CAMERA.fx]


def roughness(poses: np.ndarray) -> float:
    return float(np.sqrt((np.diff(poses, 2, axis=0)[:, :2] ** 2).mean()))


@pytest.mark.parametrize("speed", [0.0, 60.0])
def test_a_steady_camera_is_left_alone(speed: float) -> None:
    turns, enlargement = corrections(steps(pan(speed)), RATE, CAMERA)
    np.testing.assert_allclose(turns, 0, atol=1e-9)
    assert enlargement == pytest.approx(1)


def test_nothing_is_smoothed_across_a_cut() -> None:
    before, after = jitter(2.0, 1), pan(60.0)
    turns, _ = corrections([*steps(before), *steps(after)], RATE, CAMERA)
    np.testing.assert_allclose(turns[:FRAMES], corrections(steps(before), RATE, CAMERA)[0], atol=1e-9)
    np.testing.assert_allclose(turns[FRAMES:], 0, atol=1e-9)
    alone, _ = corrections([None], RATE, CAMERA)
    np.testing.assert_array_equal(alone, np.zeros((1, 3)))


def test_a_jittery_path_becomes_smoother() -> None:
    poses = pan(60.0) + jitter(1.0)
    turns, enlargement = corrections(steps(poses), RATE, CAMERA)
    assert roughness(poses + turns) < 0.05 * roughness(poses)
    assert 1 < enlargement <= MOST_CROP


@pytest.mark.parametrize("px", [3.0, 20.0, 40.0, 200.0])
def test_cropping_is_bounded_and_all_of_the_bound_is_used(px: float) -> None:
    poses = jitter(px)
    turns, enlargement = corrections(steps(poses), RATE, CAMERA)
    assert enlargement <= MOST_CROP + 1e-9
    if 10 < px < 100:  # beyond, turns are far from small
        assert enlargement > 0.9 * MOST_CROP
    assert roughness(poses + turns) < roughness(poses)


def ramps() -> np.ndarray:
    """Red tells the column, green the row."""
    y, x = np.mgrid[: CAMERA.rows, : CAMERA.cols]
    return np.stack([(x + 0.5) / CAMERA.cols, (y + 0.5) / CAMERA.rows, 0 * x + 0.5], axis=-1).astype(np.float32)


def test_no_border_shows() -> None:
    turns, enlargement = corrections(steps(jitter(4.0)), RATE, CAMERA)
    worst = np.abs(turns[:, :2]).max(axis=1).argsort()[-5:]
    for turn in turns[worst]:
        seen = shown(ramps(), turn, enlargement, CAMERA)
        across, down = np.diff(seen[..., 0], axis=1) * CAMERA.cols, np.diff(seen[..., 1], axis=0) * CAMERA.rows
        assert min(across[:, 3:-3].min(), down[3:-3].min()) > 0.7 / enlargement  # a border would repeat itself
        assert min(across.min(), down.min()) > 0.3 / enlargement  # Lanczos' kernel reaches over the edge


def test_a_camera_turned_to_the_right_sees_what_lies_to_the_right() -> None:
    still, right = (shown(ramps(), np.array([x, 0.0, 0.0]), 1.1, CAMERA) for x in (0.0, 5.0))
    assert float((right - still)[45, 80, 0]) * CAMERA.cols == pytest.approx(5, abs=0.05)
    assert float((right - still)[45, 80, 1]) * CAMERA.rows == pytest.approx(0, abs=0.05)


def test_what_is_not_turned_is_not_touched() -> None:
    np.testing.assert_array_equal(shown(ramps(), np.zeros(3), 1.0, CAMERA), ramps())


def test_a_frame_is_shown_as_the_lens_would_have_shown_it_turned() -> None:
    scene = (skimage.data.astronaut()[:140, :220] / 255.0) ** 2.2
    camera, turn = (
        replace(CAMERA, distortion=Distortion(model="brown-conrady", coefficients=(-0.8, 0.5, 0.0, 0.0))),
        np.array([4.0, -3.0, 0.05]),
    )
    frame, expected = (simulate.still(scene, intrinsics=camera, pose=pose).astype(np.float32) for pose in (np.zeros(3), turn))

    def off(by: Intrinsics) -> float:
        return float(np.std((shown(frame, turn, 1.0, by) - expected)[16:-16, 16:-16]))

    assert off(camera) < 0.02
    assert off(CAMERA) > 3 * off(camera)
