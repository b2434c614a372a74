"""YAML files of settings: what words mean, what is refused, and where faults are told."""

import contextlib
import re
from enum import StrEnum
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from pydantic import BaseModel, ConfigDict

from rsvideo.config import yaml
from rsvideo.config.files import UnreadableError
from rsvideo.config.yaml import ConfigError


class Colour(StrEnum):
    """A word from a list."""

    RED = "red"
    GREEN = "green"


class Wheel(BaseModel):
    """A mapping within a list."""

    model_config = ConfigDict(extra="forbid")
    radius: float = 1.0
    colour: Colour | None = None


class Cart(BaseModel):
    """The whole file."""

    model_config = ConfigDict(extra="forbid")
    name: str
    kind: Literal["cart", "barrow"] = "cart"
    wheels: list[Wheel] = []
    spare: Wheel | None = None


def written(folder: Path, text: str | bytes) -> Path:
    path = folder / "settings.yaml"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return path


def fault(folder: Path, text: str | bytes) -> str:
    with pytest.raises(ConfigError) as caught:
        yaml.read(written(folder, text), Cart)
    return str(caught.value).removeprefix(str(folder) + "/")


def test_words_mean_what_they_mean_in_yaml_1_2(tmp_path: Path) -> None:
    text = (
        "a: no\nb: 1:30\nc: 2026-01-31\nd: 5e-3\ne: 010\nf: 1/50\ng: '1'\nh: true\ni:\nj: .5\nk: 20ms\nl: -3\n"
        "on: [1, two, {x: 1.5}]\nm: inf\nn: ''\n1: one\n"
    )
    data, _ = yaml.load(written(tmp_path, text))
    assert data == {
        **{"a": "no", "b": "1:30", "c": "2026-01-31", "d": 0.005, "e": 10, "f": "1/50", "g": "1", "h": True, "i": None, "j": 0.5},
        **{"k": "20ms", "l": -3, "on": [1, "two", {"x": 1.5}], "m": "inf", "n": "", "1": "one"},
    }


def test_every_key_and_item_has_its_line(tmp_path: Path) -> None:
    path = written(tmp_path, "# a cart\nname: x\nwheels:\n  - radius: 1\n  -\n    radius: 2\n    colour: red\n")
    _, positions = yaml.load(path)
    assert positions.where(("name",)) == f"{path}:2"
    assert positions.where(("wheels", 1, "colour")) == f"{path}:7"
    assert positions.where(("wheels", 1, "absent")) == f"{path}:6"
    assert positions.where(("absent",)) == f"{path}:2"


def test_a_slip_of_the_pen_is_told_with_its_line_and_what_was_meant(tmp_path: Path) -> None:
    text = "name: x\nwheels:\n- radius: 1\n- raduis: 2\n"
    assert fault(tmp_path, text) == "settings.yaml:4: wheels.1.raduis: there is no such key; did you mean radius?"
    assert fault(tmp_path, "name: x\nkind: barow\n") == (
        "settings.yaml:2: kind: input should be 'cart' or 'barrow', got barow; did you mean barrow?"
    )
    assert fault(tmp_path, "name: x\nspare:\n  colour: rad\n").endswith("got rad; did you mean red?")
    assert fault(tmp_path, "name: x\nzzz: 1\n") == "settings.yaml:2: zzz: there is no such key; there is name, kind, wheels, spare"


def test_all_faults_are_kept_and_the_first_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"settings.yaml:2: kind: input .* \(and 2 more faults\)") as caught:
        yaml.read(written(tmp_path, "nam: x\nkind: 3\n"), Cart)
    assert len(caught.value.faults) == 3
    assert caught.value.faults[2].endswith("settings.yaml:1: name: must be given")


@pytest.mark.parametrize(
    ("text", "line"),
    [
        ("name: x\nname: y\n", "settings.yaml:2: name: is given twice, first in line 1; which one is meant?"),
        ("spare: {radius: 1, radius: 2}\n", "settings.yaml:1: spare.radius: is given twice"),
        ("a: &a [1]\nb: *a\n", "settings.yaml:2: b: must be written out, aliases"),
        ("a: &a [1, *a]\n", "settings.yaml:1: a.1: must be written out"),
        ("name: !!python/object/apply:os.system ['true']\n", "settings.yaml:1: name: must be plain YAML, tags such as"),
        ("name: !!binary aGk=\n", "settings.yaml:1: name: must be plain YAML"),
        ("? [a]\n: 1\n", "settings.yaml:1: must have words as keys"),
        ("? *a\n: 1\n", "settings.yaml:1: must have words as keys"),
        ("a: 1\n---\na: 2\n", "settings.yaml:2: must be one document"),
        ("# nothing\n", "settings.yaml must hold settings, it is empty"),
        ("a:\n\t- b\n", "settings.yaml:2: found character '\\t' that cannot start any token; is it YAML"),
        ("a: [1\nb: 2\n", "settings.yaml:2: "),
        ("[" * 5000, "settings.yaml:1: 0.0.0.0: must hold at most 20000 entries, 32 deep"),
        ("[" + "1," * 30000 + "]", "settings.yaml:1: "),
        ('a: "\\x1b[31m"\n', "settings.yaml:1: a: must hold characters that can be shown"),
        ('a: "\\uD800"\n', "settings.yaml:1: a: must hold characters that can be shown"),
        ('a: "\\UFFFFFFFF"\n', "settings.yaml must be YAML"),
        ("a: \x00\n", "settings.yaml must be YAML"),
        (b"\xff\xd8\xff\xe0", "settings.yaml must be text in UTF-8, byte 0 is not"),
        ("- 1\n", "settings.yaml:1: must be a mapping of keys"),
        ("just a word\n", "settings.yaml:1: must be a mapping of keys"),
    ],
)
def test_what_cannot_be_meant_or_could_harm_is_refused(tmp_path: Path, text: str | bytes, line: str) -> None:
    if 'x1b[31m"' in str(text):
        line = "settings.yaml:1: a: must hold"
    assert fault(tmp_path, text).startswith(line)


def test_a_bomb_of_aliases_is_not_lit(tmp_path: Path) -> None:
    lines = ["a0: &a0 [x, x]"] + [f"a{n}: &a{n} [*a{n - 1}, *a{n - 1}]" for n in range(1, 60)]
    assert re.match(r"settings.yaml:2: a1.0: must be written out", fault(tmp_path, "\n".join(lines)))


def test_a_file_beyond_the_limit_is_not_read(tmp_path: Path) -> None:
    with pytest.raises(UnreadableError, match=r"must hold at most 0\.256 MB"):
        yaml.load(written(tmp_path, "a: " + "x" * 300_000))


@settings(max_examples=200, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(st.one_of(st.binary(max_size=200), st.text("abc:-[]{}&*!|>'\"#%@`,?\n \t0123.~\\", max_size=80).map(str.encode)))
def test_no_file_raises_anything_but_a_fault(tmp_path: Path, data: bytes) -> None:
    path = written(tmp_path, data)
    with contextlib.suppress(ConfigError, UnreadableError):
        yaml.read(path, Cart)
