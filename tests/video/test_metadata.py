"""What clips say of how they were shot."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import av
import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from rsvideo.physics.shutter import ShutterTiming
from rsvideo.shooting import gcsv
from rsvideo.shooting.fact import Fact
from rsvideo.video import decode, metadata, telemetry
from rsvideo.video.metadata import ClipFacts
from rsvideo.video.stream import Stream
from rsvideo.video.telemetry import Telemetry

APPLE = {
    "com.apple.quicktime.make": "Apple",
    "com.apple.quicktime.model": "iPhone 12",
    "com.apple.quicktime.camera.lens_model": "iPhone 12 back camera 4.2mm",
    "com.apple.quicktime.camera.focal_length.35mm_equivalent": "26",
    "com.apple.quicktime.creationdate": "2026-01-31T10:00:00+0100",
}
GOPRO = "real/gopro_mp4_gyro"


def clip(folder: Path, tags: Mapping[str, str], name: str = "clip.mov") -> Stream:
    path = folder / name
    with av.open(str(path), "w", container_options={"movflags": "use_metadata_tags"} if name.endswith("mov") else {}) as file:
        file.metadata.update(tags)
        video = file.add_stream("mpeg4", rate=25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        for _ in range(3):
            file.mux(video.encode(av.VideoFrame.from_ndarray(np.zeros((72, 64), np.uint8), "yuv420p")))
        file.mux(video.encode())
    return decode.probe(path)


def test_a_phone_says_maker_model_lens_and_day_each_with_its_tag(tmp_path: Path) -> None:
    facts = metadata.read(clip(tmp_path, APPLE))
    assert facts.camera == "Apple iPhone 12"
    assert facts.model is not None
    assert facts.model.source == "the clip's tag com.apple.quicktime.model"
    assert facts.captured is not None
    assert facts.captured.value.startswith("2026-01-31")
    assert facts.focal_px(1080, 1920) == pytest.approx(26 * np.hypot(1080, 1920) / 43.2666, rel=1e-4)
    assert (facts.exposure, facts.readout, facts.iso, facts.notes) == (None, None, None, ())


@pytest.mark.parametrize(
    ("tags", "exposure"),
    [
        ({"com.maker.ShutterAngle": "180"}, 0.02),
        ({"shutter_angle": "172.8°"}, 0.0192),
        ({"ExposureTime": "1/50"}, 0.02),
        ({"com.maker.camera.shutter_speed": "10 ms"}, 0.01),
        ({"exposure_time": "1/50", "shutter_angle": "90"}, 0.02),
        ({"exposure_time": "auto"}, None),
        ({"exposure_time": "-1/50"}, None),
        ({"exposure_time": "1/0"}, None),
        ({"shutter_angle": "nan"}, None),
        ({"shutter_angle": "720"}, None),
        ({"pre_exposure_time": "1/50"}, None),
    ],
)
def test_exposure_is_taken_from_tags_that_are_a_time_or_an_angle(tmp_path: Path, tags: Mapping[str, str], exposure: float | None) -> None:
    said = metadata.read(clip(tmp_path, tags)).exposure
    assert (said.value if said else None) == (pytest.approx(exposure) if exposure else None)


def test_matroska_writes_its_tags_in_capitals(tmp_path: Path) -> None:
    facts = metadata.read(clip(tmp_path, {"MAKE": "Canon", "MODEL": "EOS R5", "ISO": "400"}, "clip.mkv"))
    assert facts.camera == "Canon EOS R5"
    assert facts.iso is not None
    assert facts.iso.value == 400


def test_slow_motion_is_told(tmp_path: Path) -> None:
    facts = metadata.read(clip(tmp_path, {"com.android.capture.fps": "240.0"}))
    assert facts.frame_rate is not None
    assert facts.frame_rate.value == 240
    assert any("recorded at 240 fps and played at 25" in note for note in facts.notes)
    assert metadata.read(clip(tmp_path, {"com.android.capture.fps": "25.0"})).notes == ()


def test_tags_that_could_harm_a_terminal_say_nothing(tmp_path: Path) -> None:
    facts = metadata.read(clip(tmp_path, {"make": "\x1b[31mred", "model": "x" * 5000, "iso": "9" * 5000}))
    assert facts.make is None
    assert facts.model is not None
    assert len(facts.model.value) == 80


def test_a_clip_that_says_nothing_says_nothing(tmp_path: Path) -> None:
    facts = metadata.read(clip(tmp_path, {}))
    assert facts == ClipFacts(captured=facts.captured)
    assert facts.camera is None
    assert facts.focal_px(48, 64) is None


def test_a_gopro_tells_exposure_readout_and_that_it_stabilised(shared: Path) -> None:
    facts = metadata.read(decode.probe(shared / GOPRO / "max-heromode.mp4"))
    assert facts.camera == "GoPro GoPro Max"
    assert facts.readout is not None
    assert facts.readout.value == pytest.approx(20.60e-3, abs=5e-6)
    assert facts.exposure is not None
    assert facts.exposure.within is not None
    assert 5e-4 < facts.exposure.within[0] < facts.exposure.value < facts.exposure.within[1] < 1.1e-3
    assert any("exposure varies from 0.599 to 1.01 ms" in note for note in facts.notes)
    assert any("the camera stabilised the clip itself" in note for note in facts.notes)


def test_a_gopro_that_does_not_stabilise_has_no_such_note(shared: Path) -> None:
    facts = metadata.read(decode.probe(shared / GOPRO / "karma.mp4"))
    assert facts.camera == "GoPro HERO5 Black"
    assert facts.exposure is not None
    assert facts.exposure.value == pytest.approx(4.87e-3, abs=5e-6)
    assert (facts.readout, facts.notes) == (None, ())


def test_without_the_reader_tags_still_speak(shared: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(telemetry, "available", lambda: False)
    facts = metadata.read(decode.probe(shared / GOPRO / "karma.mp4"))
    assert facts.make is not None
    assert (facts.make.value, facts.exposure) == ("GoPro", None)
    assert facts.notes == ("its data tracks are not read: telemetry-parser is not installed; pip install 'rsvideo[gyro]' brings it",)


def test_a_log_beside_the_clip_is_not_taken_for_the_clips_own(tmp_path: Path) -> None:
    stream = clip(tmp_path, {}, "clip.mp4")
    t = np.linspace(0, 1, 100)
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.01, rows=48)
    stream.path.with_suffix(".gcsv").write_bytes(gcsv.encode(t, np.zeros((100, 3)), timing=timing))
    assert telemetry.read(stream.path) == Telemetry()


@pytest.mark.parametrize("data", [b"", b"\x00" * 1000, b"ftyp" * 1000])
def test_what_is_no_telemetry_says_nothing(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "clip with blanks \u00e4.mp4"
    path.write_bytes(data)
    assert telemetry.read(path) == Telemetry()


def test_damaged_telemetry_says_nothing_or_what_can_be(tmp_path: Path, shared: Path) -> None:
    whole = (shared / GOPRO / "karma.mp4").read_bytes()
    rng = np.random.default_rng(1)
    path = tmp_path / "clip.mp4"
    for _ in range(4):
        damaged = np.frombuffer(whole, np.uint8).copy()
        damaged[rng.integers(0, len(damaged), 20_000)] ^= 255
        path.write_bytes(damaged.tobytes())
        found = telemetry.read(path)
        assert found.exposure is None or all(value > 0 for value in found.exposure)


def test_a_reader_that_takes_too_long_is_ended(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(telemetry, "SECONDS", 0.001)
    with pytest.raises(telemetry.UnavailableError, match="took more than"):
        telemetry.read(clip(tmp_path, {}).path)


def test_a_sequence_says_what_its_first_files_exif_says(tmp_path: Path) -> None:
    record = Image.Exif()
    record[272] = "EOS R5"
    record[0x8769] = {33434: IFDRational(1, 50), 41989: 35}
    Image.new("RGB", (64, 48)).save(tmp_path / "0001.jpg", exif=record)
    facts = metadata.read(replace(clip(tmp_path, APPLE), files=(tmp_path / "0001.jpg",)))
    assert facts.exposure == Fact(value=0.02, source="EXIF of 0001.jpg")
    assert facts.camera == "EOS R5"
    assert facts.focal_35mm is not None
    missing = metadata.read(replace(clip(tmp_path, APPLE), files=(tmp_path / "0000.jpg",)))
    assert "0000.jpg does not exist" in missing.notes[0]
