"""A gyroscope's log becomes the path of a frame, with the signs of the camera's axes."""

import contextlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.gyro import GyroLog, angles_from_poses, integrate, parse, path, poses_from_angles

CAMERA = Intrinsics.centred(focal=1000.0, rows=40, cols=60)


def steady(rate, seconds=1.0, step=0.005):
    times = np.arange(0, seconds, step)
    return GyroLog(times=times, rates=np.tile(np.array(rate, float), (len(times), 1)))


def read(log, **how):
    return parse(log.splitlines(), **how)


def text(rows):
    return "\n".join(" ".join(str(x) for x in row) for row in rows)


def test_a_steady_turn_is_rate_times_time():
    angles = integrate(steady([0.0, 0.3, 0.0]), start=0.2, duration=0.04, steps=40)
    np.testing.assert_allclose(angles[:, 1], 0.3 * np.linspace(-0.02, 0.02, 41), atol=1e-12)
    assert np.abs(angles[:, [0, 2]]).max() < 1e-12


def test_turning_right_takes_samples_from_the_right_and_looking_up_from_above():
    right = path(steady([0.0, 0.5, 0.0]), camera=CAMERA, start=0.1, duration=0.04).at(np.array([0.04]))[0]
    np.testing.assert_allclose(right, [10, 0, 0], atol=1e-6)
    up = path(steady([0.5, 0.0, 0.0]), camera=CAMERA, start=0.1, duration=0.04).at(np.array([0.04]))[0]
    np.testing.assert_allclose(up, [0, -10, 0], atol=1e-6)


def test_turns_compose_as_rotations_and_not_as_sums():
    times = np.linspace(0, 0.2, 401)
    log = GyroLog(times=times, rates=np.stack([3 * np.sin(40 * times), 3 * np.cos(40 * times), 2 * np.ones(401)], axis=1))
    dt = 1e-5
    t = (np.arange(20_000) + 0.5) * dt
    turned = Rotation.identity()
    for rate in np.stack([3 * np.sin(40 * t), 3 * np.cos(40 * t), 2 * np.ones(20_000)], axis=1):
        turned = turned * Rotation.from_rotvec(rate * dt)
    first, last = Rotation.from_rotvec(integrate(log, start=0.0, duration=0.2, steps=800)[[0, -1]])
    np.testing.assert_allclose((first.inv() * last).as_rotvec(), turned.as_rotvec(), atol=2e-5)
    added = np.trapezoid(log.rates, times, axis=0)
    assert np.abs(added - turned.as_rotvec()).max() > 0.01


def test_the_path_passes_through_the_integrated_angles():
    rng = np.random.default_rng(0)
    log = GyroLog(times=np.arange(200) / 200, rates=rng.standard_normal((200, 3)).cumsum(axis=0) * 0.05)
    curve = path(log, camera=CAMERA, start=0.301, duration=0.05)
    poses = poses_from_angles(integrate(log, start=0.301, duration=0.05, steps=500), camera=CAMERA)
    np.testing.assert_allclose(curve.at(np.linspace(0, 0.05, 501)), poses, atol=0.01)
    np.testing.assert_allclose(curve.at(np.array([0.025]))[0], 0, atol=0.01)


def test_angles_and_poses_are_inverse():
    angles = np.random.default_rng(1).standard_normal((5, 3))
    np.testing.assert_allclose(angles_from_poses(poses_from_angles(angles, camera=CAMERA), camera=CAMERA), angles)
    np.testing.assert_allclose(angles_from_poses(np.array([[10.0, 20.0]]), camera=CAMERA), [[-0.02, 0.01, 0]])


