"""Virtual gyroscopes: what Gyroflow will make of a log is what the pictures show."""

import json
import math
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from rsvideo.config.files import UnreadableError
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.shooting import gcsv
from rsvideo.shooting.gcsv import ReadoutCode

TIMING = ShutterTiming.from_readout(exposure=0.01, readout=0.016, rows=480)
T = np.linspace(0.0, 1.0, 1001)


def shake(t: np.ndarray) -> np.ndarray:
    """Angles well beyond small ones."""
    return np.stack([0.3 * np.sin(5 * t), 0.5 * np.sin(3 * t + 1), 0.2 * np.cos(7 * t)], axis=1)


SHAKE = shake(T)


def written(folder: Path, angles: np.ndarray, timing: ShutterTiming = TIMING) -> Path:
    path = folder / "clip.gcsv"
    path.write_bytes(gcsv.encode(T, angles, timing=timing, video="clip.mp4"))
    return path


def as_gyroflow_reads(path: Path) -> tuple[dict, np.ndarray, np.ndarray]:
    """Header, times in s and rates in rad/s in Gyroflow's axes, from its own parser."""
    code = (
        "import json, sys, telemetry_parser; p = telemetry_parser.Parser(sys.argv[1]); m = p.telemetry()[0]['Default']['Metadata'];"
        "print(json.dumps([p.camera, p.model, m, [[s['timestamp_ms'], *s['gyro']] for s in p.normalized_imu()]]))"
    )
    done = subprocess.run([sys.executable, "-c", code, path], capture_output=True, timeout=60, check=True)
    camera, model, header, samples = json.loads(done.stdout)
    table = np.array(samples)
    return {"camera": camera, "model": model, **header}, table[:, 0] * 1e-3, np.deg2rad(table[:, 1:])


def turned_by_gyroflow(times: np.ndarray, rates: np.ndarray) -> Rotation:
    """Its integration of (-Y, X, Z), and the turn it gives to pixels: the same, seen from axes whose y and z point the other way."""
    x, y, z = rates.T
    steps = np.stack([-y, x, z], axis=1)
    middle = 0.5 * (steps[1:] + steps[:-1]) * np.diff(times)[:, None]
    path = [Rotation.identity()]
    for turn in Rotation.from_rotvec(middle):
        path.append(path[-1] * turn)
    flip = Rotation.from_matrix(np.diag([1.0, -1.0, -1.0]))
    return flip * Rotation.concatenate(path) * flip


def test_gyroflow_turns_pictures_as_we_do(tmp_path: Path) -> None:
    _, times, rates = as_gyroflow_reads(written(tmp_path, SHAKE))
    turned = turned_by_gyroflow(times, rates)
    truth = Rotation.from_rotvec(np.stack([np.interp(times + TIMING.middle, T, SHAKE[:, axis]) for axis in range(3)], axis=1))
    apart = (turned.inv() * truth[0].inv() * truth).magnitude()
    assert apart.max() < 2e-5


@pytest.mark.parametrize(
    ("axis", "column", "name"),
    [(0, 1, "up: pitch turns against Y"), (1, 0, "right: yaw turns against X"), (2, 2, "clockwise: roll turns against Z")],
)
def test_one_axis_alone_has_the_sense_that_is_written_down(tmp_path: Path, axis: int, column: int, name: str) -> None:
    angles = np.zeros((len(T), 3))
    angles[:, axis] = 0.1 * T
    _, _, rates = as_gyroflow_reads(written(tmp_path, angles))
    expected = np.zeros(3)
    expected[column] = -0.1
    np.testing.assert_allclose(rates, np.broadcast_to(expected, rates.shape), atol=1e-8, err_msg=name)


def test_a_camera_that_turns_right_looks_right(tmp_path: Path) -> None:
    angles = np.zeros((len(T), 3))
    angles[:, 1] = 0.1 * T  # README: x = fx * yaw, and positive x takes the sample from the right
    _, times, rates = as_gyroflow_reads(written(tmp_path, angles))
    ahead = turned_by_gyroflow(times, rates).apply([0.0, 0.0, 1.0])
    assert ahead[-1, 0] > 0.09


@pytest.mark.parametrize("direction", list(Direction))
def test_gyroflow_is_told_camera_readout_and_direction(tmp_path: Path, direction: Direction) -> None:
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.016, rows=480, direction=direction)
    header, times, _ = as_gyroflow_reads(written(tmp_path, SHAKE, timing))
    assert (header["camera"], header["model"], header["frame_readout_time"], header["videofilename"]) == (
        "rsvideo",
        "virtual gyro",
        "16",
        "clip.mp4",
    )
    assert header["frame_readout_direction"] == str(int(ReadoutCode.of(direction)))
    np.testing.assert_allclose(np.diff(times), 1e-3, atol=2e-9)


def test_direction_codes_are_those_of_the_format() -> None:
    assert [ReadoutCode(code).direction.value for code in range(4)] == ["top-to-bottom", "bottom-to-top", "left-to-right", "right-to-left"]
    assert all(ReadoutCode.of(direction).direction is direction for direction in Direction)


@pytest.mark.parametrize("direction", list(Direction))
def test_what_is_written_is_read_again(tmp_path: Path, direction: Direction) -> None:
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.016, rows=480, direction=direction)
    recording = gcsv.read(written(tmp_path, SHAKE, timing))
    assert recording.readout == pytest.approx(0.016)
    assert recording.direction is direction
    truth = gcsv.rates(T, SHAKE, recording.log.times + timing.middle)
    np.testing.assert_allclose(recording.log.rates, truth, rtol=1e-8, atol=1e-9)


