"""From options to a job: what is not said has its default, and a zero is something said."""

from pathlib import Path

from rsvideo.cli import asked
from rsvideo.config.method import GyroFile, Method
from rsvideo.pipeline.clip_job import ClipJob
from rsvideo.pipeline.job import Job


def test_options_that_say_nothing_leave_no_word() -> None:
    assert asked.words({"exposure": None, "force": False, "path": "keep", "on_damage": "fail", "json": True, "source": "a"}) == {}
    assert asked.words({"quality": 0.0, "gyro_offset": 0.0, "path": "smooth"}) == {"quality": 0.0, "gyro_offset": 0.0, "path": "smooth"}


def test_words_find_their_place_in_a_job() -> None:
    words = {"quality": 0.0, "prior": "tv", "gyro_offset": 0.0, "part": "1-2", "exposure": "1/50", "method": Method.GYRO, "force": True}
    assert asked.job(Path("a.mp4"), Path("b.mp4"), words) == ClipJob(
        source=Path("a.mp4"),
        output=Path("b.mp4"),
        exposure=0.02,
        method=Method.GYRO,
        gyro=GyroFile(offset=0.0),
        steering={"prior": "tv"},
        encoding={"quality": 0.0},
        span=(1.0, 2.0),
        force=True,
    )
    photograph = asked.job(Path("a.png"), Path("b.png"), {"exposure": "20ms", "motion": "shift"})
    assert photograph == Job(source=Path("a.png"), output=Path("b.png"), exposure=0.02, steering={"motion": "shift"})


def test_an_option_is_named_as_it_is_written() -> None:
    assert [asked.option(name) for name in ("part", "focal_px")] == ["--range", "--focal-px"]
