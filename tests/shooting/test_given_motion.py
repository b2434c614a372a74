import json
from pathlib import Path

import numpy as np
import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.shooting import given_motion

TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=400)
CAMERA = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=1000, rows=400, cols=600))
HEADER = "t_s,pitch_rad,yaw_rad,roll_rad\n"


def recorded(path: Path, *, step: float = 0.0005, start: float = 0.0, end: float = 0.04, roll: float = 0.001) -> Path:
    t = np.linspace(start, end, round((end - start) / step) + 1)
    angles = np.stack([0.004 * np.sin(600 * t), 0.005 * np.cos(90 * t), roll * np.sin(40 * t)], axis=1)
    rows = "".join(f"{s:.9g},{p:.9g},{y:.9g},{r:.9g}\n" for s, (p, y, r) in zip(t, angles, strict=True))
    path.write_text(HEADER + rows)
    return path


def test_recorded_angles_become_pixels_to_a_hundredth(tmp_path: Path) -> None:
    curve = given_motion.read(recorded(tmp_path / "motion.csv"), CAMERA)
    t = np.linspace(0, 0.04, 333)
    true = np.stack([5 * np.cos(90 * t), -4 * np.sin(600 * t), 0.001 * np.sin(40 * t)], axis=1)
    middle = np.array([5 * np.cos(1.8), -4 * np.sin(12), 0.001 * np.sin(0.8)])
    error = np.abs(curve.at(t) - (true - middle))
    assert error[:, :2].max() < 0.02  # the pose at the middle has its own hundredth
    assert error[:, 2].max() * 360 < 0.02


def test_yaw_to_the_right_samples_from_the_right_and_pitch_up_from_above(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    path.write_text(HEADER + "".join(f"{t},{t},{t},0\n" for t in np.linspace(0, 0.04, 20)))
    start, end = given_motion.read(path, CAMERA).at(np.array([0, 0.04]))
    assert end[0] > 0 > start[0]
    assert start[1] > 0 > end[1]


def test_the_pose_at_the_middle_of_the_interval_is_the_origin(tmp_path: Path) -> None:
    curve = given_motion.read(recorded(tmp_path / "motion.csv"), CAMERA)
    np.testing.assert_allclose(curve.at(np.array([TIMING.middle])), 0, atol=1e-12)


def test_motion_without_roll_has_two_axes(tmp_path: Path) -> None:
    curve = given_motion.read(recorded(tmp_path / "motion.csv", roll=0.0), CAMERA)
    assert curve.coefficients.shape[1] == 2


def test_a_slow_gyro_log_that_reaches_beyond_the_frame_is_enough(tmp_path: Path) -> None:
    path = recorded(tmp_path / "motion.csv", step=0.005, start=-0.05, end=0.1)
    t = np.linspace(0, 0.04, 100)
    expected = 5 * (np.cos(90 * t) - np.cos(1.8))
    np.testing.assert_allclose(given_motion.read(path, CAMERA).at(t)[:, 0], expected, atol=0.05)


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("t_s,pitch_rad,yaw_rad\n0,0,0\n", ":1: .*must name the columns .* it lacks roll_rad"),
        (HEADER + "0,0,0,0\n", "at least 2 samples"),
        (HEADER + "0,0,0,0\n0.04,nan,0,0\n", ":3: must hold finite numbers"),
        (HEADER + "0,0,0,0\n0.04,fast,0,0\n", ":3: must hold a number"),
        (HEADER + "0,0,0,0\n0.04,0\n", ":3: must hold a number"),
        (HEADER + "0,0,0,0\n0.04,0,0,0\n0.02,0,0,0\n", "t_s must rise"),
        (HEADER + "0,0,0,0\n0.02,0,0,0\n0.02,0,0,0\n", "t_s must rise"),
        ("\0\1\2", "must name the columns"),
    ],
)
def test_a_damaged_record_is_refused_with_its_line(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "motion.csv"
    path.write_text(text)
    with pytest.raises(UnreadableError, match=f"motion.csv.*{why}"):
        given_motion.read(path, CAMERA)


def test_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    path.write_bytes(b"\x89PNG\xff\xfe")
    with pytest.raises(UnreadableError, match="must be text"):
        given_motion.read(path, CAMERA)


@pytest.mark.parametrize(("start", "end"), [(0.001, 0.04), (0.0, 0.035)])
def test_a_record_that_leaves_part_of_the_interval_out_is_refused(tmp_path: Path, start: float, end: float) -> None:
    path = recorded(tmp_path / "motion.csv", start=start, end=end)
    with pytest.raises(ValueError, match=r"whole interval, 0 to 0\.04 s"):
        given_motion.read(path, CAMERA)


def test_noise_that_no_spline_follows_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "motion.csv"
    noise = np.random.default_rng(1).normal(0, 0.01, 4000)
    path.write_text(HEADER + "".join(f"{t:.7g},{n},0,0\n" for t, n in zip(np.linspace(0, 0.04, 4000), noise, strict=True)))
    with pytest.raises(ValueError, match="smooth enough"):
        given_motion.read(path, CAMERA)


def test_the_recorded_cases_are_followed_to_a_hundredth_of_a_pixel(shared: Path) -> None:
    folders = sorted((shared / "cases" / "stills").iterdir())
    for folder in folders[:: max(1, len(folders) // 6)]:
        case = json.loads((folder / "case.json").read_text())
        timing = ShutterTiming.from_readout(exposure=case["exposure_s"], readout=case["readout_s"], rows=case["rows"])
        lens = Intrinsics.centred(focal=case["focal_px"], rows=case["rows"], cols=case["cols"])
        t, pitch, yaw, _ = np.loadtxt(folder / "motion.csv", delimiter=",", skiprows=1).T
        inside = (t >= timing.interval[0]) & (t <= timing.interval[1])
        path = given_motion.read(folder / "motion.csv", Camera(timing=timing, intrinsics=lens)).at(t[inside])
        true = case["focal_px"] * np.stack([yaw, -pitch], axis=1)[inside]
        np.testing.assert_allclose(path[:, :2] - path[0, :2], true - true[0], atol=0.02)
