"""A request's options stand once: with their words, their bounds and their defaults."""

import pickle
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from rsvideo.config.method import Method
from rsvideo.config.request import Request, Sections, option_fields

HERE = {"source": Path("a.mp4"), "output": Path("b.mp4")}


def request(**sections: dict[str, Any]) -> Request:
    return Request.model_validate({**HERE, **sections})


def test_every_field_of_a_section_is_an_option_with_words_of_its_own() -> None:
    fields = {f"{section}.{name}" for section, part in Sections.model_fields.items() for name in part.annotation.model_fields}  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue]
    assert {each.key for each in option_fields()} == fields
    flags = [each.flag for each in option_fields()]
    assert len(set(flags)) == len(flags)
    assert all(each.option.help.endswith((".", "...")) for each in option_fields())


def test_the_schema_has_the_same_words() -> None:
    schema = Request.model_json_schema()
    for each in option_fields():
        properties = schema["$defs"][each.section.capitalize()]["properties"]
        assert properties[each.name]["description"].startswith(each.option.help)


def test_what_is_stated_is_told_from_what_is_left_out() -> None:
    stated = request(camera={"exposure": "1/50"}, motion={"degree": 4})
    assert stated.stated() == {"camera": {"exposure": 0.02}, "motion": {"degree": 4}}
    assert pickle.loads(pickle.dumps(stated)) == stated


def test_nothing_takes_back_what_an_earlier_layer_states() -> None:
    layers = [Sections.model_validate({"motion": {"degree": 3}, "camera": {"exposure": 0.02}}) for _ in range(1)]
    over = Sections.model_validate({"motion": {"degree": None}, "camera": {"exposure": None}})
    merged = Sections.layered([*layers, over])
    assert (merged.motion.degree, merged.camera.exposure) == (4, None)


def test_what_concerns_clips_only_is_passed_over_for_photographs() -> None:
    both = Sections.model_validate({"camera": {"shutter_angle": 180, "readout": "20ms"}, "encoding": {"codec": "ffv1"}})
    assert [each.flag for each in both.of_clips()] == ["--shutter-angle", "--codec"]
    assert both.without_clips_options().stated() == {"camera": {"readout": 0.02}, "encoding": {}}
    assert not both.without_clips_options().of_clips()


def test_files_are_relative_to_the_file_that_names_them(tmp_path: Path) -> None:
    (tmp_path / "mine.yaml").touch()
    stated = {"motion": {"gyro": "log.csv"}, "camera": {"profile": "mine.yaml"}}
    there = Sections.model_validate(stated).files_beside(tmp_path)
    assert (there.motion.gyro, there.camera.profile) == (tmp_path / "log.csv", str(tmp_path / "mine.yaml"))
    named = Sections.model_validate({"camera": {"profile": "nikon_1_j1_1080p30"}}).files_beside(tmp_path)
    assert named.camera.profile == "nikon_1_j1_1080p30"


def test_a_change_leaves_the_rest() -> None:
    before = request(deblur={"prior": "tv"})
    after = before.replaced(output=Path("c.mp4"), deblur={"method": Method.NONE})
    assert (after.output, after.deblur.method, after.deblur.prior, before.deblur.method) == (
        Path("c.mp4"),
        Method.NONE,
        "tv",
        Method.RSVIDEO,
    )


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({"camera": {"exposure": 20}}, "exposure must lie in (0, 1] s, got 20 s; is it in milliseconds?"),
        ({"camera": {"shutter_angle": "half"}}, "shutter_angle must lie in (0, 360] degrees, got half"),
        ({"camera": {"transfer": "bt708"}}, "did you mean bt709?"),
        ({"input": {"rate": "0/0"}}, "rate must be a number of frames a second such as 25 or 24000/1001"),
        ({"input": {"range": "12-10"}}, "from an earlier to a later time"),
        ({"motion": {"degree": 13}}, "less than or equal to 12"),
        ({"camera": {"exposur": 1}}, "Extra inputs are not permitted"),
    ],
)
def test_what_cannot_be_meant_is_refused_where_it_enters(sections: dict[str, Any], words: str) -> None:
    with pytest.raises(ValidationError) as caught:
        request(**sections)
    assert words in str(caught.value)
