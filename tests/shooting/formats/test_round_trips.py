"""Cameras written for other programs and read back: nothing that the format holds changes on the way."""

import contextlib
import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rsvideo.config.files import UnreadableError
from rsvideo.config.yaml import ConfigError
from rsvideo.physics.shutter import Direction
from rsvideo.shooting import profiles
from rsvideo.shooting.camera_profile import CameraProfile
from rsvideo.shooting.formats.gyroflow import ReadoutName

ENDING = {"rsvideo": "yaml", "gyroflow": "json", "kalibr": "yaml", "opencv": "yml", "ros": "yaml"}


def camera(model: str = "brown-conrady", coefficients: tuple[float, ...] = (-0.28, 0.07, 1e-3, -2e-5), **other) -> CameraProfile:
    data = {
        "name": "X 1",
        "maker": "Maker",
        "mode": {"rows": 1080, "cols": 1920, "fps": 29.97},
        "intrinsics": {
            "fx": {"value": 1500.123456789, "std": 1e-7},
            "fy": 1501.5,
            "cx": 960.25,
            "cy": 539.75,
            "distortion": {"model": model, "coefficients": list(coefficients)},
        },
        "timing": {"readout_s": 0.01573, "direction": "bottom-to-top"},
    }
    return CameraProfile.model_validate(data | other)


def through(folder: Path, form: str, what: CameraProfile) -> CameraProfile:
    path = folder / f"camera.{ENDING[form]}"
    path.write_bytes(profiles.encode(what, form)[0])
    return profiles.find(str(path))


def lens(what: CameraProfile) -> tuple[list[float], str | None, list[float]]:
    assert what.intrinsics is not None
    pinhole, bent = what.intrinsics, what.intrinsics.distortion
    numbers = [number.value for number in (pinhole.fx, pinhole.fy, pinhole.cx, pinhole.cy)]
    return numbers, bent.model if bent else None, [number.value for number in bent.coefficients] if bent else []


@pytest.mark.parametrize("form", ENDING)
@pytest.mark.parametrize("model", ["brown-conrady", "fisheye"])
def test_a_lens_survives_the_way_through_every_format(tmp_path: Path, form: str, model: str) -> None:
    what = camera(model)
    back = through(tmp_path, form, what)
    numbers, kind, coefficients = lens(back)
    assert (numbers, kind) == lens(what)[:2]
    assert coefficients[:4] == lens(what)[2]
    assert not any(coefficients[4:])
    assert (back.mode.rows, back.mode.cols) == (1080, 1920)


@pytest.mark.parametrize("form", ["gyroflow", "opencv", "ros"])
def test_eight_coefficients_survive_where_the_format_holds_them(tmp_path: Path, form: str) -> None:
    coefficients = (0.1, -0.2, 1e-4, -1e-4, 0.05, 0.3, -0.01, 0.02)
    assert lens(through(tmp_path, form, camera(coefficients=coefficients)))[2] == list(coefficients)


def test_coefficients_that_a_format_cannot_hold_are_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="kalibr holds 4 coefficients of distortion, the profile has 5"):
        profiles.encode(camera(coefficients=(0.1, 0, 0, 0, 0.2)), "kalibr")


@pytest.mark.parametrize(("direction", "spelt"), [(direction, name.value) for direction, name in zip(Direction, ReadoutName, strict=True)])
def test_gyroflow_spells_each_direction_by_name(tmp_path: Path, direction: Direction, spelt: str) -> None:
    what = camera(timing={"readout_s": 0.01573, "direction": direction})
    assert json.loads(profiles.encode(what, "gyroflow")[0])["frame_readout_direction"] == spelt
    back = through(tmp_path, "gyroflow", what).timing
    assert back is not None
    assert (back.readout_s.value, back.direction) == (pytest.approx(0.01573), direction)
    assert spelt.lower() == direction.value.replace("-", "")


