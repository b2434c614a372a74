"""What `import calibration` offers, called as a person's own program calls it."""

import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

import calibration
from calibration import CannotTell, ReadoutMeasurement, flicker
from calibration.boards.render import photographs
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.progress import Progress

BOARD = "chessboard:6x5:25mm"


@pytest.fixture(scope="module")
def wall(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A photograph of a wall under a light of 1 kHz, read in 20 ms."""
    path = tmp_path_factory.mktemp("wall") / "wall.png"
    timing = ShutterTiming.from_readout(exposure=2e-4, readout=0.02, rows=240)
    assert cv2.imwrite(str(path), flicker.wall(timing, hertz=1000.0))
    return path


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four photographs of a board, and one of nothing."""
    folder = tmp_path_factory.mktemp("views")
    for n, picture in enumerate(photographs(BOARD, 4, focal_px=300.0)):
        assert cv2.imwrite(str(folder / f"{n}.png"), picture)
    assert cv2.imwrite(str(folder / "empty.png"), np.full((240, 320), 90, np.uint8))
    return folder


def test_importing_loads_neither_arrays_nor_pictures() -> None:
    heavy = "import sys, calibration; print({'numpy', 'cv2', 'scipy', 'pydantic', 'matplotlib'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", heavy], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"


def test_a_measured_readout_says_between_which_times_it_lies(wall: Path) -> None:
    found = calibration.readout(wall, flicker=1000.0)
    assert isinstance(found, ReadoutMeasurement)
    assert found.std is not None
    assert found.confidence == pytest.approx((found.value - 2 * found.std, found.value + 2 * found.std))
    assert found.profile(name="Mine").timing is not None


def test_what_the_material_does_not_show_is_a_value_with_its_reason(tmp_path: Path) -> None:
    timing = ShutterTiming.from_readout(exposure=2e-4, readout=0.02, rows=240)
    assert cv2.imwrite(str(tmp_path / "steady.png"), flicker.wall(timing, hertz=1000.0, depth=0.0))
    found = calibration.readout(tmp_path / "steady.png", flicker=1000.0)
    assert isinstance(found, CannotTell)
    assert found.reason.startswith("no bands stand out from the scene")


def test_a_stated_direction_goes_into_the_profile(wall: Path) -> None:
    found = calibration.readout(wall, flicker=1000.0, direction="bottom-to-top")
    assert isinstance(found, ReadoutMeasurement)
    assert found.direction is None
    clock = found.profile().timing
    assert clock is not None
    assert clock.direction is Direction.BOTTOM_TO_TOP


@pytest.mark.parametrize(
    ("options", "line"),
    [
        ({}, "measured by one of flicker, from_clip, table, scanlines_total, got none"),
        ({"flicker": 500.0, "from_clip": True}, "got flicker and from_clip"),
        ({"flicker": 5.0}, "flicker must lie in 20 Hz to 100 kHz, got 5 Hz"),
        ({"flicker": 500.0, "frames": 0}, "frames must lie in 1 to 10000, got 0"),
        ({"flicker": 500.0, "direction": "sideways"}, "'sideways' is not a valid Direction"),
        ({"table": ("GoPro HERO8 Black", "1080p")}, "source must be a file or a folder, and none with a table"),
    ],
)
def test_a_request_for_a_readout_that_cannot_be_meant_is_refused(wall: Path, options: dict, line: str) -> None:
    with pytest.raises(ValueError, match=line):
        calibration.readout(wall, **options)


@pytest.mark.slow
def test_a_lens_names_the_views_that_are_refused_and_says_how_far_it_is(views: Path) -> None:
    stages: list[Progress] = []
    found = calibration.lens(views, BOARD, model="brown-conrady", observer=stages.append)
    assert found.matrix[0, 0] == pytest.approx(300, rel=0.02)
    assert list(found.view_rms_px) == [f"{n}.png" for n in range(4)]
    assert [(one.name, one.reason) for one in found.refused] == [("empty.png", "the board was not found")]
    assert [one.fraction for one in stages] == pytest.approx([0.2, 0.4, 0.6, 0.8, 1.0])
    assert "4 views are few" in found.notes[0]


def test_views_that_are_too_few_are_told_with_the_others_reasons(views: Path) -> None:
    with pytest.raises(calibration.TooFewViewsError, match="at least 3 views of the board, 1 can be used") as caught:
        calibration.lens([views / "0.png", views / "empty.png"], BOARD)
    assert [one.name for one in caught.value.refused] == ["empty.png"]


@pytest.mark.slow
def test_profiles_grow_part_by_part_and_are_not_replaced_unasked(wall: Path, tmp_path: Path) -> None:
    file = tmp_path / "mine.yaml"
    found = calibration.readout(wall, flicker=1000.0)
    assert isinstance(found, ReadoutMeasurement)
    lens = calibration.CameraProfile.model_validate(
        {"name": "Mine", "mode": {"rows": 240, "cols": 32}, "intrinsics": {"fx": 40, "fy": 40, "cx": 16, "cy": 120}}
    )
    calibration.profile.write(lens, file)
    with pytest.raises(FileExistsError, match="exists already"):
        calibration.profile.write(found, file)
    both = calibration.profile.write(found, file, add=True)
    assert both.timing is not None
    assert (both.name, both.intrinsics) == ("Mine", lens.intrinsics)
    assert calibration.profile.read(file).intrinsics == lens.intrinsics
    replaced = calibration.profile.write(found, file, overwrite=True)
    assert replaced.intrinsics is None


def test_a_profile_is_converted_to_forms_that_there_are_alone() -> None:
    with pytest.raises(ValueError, match="did you mean opencv"):
        calibration.profile.convert("nikon_1_j1_1080p30", "openvc")
