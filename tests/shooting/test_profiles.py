"""Camera profiles: read, found, and made to fit a clip."""

import contextlib
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from rsvideo.config import yaml
from rsvideo.config.files import UnreadableError
from rsvideo.config.yaml import ConfigError
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.shutter import Direction
from rsvideo.physics.tone import Curve, Transfer
from rsvideo.shooting import profiles
from rsvideo.shooting.profiles import CameraProfile, find, for_clip

CAMERA = """\
name: Test 1
maker: Maker
mode: {rows: 480, cols: 640, fps: 29.97}
intrinsics:
  fx: {value: 800, std: 0.5, how: chessboard, when: 2026-01-31, source: views/}
  fy: 801
  cx: 319.5
  cy: 239.5
  distortion: {model: brown-conrady, coefficients: [0.1, -0.05, 0, 0]}
timing:
  readout_s: {value: 0.0157, std: 0.0001, source: flicker.mp4}
  direction: bottom-to-top
tone: {transfer: bt709}
noise: {read: 0.001, shot: 1e-5}
"""


def camera(folder: Path, old: str = "", new: str = "") -> CameraProfile:
    path = folder / "camera.yaml"
    path.write_text(CAMERA.replace(old, new) if old else CAMERA)
    return find(str(path))


def test_a_profile_says_what_its_file_says(tmp_path: Path) -> None:
    facts, notes = for_clip(camera(tmp_path), 480, 640, 30.0)
    assert notes == ()
    assert facts.intrinsics is not None
    assert (facts.intrinsics.fx, facts.intrinsics.fy, facts.intrinsics.cx) == (800, 801, 319.5)
    assert facts.readout is not None
    assert facts.readout.value == 0.0157
    assert facts.readout.within == pytest.approx((0.0155, 0.0159))
    assert facts.readout.source == "the profile of Maker Test 1 (flicker.mp4)"
    assert facts.direction is not None
    assert facts.direction.value is Direction.BOTTOM_TO_TOP
    assert facts.tone is Transfer.BT709
    assert facts.saturation is None
    assert facts.noise is not None
    assert (facts.noise.read, facts.noise.shot) == (0.001, 1e-5)
    assert facts.intrinsics.distortion == Distortion(model="brown-conrady", coefficients=(0.1, -0.05, 0, 0))


def test_a_measured_curve_and_its_clipping_stand_for_the_standards(tmp_path: Path) -> None:
    facts, notes = for_clip(camera(tmp_path, "{transfer: bt709}", "{curve: [0, 0.25, 1], clip: 0.9}"), 480, 640, 30.0)
    assert notes == ()
    assert facts.tone == Curve(light=(0.0, 0.25, 1.0))
    assert facts.saturation == 0.9


def test_a_scaled_clip_keeps_its_field_of_view_and_says_so(tmp_path: Path) -> None:
    facts, notes = for_clip(camera(tmp_path), 960, 1280, 29.97)
    assert facts.intrinsics is not None
    assert (facts.intrinsics.fx, facts.intrinsics.fy) == (1600, 1602)
    assert (facts.intrinsics.cx, facts.intrinsics.cy) == (639.5, 479.5)  # the centre stays the centre
    assert facts.readout is not None
    assert facts.readout.value == 0.0157
    assert len(notes) == 1
    assert "640 x 480 at 29.97 fps, the clip is of 1280 x 960 at 29.97 fps: taken to show the same part" in notes[0]


@pytest.mark.parametrize(
    ("written", "kept"),
    [
        ("[0, 0, 0, 0, 0]", None),
        ("[0.1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]", (0.1, *[0.0] * 11)),
    ],
)
def test_a_lens_is_as_simple_as_its_coefficients(tmp_path: Path, written: str, kept: tuple[float, ...] | None) -> None:
    facts, _ = for_clip(camera(tmp_path, "[0.1, -0.05, 0, 0]", written), 480, 640, 30.0)
    assert facts.intrinsics is not None
    assert (facts.intrinsics.distortion and facts.intrinsics.distortion.coefficients) == kept


