"""rsvideo calibrate readout, as a person uses it who measures their own camera."""

import hashlib
import json
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import skimage.data
from av.video.frame import VideoFrame
from av.video.stream import VideoStream
from typer.testing import CliRunner

from rsvideo.cli import app
from rsvideo.cli.exit_codes import code_and_line
from rsvideo.physics import gyro, shake, simulate, tone
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.tone import Transfer
from rsvideo.shooting import profiles
from tests.calibration.flickering import COLS, FPS, ROWS, lit


def ran(*words: object) -> tuple[int, dict]:
    """What the command prints as JSON, called in this process, which is faster; and its exit code."""
    done = CliRunner().invoke(app, ["calibrate", "readout", *map(str, words), "--json"])
    return done.exit_code, json.loads(done.stdout) if done.stdout else {"stderr": done.stderr}


def refused(code: int, line: str, *words: object) -> None:
    """The command ends with `code` and a line that holds `line`."""
    done = CliRunner().invoke(app, ["calibrate", "readout", *map(str, words)], standalone_mode=False)
    assert done.exception is not None, done.output
    got, said = code_and_line(done.exception)
    assert got == code, said
    assert line in said


def encoded(path: Path, lights: list[np.ndarray]) -> Path:
    """A clip of grey pictures in linear light, in H.264 with BT.709's curve."""
    with av.open(str(path), "w", container_options={"video_track_timescale": "30000"}) as file:
        video = file.add_stream("libx264", rate=FPS, options={"crf": "10"})
        assert isinstance(video, VideoStream)
        video.width, video.height, video.pix_fmt = lights[0].shape[1], lights[0].shape[0], "yuv420p"
        video.codec_context.thread_count = 1
        for light in lights:
            codes = np.round(16 + 219 * tone.encode(Transfer.BT709, np.clip(light, 0, 1).astype(np.float32)))
            planes = np.full((light.shape[0] * 3 // 2, light.shape[1]), 128, np.uint8)
            planes[: light.shape[0]] = codes
            file.mux(video.encode(VideoFrame.from_ndarray(planes, "yuv420p")))
        file.mux(video.encode())
    return path


@pytest.fixture(scope="module")
def bands(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The wall as a clip."""
    return encoded(tmp_path_factory.mktemp("bands") / "clip \u00e4.mp4", lit())


@pytest.fixture(scope="module")
def hand_held(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photograph, filmed by hand with a readout of 20 ms."""
    lens, readout, frames = Intrinsics.centred(focal=400, rows=ROWS, cols=COLS), 0.02, 12
    timing = ShutterTiming.from_readout(exposure=0.002, readout=readout, rows=ROWS)
    camera = Camera(timing=timing, intrinsics=lens)
    angles = shake.shake(np.random.default_rng(2), frames / FPS + 0.1, 2000.0, rms=0.15)
    poses = gyro.poses_from_angles(angles - angles.mean(axis=0), camera=lens)
    path = gyro.spline_through(poses, duration=(len(angles) - 1) / 2000, spacing=0.004)
    photo = tone.decode(Transfer.SRGB, skimage.data.astronaut().astype(np.float32) / 255).mean(axis=2)
    scene = cv2.copyMakeBorder(photo, 60, 60, 60, 60, cv2.BORDER_REFLECT).astype(float)[..., None]
    lights = []
    for k in range(frames):
        local = gyro.spline_through(
            path.at(np.linspace(0, timing.interval[1], 33) + float(k / FPS)), duration=timing.interval[1], spacing=0.004
        )
        lights.append(simulate.blur(scene, camera=camera, trajectory=local, samples=2)[..., 0])
    return encoded(tmp_path_factory.mktemp("hand") / "clip.mp4", lights)


def test_a_clip_under_a_flickering_light_becomes_a_profile_with_std_method_day_and_hash(bands: Path, tmp_path: Path) -> None:
    output = tmp_path / "mine.yaml"
    code, facts = ran(bands, "--flicker", "0.5kHz", "-o", output, "--name", "Mine", "--maker", "Me")
    assert code == 0
    assert facts["readout_s"] == pytest.approx(0.018, rel=0.002)
    assert facts["row_time_s"] == pytest.approx(facts["readout_s"] / ROWS)
    written = profiles.find(str(output))
    assert (written.camera, written.mode.rows, written.mode.cols, written.mode.fps) == ("Me Mine", ROWS, COLS, 29.97)
    clock = written.timing
    assert clock is not None
    assert clock.found is not None
    assert clock.readout_s.value == pytest.approx(facts["readout_s"], rel=1e-5)  # profiles hold six digits
    assert abs(clock.readout_s.value - 0.018) < 3 * (clock.readout_s.std or 0)
    assert clock.direction is Direction.TOP_TO_BOTTOM
    assert "bands of a light that flickers at 500 Hz" in (clock.found.how or "")
    assert clock.found.files == {bands.name: hashlib.sha256(bands.read_bytes()).hexdigest()}
    assert clock.found.when


@pytest.mark.parametrize("direction", [Direction.BOTTOM_TO_TOP, Direction.RIGHT_TO_LEFT])
def test_the_direction_is_found_along_the_axis_that_is_said(direction: Direction, tmp_path: Path) -> None:
    clip = encoded(tmp_path / "clip.mp4", lit(direction))
    axis = () if direction is Direction.BOTTOM_TO_TOP else ("--direction", "right-to-left")
    code, facts = ran(clip, "--flicker", "500", *axis)
    assert code == 0
    assert facts["readout_s"] == pytest.approx(0.018, rel=0.002)
    assert facts["direction"] == facts["profile"].get("timing", {})["direction"] == direction.value


def test_a_photograph_and_a_folder_of_frames_do_too(tmp_path: Path) -> None:
    folder = tmp_path / "frames"
    folder.mkdir()
    for k, light in enumerate(lit()):
        codes = np.round(65535 * tone.encode(Transfer.SRGB, np.clip(light, 0, 1).astype(np.float32))).astype(np.uint16)
        assert cv2.imwrite(str(folder / f"{k:03}.png"), codes)
    code, facts = ran(folder / "003.png", "--flicker", "500Hz")
    assert code == 0
    assert facts["readout_s"] == pytest.approx(0.018, rel=0.01)
    assert any("tells no direction" in note for note in facts["notes"])
    code, facts = ran(folder, "--flicker", "500Hz", "--rate", "30000/1001", "--frames", 10)
    assert code == 0
    assert facts["readout_s"] == pytest.approx(0.018, rel=0.002)
    assert len(facts["profile"]["timing"]["found"]["files"]) == 10


def test_photographs_in_a_folder_are_measured_each_and_those_without_bands_are_told(tmp_path: Path) -> None:
    folder = tmp_path / "photographs"
    folder.mkdir()
    rng = np.random.default_rng(4)
    for k, light in enumerate([*lit(frames=4), 0.3 + 0.003 * rng.standard_normal((ROWS, COLS))]):
        codes = np.round(255 * tone.encode(Transfer.SRGB, np.clip(light, 0, 1).astype(np.float32))).astype(np.uint8)
        assert cv2.imwrite(str(folder / f"{k}.jpg"), codes, [cv2.IMWRITE_JPEG_QUALITY, 95])
    code, facts = ran(folder, "--flicker", "500Hz")
    assert code == 0
    assert abs(facts["readout_s"] - 0.018) < 2 * facts["std_s"] < 0.0004
    assert set(facts["profile"]["timing"]["found"]["files"]) == {f"{k}.jpg" for k in range(4)}
    assert any("not used: 4.jpg: no bands stand out" in note for note in facts["notes"])


@pytest.mark.long
def test_hand_held_footage_tells_it_with_the_curvature_of_its_cost(hand_held: Path) -> None:
    code, facts = ran("--from-clip", hand_held)
    assert code == 0
    assert abs(facts["readout_s"] - 0.02) < 3 * facts["std_s"] < 0.005
    assert facts["curvature_per_s2"] > 0
    assert facts["direction"] == "top-to-bottom"
    assert len(facts["costs"]) > 10


def test_footage_that_does_not_tell_it_ends_with_a_reason_and_no_profile(bands: Path, tmp_path: Path) -> None:
    output = tmp_path / "mine.yaml"
    for words in (("--from-clip", bands), (bands, "--flicker", "523Hz")):
        done = CliRunner().invoke(app, ["calibrate", "readout", *map(str, words), "-o", str(output)])
        assert done.exit_code == 1
        assert "cannot tell the readout: " in done.stderr
        assert not output.exists()


def test_the_public_table_gives_the_median_and_its_spread() -> None:
    code, facts = ran("--from-table", "GoPro HERO8 Black", "1080p")
    assert code == 0
    assert facts["profile"]["name"] == "GoPro HERO8 Black"
    assert facts["low_s"] <= facts["readout_s"] <= facts["high_s"]
    assert "CC0" in facts["profile"]["timing"]["found"]["source"]


def test_frame_rate_and_all_scanlines_give_it_and_the_delay_between_frames(bands: Path) -> None:
    code, facts = ran(bands, "--from-frame-rate", "--scanlines-total", 300)
    assert code == 0
    assert facts["readout_s"] == pytest.approx(float(240 / (300 * FPS)))
    assert facts["inter_frame_delay_s"] == pytest.approx(float(60 / (300 * FPS)))
    assert "60 lines that are not stored" in facts["notes"][0]


def test_a_profile_is_added_to_and_never_replaced_unasked(bands: Path, tmp_path: Path) -> None:
    output = tmp_path / "mine.yaml"
    output.write_text(f"name: Mine\nmode: {{rows: {ROWS}, cols: {COLS}}}\nintrinsics: {{fx: 400, fy: 400, cx: 159.5, cy: 119.5}}\n")
    words = (bands, "--from-frame-rate", "--scanlines-total", 300, "-o", output)
    refused(4, "exists already", *words)
    assert ran(*words, "--add")[0] == 0
    both = profiles.find(str(output))
    assert both.intrinsics is not None
    assert both.timing is not None
    assert both.name == "Mine"


@pytest.mark.parametrize(
    ("words", "code", "line"),
    [
        ((), 2, "measured by one of --flicker, --from-clip, --from-table, --from-frame-rate, got none"),
        (("CLIP", "--flicker", "1000Hz", "--from-frame-rate"), 2, "got --flicker and --from-frame-rate"),
        (("CLIP", "--flicker", "fast"), 2, "flicker must be a frequency from 20 Hz to 100 kHz such as 1000Hz, got 'fast'"),
        (("CLIP", "--flicker", "1e9"), 2, "got '1e9'"),
        (("CLIP", "--flicker", "0Hz"), 2, "got '0Hz'"),
        (("--flicker", "1000Hz"), 2, "CLIP must be given"),
        (("CLIP", "--from-clip", "CLIP"), 2, "--from-clip takes no other CLIP"),
        (("CLIP", "--flicker", "500Hz", "--scanlines-total", "300"), 2, "--scanlines-total belongs to --from-frame-rate"),
        (("CLIP", "--from-frame-rate"), 2, "needs --scanlines-total N; without it a frame's period of 33.37 ms is only an upper bound"),
        (("CLIP", "--from-frame-rate", "--scanlines-total", "200"), 2, "scanlines-total must be from the 240 that are stored"),
        (("--from-table", "GoPro HERO8 Blak", "1080p60"), 2, "did you mean GoPro HERO8 Black?"),
        (("--from-table", "GoPro HERO8 Black", "huge"), 2, "MODE must read like 1920x1080@29.97"),
        (("--from-table", "GoPro HERO8 Black", "0x0"), 2, "MODE must read like"),
        (("missing.mp4", "--flicker", "500Hz"), 3, "does not exist"),
        (("missing.png", "--flicker", "500Hz"), 3, "does not exist"),
        (("--from-clip", "EMPTY"), 3, "is empty"),
        (("FOLDER", "--flicker", "500Hz"), 3, "holds no photograph"),
        (("--from-clip", "PHOTO"), 2, "must be a clip, a photograph shows no motion"),
        (("CLIP", "--flicker", "500Hz", "--rate", "0"), 2, "rate must be a number of frames"),
    ],
)
def test_what_cannot_be_meant_is_refused_in_one_line(
    words: tuple[str, ...], code: int, line: str, bands: Path, photograph: Path, tmp_path: Path
) -> None:
    (tmp_path / "none").mkdir()
    (tmp_path / "empty.mp4").write_bytes(b"")
    places = {"CLIP": bands, "EMPTY": tmp_path / "empty.mp4", "PHOTO": photograph, "FOLDER": tmp_path / "none"}
    refused(code, line, *(places.get(word, word) for word in words))


def test_the_published_frame_is_met_by_the_command(shared: Path) -> None:
    code, facts = ran(shared / "real" / "flicker" / "nikon1j1_1080p30_1000Hz.png", "--flicker", "1000Hz")
    assert code == 0
    assert facts["readout_s"] == pytest.approx(0.015730, rel=0.0015)
    assert abs(facts["readout_s"] - 0.015730) < 2 * facts["std_s"]
