"""What owners published about the readout of their cameras."""

import csv
from importlib import resources

import pytest

from rsvideo.physics.shutter import Direction
from rsvideo.shooting.readout_table import similar, table, typical


def test_the_table_ships_with_its_licence() -> None:
    folder = resources.files("rsvideo.shooting")
    assert folder.joinpath("readout_times.LICENSE").read_text().startswith("Creative Commons Legal Code\n\nCC0 1.0 Universal")
    assert len(folder.joinpath("readout_times.csv").read_text().splitlines()) == 1095


def test_times_that_cannot_be_are_passed_over() -> None:
    entries = table()
    assert len(entries) > 1000
    assert all(1e-3 <= entry.readout <= 1.01 / entry.fps for entry in entries if entry.fps)


def test_the_table_is_that_of_the_profiles(shared) -> None:
    with (shared / "real" / "readout" / "gyroflow_lens_profiles_readout.csv").open(newline="") as file:
        published = sorted(
            (line["brand"], line["model"], int(line["w"]), round(float(line["frame_readout_time_ms"]), 2)) for line in csv.DictReader(file)
        )
    text = resources.files("rsvideo.shooting").joinpath("readout_times.csv").read_text()
    ours = sorted(
        (line["maker"], line["model"], int(line["cols"]), round(float(line["readout_ms"]), 2)) for line in csv.DictReader(text.splitlines())
    )
    assert ours == published


def test_the_narrowest_mode_that_anyone_measured_answers() -> None:
    exact = typical("Sony a7 IV", rows=2160, cols=3840, fps=25.0)
    assert exact is not None
    assert exact.mode == "3840 x 2160 at 25 fps"
    assert exact.n > 5
    assert exact.median == pytest.approx(26.8e-3)
    assert exact.low < exact.median < exact.high
    other = typical("Sony a7 IV", rows=123, cols=456, fps=25.0)
    anything = typical("Sony a7 IV")
    assert other is not None
    assert anything is not None
    assert (other.mode, anything.mode) == ("25 fps", "any of its modes")
    assert exact.n < other.n < anything.n


def test_size_says_more_than_rate() -> None:
    found = typical("iPhone 12", rows=2160, cols=3840, fps=24.0)  # there are 2160 rows at 60 fps, and 1080 at 24
    assert found is not None
    assert found.mode == "3840 x 2160"


def test_no_time_is_longer_than_a_frame() -> None:
    slow = typical("Canon R10")
    assert slow is not None
    assert slow.high > 1 / 60
    fast = typical("Canon R10", fps=45.0)  # which nobody measured
    assert fast is not None
    assert fast.high < 1 / 45


@pytest.mark.parametrize(
    ("written", "table_name"),
    [
        ("Canon EOS 5D Mark III", "Canon 5D Mark iii"),
        ("Canon Canon EOS R6 Mark II", "Canon R6ii"),
        ("SONY ILCE-7M4", "Sony A7iv"),
        ("ILCE-7RM5", "Sony a7RV"),
        ("ILME-FX3", "Sony FX3"),
        ("Sony α6400", "Sony a6400"),
        ("NIKON CORPORATION NIKON Z 6_2", "Nikon Z6 II"),
        ("Panasonic DC-S5M2", "Panasonic S5II"),
        ("FUJIFILM X-T4", "Fujifilm XT4"),
        ("GoPro GoPro Max", "GoPro Max"),
        ("canon eos 200d", "Canon 200D / SL2"),
        ("iphone 12", "Apple iPhone 12"),
        ("Samsung S23", "Samsung Galaxy S23"),
    ],
)
def test_a_camera_is_known_by_every_way_its_name_is_written(written: str, table_name: str) -> None:
    assert typical(written) is not None
    assert typical(written) == typical(table_name)


@pytest.mark.parametrize(
    ("one", "other"),
    [
        ("Canon EOS R5", "Canon EOS R5C"),
        ("Canon EOS R6", "Canon EOS R6 Mark II"),
        ("Sony a7III", "Sony a7SIII"),
        ("iPhone 15 Pro", "iPhone 15 Pro Max"),
    ],
)
def test_cameras_of_like_names_are_told_apart(one: str, other: str) -> None:
    assert typical(one) != typical(other)


def test_makers_count_where_both_are_said() -> None:
    assert typical("RunCam 6") is not None
    assert typical("GoPro 6") is None
    assert typical("6") is not None


@pytest.mark.parametrize("name", ["", "/", "no such camera", "Canon", "\x00", "((((", "x" * 10**6])
def test_an_unknown_camera_has_no_time(name: str) -> None:
    assert typical(name) is None


def test_near_names_are_suggested() -> None:
    assert "GoPro HERO5 Black" in similar("GoPro HERO5 Blak")


def test_a_readout_upwards_needs_several_witnesses() -> None:
    alone = typical("Canon M50")
    assert alone is not None
    assert (alone.n, alone.direction) == (1, Direction.TOP_TO_BOTTOM)
