"""A request is another one when any file that steers it holds something else, wherever it lies."""

from pathlib import Path
from typing import Any

import pytest

from rsvideo.config.method import GyroFile, Method
from rsvideo.pipeline import fingerprint
from rsvideo.pipeline.clip_job import ClipJob


def of(folder: Path, **words: Any) -> str:
    return fingerprint.of_request(ClipJob(source=folder / "in.mp4", output=folder / "out.mp4", **words))


@pytest.mark.parametrize(
    "words",
    [
        lambda file: {"trajectory": file},
        lambda file: {"method": Method.GYRO, "gyro": GyroFile(path=file, offset=1.0)},
        lambda file: {"camera": str(file)},
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
    assert of(tmp_path) == of(tmp_path / "elsewhere", overwrite=True) != of(tmp_path, exposure=0.01)
    assert of(tmp_path, gyro=GyroFile(offset=1.0)) != of(tmp_path, gyro=GyroFile(offset=2.0))
