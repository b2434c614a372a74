"""A request is another one when any file that steers it holds something else, wherever it lies."""

from pathlib import Path
from typing import Any

import pytest

from rsvideo.config.method import Method
from rsvideo.config.request import Request
from rsvideo.pipeline import fingerprint


def of(folder: Path, **words: Any) -> str:
    return fingerprint.of_request(Request(source=folder / "in.mp4", output=folder / "out.mp4", **words))


@pytest.mark.parametrize(
    "words",
    [
        lambda file: {"motion": {"trajectory": file}},
        lambda file: {"deblur": {"method": Method.GYRO}, "motion": {"gyro": file, "gyro_offset": 1.0}},
        lambda file: {"camera": {"profile": str(file)}},
    ],
    ids=["trajectory", "gyro", "camera"],
)
def test_files_count_by_what_they_hold(tmp_path: Path, words) -> None:
    made = []
    for name, text in (("a", "one"), ("b", "one"), ("c", "two")):
        (tmp_path / name).mkdir()
        (tmp_path / name / "file").write_text(text)
        made.append(of(tmp_path / name, **words(tmp_path / name / "file")))
    assert made[0] == made[1] != made[2]


def test_words_count_and_places_do_not(tmp_path: Path) -> None:
    assert of(tmp_path) == of(tmp_path / "elsewhere", overwrite=True) != of(tmp_path, camera={"exposure": 0.01})
    assert of(tmp_path, motion={"gyro_offset": 1.0}) != of(tmp_path, motion={"gyro_offset": 2.0})