def test_a_log_is_read_with_a_header_commas_and_comments():
    log = read("t_ns,wx,wy,wz\n# a phone\n1000000000,0.1,0.2,0.3\n\n1005000000, 0.4,0.5,0.6 # shake\n")
    np.testing.assert_allclose(log.times, [0, 0.005])
    np.testing.assert_allclose(log.rates, [[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])


def test_times_keep_their_nanoseconds_after_decades():
    log = read(text([(1_795_000_000_000_000_000 + k * 5_000_001, 0, 0, 0) for k in range(3)]))
    np.testing.assert_allclose(np.diff(log.times), 5.000001e-3, rtol=1e-12)


def test_axes_name_the_gyro_s_axis_along_each_of_the_camera_s():
    log = read(text([(0, 1, 2, 3), (5_000_000, 4, 5, 6)]), axes="Zxy")
    np.testing.assert_allclose(log.rates, [[3, -1, -2], [6, -4, -5]])


@pytest.mark.parametrize(
    ("log", "slip"),
    [
        ("", "log is empty"),
        ("# nothing\n", "log is empty"),
        ("t_ns wx wy wz\n", "log is empty"),
        ("0 1 2 3", "2 samples"),
        (text([(0, 0, 0, 0), (5_000_000, 0, 0)]), "line 2"),
        (text([(0, 0, 0, 0), (5_000_000, 0, 0, 0, 0)]), "line 2"),
        (text([(0, 0, 0, 0), ("x", 0, 0, 0)]), "line 2"),
        (text([(0, 0, 0, 0), ("nan", 0, 0, 0)]), "line 2"),
        (text([(0, 0, 0, 0), ("inf", 0, 0, 0)]), "line 2"),
        (text([("nan", "nan", "nan", "nan"), (0, 0, 0, 0)]), "line 1"),
        (text([(0, 0, 0, 0), (5_000_000, "nan", 0, 0)]), "finite"),
        (text([(0, 0, 0, 0), (5_000_000, "1e999", 0, 0)]), "finite"),
        (text([(0, 0, 0, 0), (5_000_000, 0, 0, 0), (5_000_000, 0, 0, 0)]), "sample 3"),
        (text([(5_000_000, 0, 0, 0), (0, 0, 0, 0)]), "increase"),
        (text([(0, 0, 0, 0), (5, 0, 0, 0)]), "nanoseconds"),
        (text([(0, 0, 0, 0), ("9" * 400, 0, 0, 0)]), "line 2"),
        (text([(0, 0, 0, 0), ("9" * 18, 0, 0, 0)]), "nanoseconds"),
        (text([(0, 0, 0, 0), (5_000_000, 120, 0, 0)]), "degrees"),
        ("\x00\xff PNG \n", "line 1"),
        ("9" * 5000 + " 0 0 0\n0 0 0 0", "line 1"),
    ],
)
def test_a_log_that_is_none_is_refused_with_a_reason(log, slip):
    with pytest.raises(ValueError, match=slip):
        read(log)


@given(st.text(alphabet="0123456789.,-+e# \nnaif", max_size=200))
def test_rubbish_raises_nothing_but_a_value_error(rubbish):
    with contextlib.suppress(ValueError):
        read(rubbish)


@pytest.mark.parametrize("axes", ["", "XY", "XYZX", "XXZ", "ABC"])
def test_axes_that_are_no_permutation_are_refused(axes):
    with pytest.raises(ValueError, match="gyro axes"):
        read("0 0 0 0\n5000000 0 0 0", axes=axes)


@pytest.mark.parametrize(
    ("start", "duration", "slip"),
    [
        (0.99, 0.04, "within the gyro log"),
        (-0.1, 0.04, "within"),
        (float("nan"), 0.04, "within"),
        (0.1, 0.0, "interval"),
        (0, 40.0, "milli"),
    ],
)
def test_a_frame_outside_the_log_is_refused(start, duration, slip):
    with pytest.raises(ValueError, match=slip):
        path(steady([0, 0, 0]), camera=CAMERA, start=start, duration=duration)


def test_a_frame_over_a_gap_of_the_log_is_refused():
    times = np.r_[np.arange(100) * 0.005, 2 + np.arange(100) * 0.005]
    log = GyroLog(times=times, rates=np.zeros((200, 3)))
    path(log, camera=CAMERA, start=0.2, duration=0.04)
    for start in (0.48, 1.0, 1.98):
        with pytest.raises(ValueError, match="gap"):
            path(log, camera=CAMERA, start=start, duration=0.04)