@pytest.mark.parametrize(("direction", "sign"), [(Direction.TOP_TO_BOTTOM, 1), (Direction.BOTTOM_TO_TOP, -1)])
def test_kalibr_tells_the_direction_by_the_sign_of_its_line_delay(tmp_path: Path, direction: Direction, sign: int) -> None:
    what = camera(timing={"readout_s": 0.01573, "direction": direction})
    assert f"line_delay: {sign * 0.01573 / 1080!r}" in profiles.encode(what, "kalibr")[0].decode()
    back = through(tmp_path, "kalibr", what).timing
    assert back is not None
    assert (back.readout_s.value, back.direction) == (pytest.approx(0.01573), direction)


def test_kalibr_cannot_hold_columns_that_are_read_in_turn() -> None:
    data, notes = profiles.encode(camera(timing={"readout_s": 0.01573, "direction": "left-to-right"}), "kalibr")
    assert b"line_delay" not in data
    assert "holds no timing" in notes[0]


def test_an_old_profile_of_gyroflow_says_upwards_by_a_negative_time(tmp_path: Path) -> None:
    data = json.loads(profiles.encode(camera(), "gyroflow")[0])
    data |= {"frame_readout_time": -15.73, "frame_readout_direction": None}
    path = tmp_path / "old.json"
    path.write_text(json.dumps(data))
    timing = profiles.find(str(path)).timing
    assert timing is not None
    assert (timing.readout_s.value, timing.direction) == (pytest.approx(0.01573), Direction.BOTTOM_TO_TOP)


def test_a_distortion_that_only_gyroflow_has_is_left_out_and_said(tmp_path: Path) -> None:
    data = json.loads(profiles.encode(camera(), "gyroflow")[0]) | {"distortion_model": "gopro_superview"}
    path = tmp_path / "lens.json"
    path.write_text(json.dumps(data))
    read = profiles.find(str(path)).intrinsics
    assert read is not None
    assert read.distortion is None
    assert read.found is not None
    assert "gopro_superview, is left out" in str(read.found.how)


@pytest.mark.parametrize("model", ["brown-conrady", "fisheye"])
def test_opencv_itself_reads_what_is_written_for_it_and_its_files_are_read(tmp_path: Path, model: str) -> None:
    path = tmp_path / "camera.yml"
    path.write_bytes(profiles.encode(camera(model), "opencv")[0])
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    matrix, coefficients = storage.getNode("camera_matrix").mat(), storage.getNode("distortion_coefficients").mat()
    assert storage.getNode("fisheye_model").real() == (model == "fisheye")
    storage.release()
    np.testing.assert_array_equal(matrix, [[1500.123456789, 0, 960.25], [0, 1501.5, 539.75], [0, 0, 1]])
    assert coefficients.ravel().tolist() == lens(camera())[2]
    theirs = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    for key, value in (("image_width", 1920), ("image_height", 1080), ("fisheye_model", int(model == "fisheye"))):
        theirs.write(key, value)
    theirs.write("camera_matrix", matrix)
    theirs.write("distortion_coefficients", coefficients)
    theirs.release()
    assert lens(profiles.find(str(path))) == lens(camera(model))


def test_the_published_calibration_of_opencvs_chessboards_is_read(shared: Path) -> None:
    read = profiles.find(str(shared / "real" / "boards" / "opencv_stereo_chessboard" / "left_intrinsics.yml"))
    numbers, model, coefficients = lens(read)
    assert numbers == pytest.approx([535.91573, 535.91573, 342.28315, 235.57083])
    assert (model, len(coefficients)) == ("brown-conrady", 5)
    assert (read.mode.rows, read.mode.cols) == (480, 640)


def test_a_readout_is_said_with_the_source_of_its_part() -> None:
    what = camera(timing={"readout_s": 0.01573, "found": {"source": "led.mp4"}})
    readout = profiles.for_clip(what, 1080, 1920, 29.97)[0].readout
    assert readout is not None
    assert readout.source == "the profile of Maker X 1 (led.mp4)"


