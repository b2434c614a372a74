"""A frame is laid into a photograph so that its motion never looks past the edges."""

import numpy as np
import pytest

from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.gyro import GyroLog
from rsvideo.physics.shutter import Direction
from rsvideo.physics.simulate import blur, extent, margin
from rsvideo.physics.staging import hand, of_log, polynomial, stage

SWEEP = polynomial({"x": [0, 8, 4], "y": [3, -6], "roll": [0, 0.02]})


def test_the_frame_is_the_largest_that_sees_only_the_scene():
    staged = stage(90, 130, motion=SWEEP, focal=200.0, exposure=0.01, readout=0.02)
    above, beside = margin(camera=staged.camera, trajectory=staged.trajectory)
    assert 0 <= 90 - (staged.camera.intrinsics.rows + 2 * above) <= 2
    assert 0 <= 130 - (staged.camera.intrinsics.cols + 2 * beside) <= 2


@pytest.mark.parametrize("direction", list(Direction), ids=[d.value for d in Direction])
@pytest.mark.parametrize("shutter", [{"readout": 0.02}, {"row_time": 2e-4}, {"readout": 0.0}], ids=["readout", "row-time", "global"])
def test_a_stage_can_be_rendered(direction, shutter):
    staged = stage(90, 130, motion=SWEEP, focal=200.0, exposure=0.01, direction=direction, **shutter)
    scene = np.full((90, 130, 1), 0.5)
    blurred = blur(scene, camera=staged.camera, trajectory=staged.trajectory, samples=2)
    assert blurred.shape == (staged.camera.intrinsics.rows, staged.camera.intrinsics.cols, 1)
    if "readout" in shutter:
        assert staged.camera.timing.readout == pytest.approx(shutter["readout"])
    else:
        assert staged.camera.timing.row_time == 2e-4


def test_the_middle_of_the_interval_is_the_origin():
    staged = stage(90, 130, motion=SWEEP, focal=200.0, exposure=0.01, readout=0.02)
    np.testing.assert_allclose(staged.trajectory.at(np.array([staged.camera.timing.middle]))[0], 0, atol=1e-12)


def test_a_polynomial_is_written_in_powers_of_the_fraction_of_the_interval():
    staged = stage(90, 130, motion=SWEEP, focal=200.0, exposure=0.01, readout=0.02)
    moved = np.diff(staged.trajectory.at(np.array([0.0, 0.03])), axis=0)[0]
    np.testing.assert_allclose(moved, [12, -6, 0.02], atol=1e-9)


def test_a_lens_gives_its_whole_picture_in_its_shape():
    lens = Intrinsics(
        fx=800.0, fy=790.0, cx=330.0, cy=235.0, rows=480, cols=640, distortion=Distortion(model="fisheye", coefficients=(0.1, 0, 0, 0))
    )
    staged = stage(90, 130, motion=SWEEP, lens=lens, exposure=0.01, readout=0.02)
    rows, cols = staged.camera.intrinsics.rows, staged.camera.intrinsics.cols
    assert staged.camera.intrinsics == lens.scaled(rows, cols)
    assert cols == pytest.approx(rows * 4 / 3, abs=1)
    above, _ = margin(camera=staged.camera, trajectory=staged.trajectory)
    assert 0 <= 90 - (rows + 2 * above) <= 4
    chosen = stage(90, 130, motion=SWEEP, lens=lens, exposure=0.01, readout=0.02, frame=(48, 64))
    assert chosen.camera.intrinsics == lens.scaled(48, 64)
    with pytest.raises(ValueError, match="the shape of the camera's, 640 x 480 px, got 64 x 64"):
        stage(90, 130, motion=SWEEP, lens=lens, exposure=0.01, readout=0.02, frame=(64, 64))
    with pytest.raises(ValueError, match="either a focal length or a lens"):
        stage(90, 130, motion=SWEEP, exposure=0.01, readout=0.02)


def test_without_roll_there_is_none_and_the_rest_stays():
    with_roll = stage(90, 130, motion=SWEEP, focal=200.0, exposure=0.01, readout=0.02, frame=(32, 32))
    without = stage(90, 130, motion=SWEEP, focal=200.0, exposure=0.01, readout=0.02, frame=(32, 32), roll=False)
    t = np.linspace(0, 0.03, 7)
    np.testing.assert_allclose(without.trajectory.at(t), with_roll.trajectory.at(t) * [1, 1, 0], atol=1e-12)


def test_a_hand_shakes_by_its_seed_as_fast_as_asked():
    options = {"focal": 2000.0, "exposure": 0.1, "readout": 0.1, "frame": (32, 32)}
    slow, fast, other = (stage(200, 200, motion=motion, **options) for motion in (hand(7), hand(7, rms=0.06), hand(8)))
    t = np.linspace(0, 0.2, 21)
    np.testing.assert_allclose(fast.trajectory.at(t), 2 * slow.trajectory.at(t), atol=1e-9)
    assert np.abs(other.trajectory.at(t) - slow.trajectory.at(t)).max() > 0.1


def test_blur_is_scaled_for_the_frame_that_is_found():
    staged = stage(90, 130, motion=hand(1), focal=200.0, exposure=0.01, readout=0.02, blur=9.0)
    assert extent(camera=staged.camera, trajectory=staged.trajectory) == pytest.approx(9)


def test_a_recorded_turn_moves_by_the_focal_length():
    times = np.arange(100) * 0.005
    log = GyroLog(times=times, rates=np.where(times[:, None] < 0.25, 0, [0.0, 0.5, 0.0]))
    staged = stage(90, 130, motion=of_log(log, start=0.3), focal=400.0, exposure=0.01, readout=0.02)
    assert np.ptp(staged.trajectory.at(np.array([0.0, 0.03]))[:, 0]) == pytest.approx(400 * 0.5 * 0.03, rel=1e-6)


@pytest.mark.parametrize(
    ("change", "slip"),
    [
        ({"frame": (84, 32)}, "must hold"),
        ({"frame": (32, 124)}, "must hold"),
        ({"frame": (8, 8)}, "16 px"),
        ({"blur": 500.0}, "larger than|right angle"),
        ({"row_time": 1e-4}, "either"),
        ({"readout": None}, "either"),
        ({"focal": 0.05}, "millimetres"),
    ],
)
def test_an_impossible_stage_is_refused(change, slip):
    options = {"motion": SWEEP, "focal": 200.0, "exposure": 0.01, "readout": 0.02} | change
    with pytest.raises(ValueError, match=slip):
        stage(90, 130, **options)


@pytest.mark.parametrize(("terms", "slip"), [({"z": [1.0]}, "axes"), ({"x": []}, "1 to 31"), ({"x": [0.0] * 32}, "1 to 31")])
def test_an_impossible_polynomial_is_refused(terms, slip):
    with pytest.raises(ValueError, match=slip):
        polynomial(terms)
