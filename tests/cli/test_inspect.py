"""rsvideo inspect, as a user calls it."""

import json
from pathlib import Path

import av
import numpy as np
import pytest

from tests.cli.conftest import Run


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    """Three frames of a phone whose model the public table knows."""
    path = tmp_path / "clip \u00e4.mov"
    with av.open(str(path), "w", container_options={"movflags": "use_metadata_tags"}) as file:
        file.metadata.update({"com.apple.quicktime.make": "Apple", "com.apple.quicktime.model": "iPhone 12"})
        video = file.add_stream("mpeg4", rate=24)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        for _ in range(3):
            file.mux(video.encode(av.VideoFrame.from_ndarray(np.zeros((72, 64), np.uint8), "yuv420p")))
        file.mux(video.encode())
    return path


def told(rsvideo: Run, *words: object) -> dict:
    done = rsvideo("inspect", *words, "--json")
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout)


def test_everything_known_is_told_with_its_source(rsvideo: Run, clip: Path) -> None:
    facts = told(rsvideo, clip)
    assert (facts["cols"], facts["rows"], facts["frames"], facts["frame_rate"], facts["codec"]) == (64, 48, 3, 24.0, "mpeg4")
    assert facts["model"] == {"value": "iPhone 12", "source": "the clip's tag com.apple.quicktime.model"}
    assert facts["readout_s"]["source"].startswith("public table, the median of")
    assert facts["row_time_s"]["value"] == pytest.approx(facts["readout_s"]["value"] / 48)
    assert facts["exposure_s"] is None
    assert set(facts["missing"]) == {"exposure", "focal length"}


def test_the_table_on_a_terminal_names_what_is_missing(rsvideo: Run, clip: Path) -> None:
    done = rsvideo("inspect", clip)
    lines = {line.split("  ")[0]: line for line in done.stdout.splitlines()}
    assert "64 x 48, as stored" in lines["size"]
    assert "iPhone 12" in lines["model"]
    assert "public table" in lines["readout"]
    assert "--exposure 1/50 or --shutter-angle 180 would say it" in done.stdout
    assert "\x1b" not in done.stdout


def test_names_that_could_harm_a_terminal_are_shown_plain(rsvideo: Run, clip: Path) -> None:
    done = rsvideo("inspect", clip.rename(clip.with_name("\x1b[31mclip.mov")))
    assert done.returncode == 0
    assert r"\x1b[31mclip.mov" in "".join(done.stdout.split())  # lines are folded


def test_options_win_over_all_sources(rsvideo: Run, clip: Path) -> None:
    facts = told(rsvideo, clip, "--shutter-angle", 180, "--readout", "20ms", "--direction", "bottom-to-top")
    assert facts["exposure_s"] == {"value": pytest.approx(1 / 48), "source": "shutter angle of 180 degrees"}
    assert facts["readout_s"] == {"value": 0.02, "source": "explicit"}
    assert facts["direction"] == {"value": "bottom-to-top", "source": "explicit"}
    assert told(rsvideo, clip, "--scanlines-total", 60)["row_time_s"]["value"] == pytest.approx(1 / (24 * 60))


def test_a_profile_is_given_by_file_and_a_camera_by_name(rsvideo: Run, clip: Path, tmp_path: Path) -> None:
    profile = tmp_path / "mine.yaml"
    lens = "intrinsics: {fx: 55, fy: 55, cx: 31.5, cy: 23.5}"
    profile.write_text(f"name: Mine\nmode: {{rows: 48, cols: 64, fps: 24}}\n{lens}\ntiming: {{readout_s: 0.0157}}\n")
    facts = told(rsvideo, clip, "--camera", profile)
    assert facts["readout_s"] == {"value": 0.0157, "source": "the profile of Mine"}
    assert facts["focal_px"] == {"value": 55.0, "source": "the profile of Mine"}
    other = told(rsvideo, clip, "--camera", "Sony a7 IV")
    assert other["readout_s"]["value"] > 0.02


@pytest.mark.parametrize(
    ("options", "line"),
    [
        (["--readout", "60ms"], "readout must be at most one frame's period, 41.67 ms at 24 fps, got 60 ms"),
        (["--exposure", "20"], "exposure must lie in (0, 1] s, got 20 s; is it in milliseconds?"),
        (["--shutter-angle", "400"], "shutter-angle must lie in (0, 360] degrees, got 400"),
        (["--scanlines-total", "47"], "scanlines-total must be at least the 48 that are stored, got 47"),
        (["--camera", "nikon_1_j1_1080p3"], "did you mean nikon_1_j1_1080p30?"),
        (["--camera", "nikon_1_j1_1080p30"], "the profile of Nikon 1 J1 is of 1920 x 1080 at 29.97 fps, the clip is of 64 x 48 at 24 fps"),
        (["--camera", "GoPro HERO5 Blak"], "got 'GoPro HERO5 Blak'; did you mean GoPro HERO5 Black?"),
        (["--rate", "0/0"], "rate must be a number of frames a second"),
    ],
)
def test_what_cannot_be_meant_ends_with_2_and_one_line(rsvideo: Run, clip: Path, options: list[str], line: str) -> None:
    done = rsvideo("inspect", clip, *options)
    assert done.returncode == 2
    assert done.stdout == ""
    assert line in done.stderr
    assert done.stderr.count("\n") == 1


def test_a_fault_in_a_profile_is_told_with_its_line(rsvideo: Run, clip: Path, tmp_path: Path) -> None:
    profile = tmp_path / "mine.yaml"
    profile.write_text("name: Mine\nmode: {rows: 48, cols: 64}\ntiming:\n  readout: 0.0157\n")
    done = rsvideo("inspect", clip, "--camera", profile)
    assert done.returncode == 2
    assert f"{profile}:4: timing.readout: there is no such key; did you mean readout_s?" in done.stderr


@pytest.mark.parametrize("data", [b"", b"just text", b"\x00" * 5000, b"\x00\x00\x00\x18ftypmp42" + b"\xff" * 500])
def test_a_file_that_is_no_clip_ends_with_3_and_one_line(rsvideo: Run, tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "no clip.mp4"
    path.write_bytes(data)
    done = rsvideo("inspect", path)
    assert done.returncode == 3
    assert done.stderr.startswith(f"rsvideo: {path}")
    assert done.stderr.count("\n") == 1


def test_a_gopro_is_told_apart_from_its_telemetry(rsvideo: Run, shared: Path) -> None:
    done = rsvideo("inspect", shared / "real" / "gopro_mp4_gyro" / "max-heromode.mp4", "--json")
    facts = json.loads(done.stdout)
    assert facts["readout_s"]["value"] == pytest.approx(20.60e-3, abs=5e-6)
    assert facts["readout_s"]["source"] == "GoPro's telemetry"
    assert any("stabilised the clip itself" in note for note in facts["notes"])