def test_our_own_file_keeps_everything(tmp_path: Path) -> None:
    what = camera(
        name="1e5",  # a word, though it looks like a number
        tone={"transfer": "srgb", "clip": 0.99, "curve_std": 0.01, "found": {"how": "7 exposures: a, b", "files": {"a b.jpg": "0" * 64}}},
        noise={"read": {"value": 0.0012345, "std": 1e-5}, "shot": 1e-5},
    )
    path = tmp_path / "camera.yaml"
    path.write_bytes(profiles.encode(what)[0])
    back = profiles.find(str(path))
    assert back.model_dump(exclude={"noise"}) == what.model_dump(exclude={"noise"})
    assert back.noise is not None
    assert back.noise.read.value == pytest.approx(0.0012345, abs=1e-7)
    assert len(path.read_text().splitlines()) < 40


@pytest.mark.parametrize("name", profiles.names())
def test_the_profiles_that_ship_survive_being_written(tmp_path: Path, name: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_bytes(profiles.encode(profiles.find(name))[0])
    assert profiles.find(str(path)) == profiles.find(name)


@pytest.mark.parametrize(
    ("form", "old", "new", "line"),
    [
        (
            "gyroflow",
            '"frame_readout_time": 15.73',
            '"frame_readout_time": 0.0157',
            "frame_readout_time: must be at least 1 ms, got 0.0157",
        ),
        ("gyroflow", '"BottomToTop"', '"BottomToTopp"', "frame_readout_direction: input should be"),
        ("gyroflow", '"calib_dimension"', '"calib_dimensions"', "calib_dimension: must be given"),
        ("gyroflow", "}", "", "must be JSON"),
        ("kalibr", "pinhole", "omni", "cam0.camera_model: input should be 'pinhole', got omni"),
        ("kalibr", "1080]", "]", "cam0.resolution"),
        ("kalibr", "cam0:", "cam1: {}\ncam0:", "camera.yaml:1: cam1: must be the chain of one camera"),
        ("opencv", "rows: 3", "rows: 4", "camera.yml:5: camera_matrix: must hold 4 x 3 finite numbers, got 9"),
        ("opencv", "image_width: 1920", "image_width: wide", "image_width: must be a whole number, got wide"),
        ("opencv", "camera_matrix", "kamera_matrix", "camera_matrix: must be given"),
        ("ros", "plumb_bob", "plumb_bobb", "did you mean plumb_bob?"),
        ("ros", "1.0]", "]", "camera_matrix: must hold 9 numbers"),
    ],
)
def test_a_slip_in_another_programs_file_is_told(tmp_path: Path, form: str, old: str, new: str, line: str) -> None:
    path = tmp_path / f"camera.{ENDING[form]}"
    text = profiles.encode(camera(), form)[0].decode()
    assert old in text
    path.write_text(text.replace(old, new, 1) if old != "}" else text.rsplit("}", 1)[0])
    with pytest.raises(ConfigError) as caught:
        profiles.find(str(path))
    assert any(line in fault for fault in caught.value.faults), caught.value.faults
    assert all(str(path) in fault for fault in caught.value.faults)


@pytest.mark.parametrize("form", ENDING)
@settings(max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_damage_to_a_file_raises_anything_but_a_fault(tmp_path: Path, form: str, data: st.DataObject) -> None:
    text = profiles.encode(camera(), form)[0].decode()
    start, length = data.draw(st.integers(0, len(text))), data.draw(st.integers(0, 40))
    patch = data.draw(
        st.text("{}[]:-,0123456789abceE.\n '\"&*!", max_size=12) | st.sampled_from(["1e999", "NaN", "-1", "null", "[" * 5000])
    )
    path = tmp_path / f"camera.{ENDING[form]}"
    path.write_text(text[:start] + patch + text[start + length :])
    with contextlib.suppress(ConfigError, UnreadableError):
        profiles.find(str(path))
