"""From options to a request: they are made from its models, and what is not given has its default."""

from pathlib import Path

import pytest
import typer

from rsvideo.cli import app, options
from rsvideo.config.method import Method
from rsvideo.config.request import Camera, Deblur, Encoding, Input, Motion, Request, option_fields


def test_options_find_their_place_in_a_request() -> None:
    given = {
        "encoding.crf": 0.0,
        "deblur.prior": "tv",
        "motion.gyro_offset": 0.0,
        "input.range": "1-2",
        "camera.exposure": "1/50",
        "deblur.method": "gyro",
        "camera.force": True,
    }
    clip = options.request(Path("a.mp4"), Path("b.mp4"), given)
    assert clip == Request(
        source=Path("a.mp4"),
        output=Path("b.mp4"),
        input=Input(range=(1.0, 2.0)),
        camera=Camera(exposure=0.02, force=True),
        motion=Motion(gyro_offset=0.0),
        deblur=Deblur(method=Method.GYRO, prior="tv"),
        encoding=Encoding(crf=0.0),
    )
    assert clip.is_clip
    assert not options.request(Path("a.png"), Path("b.png"), {}).is_clip


def test_deblur_offers_every_option_of_a_request_in_its_words() -> None:
    command = typer.main.get_command(app).commands["deblur"]  # pyright: ignore[reportAttributeAccessIssue]
    words = command.get_help(typer.Context(command, info_name="deblur"))
    text = " ".join(words.split())
    for each in option_fields():
        assert f"{each.flag} " in text
        assert " ".join(each.option.help.split()[1:]).lower() in text.lower()


def test_an_option_is_named_as_it_is_written() -> None:
    assert [options.flag(key) for key in ("input.range", "camera.profile", "camera.focal_px")] == ["--range", "--camera", "--focal-px"]


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ({"camera.row_time": "2"}, r"^row-time must lie in \[0, 1\] s, got 2 s; is it in milliseconds\?"),
        ({"camera.focal_px": "35mm"}, r"^focal-px must be a positive number of pixels"),
        ({"motion.gyro_axes": "ABC"}, r"^--gyro-axes: string should match pattern .*, got 'ABC'"),
    ],
)
def test_a_wrong_value_is_told_in_the_command_lines_words(given: dict[str, str], words: str) -> None:
    with pytest.raises(ValueError, match=words):
        options.request(Path("a.png"), Path("b.png"), given)