def test_a_path_in_parts_is_written_as_the_whole_is(tmp_path: Path) -> None:
    whole = gcsv.read(written(tmp_path, SHAKE)).log
    edges = [(0, 300, 0.25), (200, 700, 0.6503), (600, 1001, 1.0)]
    parts = [gcsv.Part(t_s=T[a:b], angles=SHAKE[a:b], until=until) for a, b, until in edges]
    (tmp_path / "parts.gcsv").write_bytes(b"".join(gcsv.encoded(parts, timing=TIMING)))
    other = gcsv.read(tmp_path / "parts.gcsv").log
    np.testing.assert_array_equal(other.times, whole.times)
    np.testing.assert_allclose(other.rates, whole.rates, atol=1e-7)


def test_our_reader_and_gyroflows_agree_for_every_orientation(tmp_path: Path) -> None:
    path = written(tmp_path, SHAKE)
    text = path.read_text()
    for orientation in ("XYZ", "YxZ", "zXy", "yxz"):
        path.write_text(text.replace("orientation,yxz", f"orientation,{orientation}"))
        _, times, theirs = as_gyroflow_reads(path)
        ours = gcsv.read(path).log
        np.testing.assert_allclose(ours.times, times, atol=1e-9)
        np.testing.assert_allclose(ours.rates, -theirs[:, [1, 0, 2]], atol=1e-7)


def test_rates_are_those_of_the_turning_camera() -> None:
    at, step = np.linspace(0.1, 0.9, 33), 1e-5
    before, after = (Rotation.from_rotvec(shake(at + shift)) for shift in (-step, step))
    np.testing.assert_allclose(gcsv.rates(T, SHAKE, at), (before.inv() * after).as_rotvec() / (2 * step), atol=1e-6)


def test_rates_hold_for_the_smallest_angles_too() -> None:
    def near(t: np.ndarray) -> np.ndarray:
        return np.stack([0.005 + 0.1 * t * t, 0.05 * t, -0.02 * t], axis=1)  # |v| from 0.005 on

    t, step = np.linspace(-0.1, 0.1, 201), 1e-5
    before, after = (Rotation.from_rotvec(near(t + shift)) for shift in (-step, step))
    np.testing.assert_allclose(gcsv.rates(t, near(t), t), (before.inv() * after).as_rotvec() / (2 * step), atol=1e-9)


def test_names_cannot_end_a_field(tmp_path: Path) -> None:
    text = gcsv.encode(T, SHAKE, timing=TIMING, video='a,b"\nt,gx\u202e' + "x" * 500).decode()
    assert text.index("\nt,gx,gy,gz\n") < 500
    assert "videofilename,a_b__t_gx_x" in text


@pytest.mark.parametrize(
    ("t", "why"),
    [
        (T[:3], "at least 4"),
        (T[::-1], "rising"),
        (T * math.nan, "finite"),
        (T + 0.5, "must cover the middle of the first frame"),
        (T - 5, "must cover"),
    ],
)
def test_samples_that_make_no_log_are_refused(t: np.ndarray, why: str) -> None:
    with pytest.raises(ValueError, match=why):
        gcsv.encode(np.ascontiguousarray(t), SHAKE[: len(t)], timing=TIMING)


HEADER = "GYROFLOW IMU LOG\nversion,1.3\norientation,yxz\ntscale,0.001\ngscale,1.0\nt,gx,gy,gz\n"


@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("t,gx,gy,gz\n0,1,2,3\n", ":1: must be GYROFLOW IMU LOG"),
        ("GYROFLOW IMU LOG\nversion,1.3\n", "must name its columns"),
        ("GYROFLOW IMU LOG\n" + "a,b\n" * 1000 + "t,gx\n", "must name its columns"),
        (HEADER, "holds none"),
        (HEADER + "0,1,2\n", ":7: must be t,gx,gy,gz"),
        (HEADER + "0,1,2,x\n", ":7: must be t,gx,gy,gz"),
        (HEADER + "0,1,2,3\n0,1,2,3\n", "times of a gyro log must increase"),
        (HEADER + "0,1,2,3\n1,nan,2,3\n", "finite numbers"),
        (HEADER + "0,1,2,3\n1,1000,2,3\n", "are they in degrees per second"),
        (HEADER.replace("yxz", "yyz") + "0,1,2,3\n1,1,2,3\n", "gyro axes must be X, Y and Z"),
        (HEADER.replace("gscale,1.0", "gscale,one") + "0,1,2,3\n1,1,2,3\n", "gscale must be a number, got 'one'"),
        (
            HEADER.replace("gscale,1.0", "frame_readout_direction,7") + "0,1,2,3\n1,1,2,3\n",
            "frame_readout_direction must be 0 to 3, got '7'",
        ),
        ("\x00\xff\n", ":1: must be GYROFLOW"),
    ],
)
def test_a_log_that_cannot_be_meant_is_told_with_its_line(tmp_path: Path, text: str, why: str) -> None:
    path = tmp_path / "bad.gcsv"
    path.write_text(text)
    with pytest.raises(UnreadableError, match=why):
        gcsv.read(path)
