"""One way from a request to a task, for photographs and clips."""

from fractions import Fraction
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from rsvideo.config.request import Encoding, Request
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.noise import Noise
from rsvideo.pipeline.prepare import Task, prepare
from rsvideo.restoration.settings import Settings
from rsvideo.video import output_format
from tests.video.clips import make

GOOD: dict[str, Any] = {"exposure": 0.02, "readout": 0.02, "focal_px": 100}


def test_times_that_matroska_would_round_together_are_refused_before_the_work(tmp_path: Path) -> None:
    source = make(tmp_path / "in.mp4", frames=4, times=[0, 3000, 3001, 6000], base=Fraction(1, 90000))
    request = {"source": source, "output": tmp_path / "out.mkv", "camera": GOOD}
    with pytest.raises(ValueError, match="millisecond"):
        prepare(Request.model_validate(request))
    prepare(Request.model_validate(request | {"input": {"range": (0.0, 0.02)}}))


@pytest.fixture(params=["photograph", "clip"])
def source(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    """64 x 48 px."""
    if request.param == "clip":
        return make(tmp_path / "in.mp4", frames=2)
    cv2.imwrite(str(tmp_path / "in.png"), np.random.default_rng(0).integers(0, 256, (48, 64, 3), dtype=np.uint8))
    return tmp_path / "in.png"


def task(source: Path, **sections: dict[str, Any]) -> Task:
    output = source.with_name("out" + source.suffix)
    return prepare(Request.model_validate({"source": source, "output": output, "camera": GOOD, **sections}))


def test_a_request_that_states_nothing_has_the_cores_own_settings(source: Path) -> None:
    found = task(source)
    assert found.settings == Settings()
    wanted = Encoding()
    assert output_format.Encoding(codec=wanted.codec, crf=wanted.crf, pixel_format=wanted.pixel_format) == output_format.Encoding()
    assert (found.rows, found.cols, found.timing_source, found.camera.source) == (48, 64, "explicit", "explicit")


@pytest.mark.parametrize(
    ("camera", "words"),
    [
        ({**GOOD, "focal_px": 4.2}, r"focal-px must be at least 12.8 px .* got 4.2; is it in millimetres\?"),
        ({**GOOD, "readout": None, "row_time": 0.03}, r"row-time must let 48 rows be read in 1 s, got 0.03 s a row; is it in milliseconds"),
    ],
)
def test_slips_of_the_unit_are_told_alike(source: Path, camera: dict[str, Any], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        task(source, camera=camera)


def test_a_photographs_exif_is_a_source_among_others(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x8769] = {33434: IFDRational(1, 25), 41989: 28}
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)).save(tmp_path / "in.jpg", exif=exif)
    found = task(tmp_path / "in.jpg", camera={"readout": 0.02})
    assert (found.shutter.exposure.value, found.shutter.exposure.source) == (pytest.approx(0.04), "EXIF")
    assert found.timing_source == "exposure: EXIF; readout: explicit"
    assert found.camera.source == "EXIF"
    assert any("35 mm equivalent of 28 mm" in note for note in found.notes)


def test_an_exposure_in_exif_that_cannot_be_is_passed_over_aloud(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x8769] = {33434: IFDRational(30, 1)}
    Image.fromarray(np.zeros((60, 80, 3), np.uint8)).save(tmp_path / "in.jpg", exif=exif)
    with pytest.raises(ValueError, match=r"exposure must be given.*passed over what EXIF says: exposure must lie in \(0, 1\] s, got 30 s"):
        task(tmp_path / "in.jpg", camera={"readout": 0.02, "focal_px": 100})


def test_a_profiles_distortion_and_noise_reach_the_work(source: Path) -> None:
    lens = "{fx: 60, fy: 60, cx: 31, cy: 24, distortion: {model: fisheye, coefficients: [0.1, 0, 0, 0]}}"
    profile = source.with_name("mine.yaml")
    profile.write_text(f"name: Mine\nmode: {{rows: 48, cols: 64}}\nintrinsics: {lens}\nnoise: {{read: 0.002, shot: 1e-4}}\n")
    camera = {"exposure": 0.02, "readout": 0.02, "profile": str(profile)}
    taken = task(source, camera=camera).treatment.camera
    assert taken.intrinsics.distortion == Distortion(model="fisheye", coefficients=(0.1, 0, 0, 0))
    assert taken.noise == Noise(read=0.002, shot=1e-4)
    other = task(source, camera={**camera, "focal_px": 100})  # whose distortion is not known
    assert other.treatment.camera.intrinsics.distortion is None
    assert any("the distortion of" in note for note in other.notes)
    assert other.treatment.camera.noise == Noise(read=0.002, shot=1e-4)


@pytest.mark.parametrize(
    ("stated", "measured", "shown"),
    [
        ({"exposure": 0.02}, {"exposure": 0.02, "blur": 5.0, "readout": 0.02}, True),
        ({}, {"exposure": 0.03, "sharp": 0.02, "blur": 5.0, "readout": 0.02}, True),
        ({"exposure": 0.02}, {"readout": 0.02}, False),
    ],
)
def test_a_clip_whose_blur_has_shown_its_exposure_is_trusted_for_that(
    stated: dict[str, float], measured: dict[str, Any], shown: bool, tmp_path: Path
) -> None:
    found = task(make(tmp_path / "in.mp4", frames=2), camera={"readout": 0.02, "focal_px": 100, **stated}, measured=measured)
    assert found.timing.exposure == 0.02
    assert found.treatment.exposure_shown == shown


def test_the_method_none_takes_a_clip_of_any_rate(tmp_path: Path) -> None:
    fast = make(tmp_path / "in.mp4", rate=20_000, frames=2)
    assert task(fast, deblur={"method": "none"}).stream.rate == 20_000