@pytest.mark.parametrize(
    ("written", "why"),
    [
        ("[0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0.1, 0]", "tilted"),
        ("[-2, 0, 0, 0]", "folds over"),
        ("[.nan, 0, 0, 0]", "coefficients"),
    ],
)
def test_a_lens_that_cannot_be_modelled_is_refused_in_one_line(tmp_path: Path, written: str, why: str) -> None:
    with pytest.raises(ConfigError, match=why) as caught:
        for_clip(camera(tmp_path, "[0.1, -0.05, 0, 0]", written), 480, 640, 30.0)
    assert len(str(caught.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("rows", "cols", "fps", "why"),
    [
        (360, 640, 29.97, "another part of the sensor"),
        (640, 480, 29.97, "is it stored turned"),
        (480, 640, 25.0, "a readout time belongs to one rate"),
        (480, 640, 59.94, "or --readout"),
    ],
)
def test_a_clip_of_another_mode_is_refused(tmp_path: Path, rows: int, cols: int, fps: float, why: str) -> None:
    with pytest.raises(ConfigError, match=why):
        for_clip(camera(tmp_path), rows, cols, fps)


def test_a_profile_without_timing_serves_every_rate(tmp_path: Path) -> None:
    start, end = CAMERA.index("timing:"), CAMERA.index("tone:")
    facts, _ = for_clip(camera(tmp_path, CAMERA[start:end], ""), 480, 640, 240.0)
    assert facts.readout is None


@pytest.mark.parametrize(
    ("old", "new", "line"),
    [
        (
            "readout_s: {value: 0.0157",
            "readout_s: {value: 15.7",
            "camera.yaml:11: timing.readout_s: must lie in [0, 1] s, got 15.7; is it in mill",
        ),
        ("readout_s: {value: 0.0157", "readout_s: {value: -0.0157", "a readout upwards is `direction: bottom-to-top`"),
        ("readout_s:", "readout:", "timing.readout: there is no such key; did you mean readout_s?"),
        ("bottom-to-top", "bottom-to-topp", "got bottom-to-topp; did you mean bottom-to-top?"),
        ("fy: 801", "fy: -801", "camera.yaml:6: intrinsics.fy: must lie in [1, 1e7) px, got -801; is it in millimetres?"),
        ("transfer: bt709", "clip: 235", "tone.clip: must lie in (0, 1], got 235; is it a code?"),
        ("noise: {read: 0.001", "noise: {read: -1", "noise.read: must not be negative"),
        ("noise: {read: 0.001", "noise: {read: 5", "noise: noise must lie in [0, 1) of white, got read 5"),
        ("fy: 801", "fy: nan", "intrinsics.fy.value: input should be a finite number"),
        ("fy: 801", "fy: [1]", "camera.yaml:6: intrinsics.fy: must be a mapping of keys"),
        ("0, 0]", "0]", "brown-conrady has 4 or 5 or 8 or 12 or 14 coefficients, got 3"),
        ("rows: 480", "rows: 0", "mode.rows: input should be greater than or equal to 1"),
        ("rows: 480", "rows: 480.5", "mode.rows"),
        ("name: Test 1", "name: ''", "name: string should have at least 1 character"),
        ("noise: {read", "noise: {raed", "noise.raed: there is no such key; did you mean read?"),
        ("name: Test 1", "version: 2\nname: Test 1", "version: input should be 1"),
    ],
)
def test_a_slip_in_a_profile_is_told_with_its_line(tmp_path: Path, old: str, new: str, line: str) -> None:
    with pytest.raises(ConfigError) as caught:
        camera(tmp_path, old, new)
    assert any(line in fault for fault in caught.value.faults), caught.value.faults


def test_an_unknown_name_is_told_with_those_there_are() -> None:
    known = profiles.names()
    assert known
    with pytest.raises(ConfigError, match=f"did you mean {known[0]}"):
        find(known[0][:-1])
    with pytest.raises(UnreadableError, match="does not exist"):
        find("no/such/profile.yaml")


def test_a_name_reaches_no_file_outside_the_folder() -> None:
    with pytest.raises((ConfigError, UnreadableError)):
        find(f"../cameras/{profiles.names()[0]}")


@pytest.mark.parametrize("name", profiles.names())
def test_each_profile_that_ships_is_sound_and_says_whence(name: str) -> None:
    shipped = find(name)
    assert shipped.licence
    assert shipped.source
    facts, notes = for_clip(shipped, shipped.mode.rows, shipped.mode.cols, shipped.mode.fps)
    assert notes == ()
    assert facts.readout or facts.intrinsics
    assert not (facts.readout and shipped.mode.fps and facts.readout.value > 1.01 / shipped.mode.fps)


@settings(max_examples=120, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.integers(0, len(CAMERA) - 1), st.integers(0, 30), st.text("{}[]:-,0123456789abc.\n '\"&*!", max_size=12))
def test_no_damage_to_a_profile_raises_anything_but_a_fault(tmp_path: Path, start: int, length: int, patch: str) -> None:
    path = tmp_path / "camera.yaml"
    path.write_text(CAMERA[:start] + patch + CAMERA[start + length :])
    with contextlib.suppress(ConfigError, UnreadableError):
        for_clip(yaml.read(path, CameraProfile), 480, 640, 29.97)
