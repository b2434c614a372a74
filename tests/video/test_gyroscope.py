"""What a gyroscope recorded inside a clip is read, and one clear line says why where it is not."""

from pathlib import Path

import numpy as np
import pytest

from rsvideo.video import telemetry
from rsvideo.video.gyroscope import embedded
from rsvideo.video.telemetry import UnavailableError
from tests.pipeline.moving import Moving

pytest.importorskip("telemetry_parser", reason="the extra `gyro` is not installed")


def test_a_gopros_log_is_what_others_read_of_it(shared: Path) -> None:
    clip = shared / "real" / "gopro_mp4_gyro" / "karma.mp4"
    t, x, y, z = np.loadtxt(clip.with_name("karma_imu.csv"), delimiter=",", skiprows=1, usecols=(0, 1, 2, 3)).T
    log = embedded(clip)
    np.testing.assert_allclose(log.times, 1e-3 * (t - t[0]), atol=1e-9)
    np.testing.assert_allclose(log.rates, np.deg2rad(np.stack([-y, -x, -z], axis=1)), atol=1e-9)


def test_a_clip_without_a_log_is_told(tmp_path: Path) -> None:
    clip = Moving(frames=1).clip(tmp_path / "clip.mp4")
    with pytest.raises(UnavailableError, match=r"clip.mp4 must have a gyroscope's log embedded"):
        embedded(clip)


def test_more_than_can_be_meant_is_not_read(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = shared / "real" / "gopro_mp4_gyro" / "karma.mp4"
    assert telemetry.answer(clip, "gyroscope", 100_000) == b""  # 4795 samples of 32 bytes
    monkeypatch.setattr(telemetry, "answer", lambda *_: np.array([0.0, 1, 2, 3, 5e-4, 1, 2, np.nan]).tobytes())
    with pytest.raises(UnavailableError, match="finite numbers"):
        embedded(clip)
