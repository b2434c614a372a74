"""Each kind of gyroscope's log is read for what it is, and says when it began where it can."""

from pathlib import Path

import numpy as np
import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.shooting import gcsv
from rsvideo.shooting.gyro_log import read

TIMING = ShutterTiming.from_readout(exposure=0.01, readout=0.02, rows=100)
T = np.arange(-0.05, 0.4, 0.002)
ANGLES = np.stack([0.1 * np.sin(9 * T), 0.2 * np.cos(7 * T), 0.05 * np.sin(12 * T)], axis=1)
RATES = gcsv.rates(T, ANGLES, T)


def as_csv(t: np.ndarray = T, angles: np.ndarray = ANGLES) -> str:
    lines = [f"{at:.9g}," + ",".join(f"{a:.12g}" for a in turn) for at, turn in zip(t, angles, strict=True)]
    return "\n".join(["t_s,pitch_rad,yaw_rad,roll_rad", *lines]) + "\n"


def as_lines() -> str:
    return "".join(f"{10**18 + round(t * 1e9)} {x!r} {y!r} {z!r}\n" for t, (x, y, z) in zip(T.tolist(), RATES.tolist(), strict=True))


def as_gcsv() -> str:
    return gcsv.encode(T, ANGLES, timing=TIMING).decode()


@pytest.mark.parametrize(
    ("name", "text", "offset"), [("a.csv", as_csv(), 0.05), ("b.txt", as_lines(), None), ("c.gcsv", as_gcsv(), -0.015)]
)
def test_all_kinds_tell_the_same_motion(tmp_path: Path, name: str, text: str, offset: float | None) -> None:
    (tmp_path / name).write_text(text)
    found = read(tmp_path / name, TIMING)
    assert found.offset == (offset if offset is None else pytest.approx(offset, abs=1e-9))
    at = np.linspace(0.05, 0.3, 20)  # seconds of the clip
    shift = 0.05 if found.offset is None else found.offset
    for axis in range(3):
        told = np.interp(at + shift, found.log.times, found.log.rates[:, axis])
        np.testing.assert_allclose(told, np.interp(at, T, RATES[:, axis]), atol=2e-3)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "is empty"),
        ("t_s,pitch_rad,yaw_rad\n0,1,2\n", r":1: .*must name the columns .* lacks roll_rad"),
        ("t_s,pitch_rad,yaw_rad,roll_rad\n0,0,0,0\n0.01,0,x,0\n", r":3: must hold a number in each column, got '0.01,0,x,0'"),
        ("t_s,pitch_rad,yaw_rad,roll_rad\n0,0,0,0\n0.01,0\n", r":3: must hold a number"),
        ("t_s,pitch_rad,yaw_rad,roll_rad\n0,0,0,0\n", "at least 2 samples"),
        ("t_s,pitch_rad,yaw_rad,roll_rad\n0,0,0,0\n1,0,0,0\n", "4 to 5000000 samples, got 2"),
        (as_csv(T[::-1]), "t_s must rise"),
        (as_csv(T, ANGLES * np.nan), "finite"),
        (as_csv(T, ANGLES * 57.3), "degrees"),
        ("what is this\n", "line 1 of a gyro log must be"),
        ("GYROFLOW IMU LOG\nversion,1.3\n", "must name its columns"),
        ("\x00\x01\x02\n", "gyro log must be"),
    ],
)
def test_what_is_no_log_is_told_in_one_line_with_its_file(tmp_path: Path, text: str, said: str) -> None:
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(UnreadableError, match=said) as told:
        read(path, TIMING)
    assert str(told.value).startswith(str(path))
    assert "\n" not in str(told.value)


def test_a_log_that_is_not_there_is_told(tmp_path: Path) -> None:
    with pytest.raises(UnreadableError, match="does not exist"):
        read(tmp_path / "none.gcsv", TIMING)
