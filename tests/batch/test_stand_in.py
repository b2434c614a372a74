"""The stand-in promises what the core promises."""

import ast
import dataclasses
import inspect
from pathlib import Path

import pytest

from rsvideo.pipeline import deblur, prepare

CORE = {**vars(prepare), **vars(deblur)}
TREE = ast.parse(Path(__file__).with_name("stand_in.py").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["prepare", "chunks", "work", "finish"])
def test_what_is_called_has_the_same_parameters(name: str) -> None:
    (function,) = (each for each in TREE.body if isinstance(each, ast.FunctionDef) and each.name == name)
    assert list(inspect.signature(CORE[name]).parameters) == [each.arg for each in function.args.args]


def test_what_comes_out_has_what_is_read_from_it() -> None:
    for name in ("request", "timing", "timing_source", "notes", "first", "frames", "rows", "cols", "estimate"):
        assert name in {field.name for field in dataclasses.fields(prepare.Task)} | set(vars(prepare.Task))
