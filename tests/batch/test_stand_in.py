"""The stand-in promises what the core promises."""

import ast
import dataclasses
import inspect
from pathlib import Path

import pytest

from rsvideo.pipeline import chunk, clip, clip_job

CORE = {**vars(clip_job), **vars(chunk), **vars(clip)}
TREE = ast.parse(Path(__file__).with_name("stand_in.py").read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", ["ClipJob", "Chunk"])
def test_what_goes_in_has_the_same_fields(name: str) -> None:
    (shape,) = (each for each in TREE.body if isinstance(each, ast.ClassDef) and each.name == name)
    fields = [each.target.id for each in shape.body if isinstance(each, ast.AnnAssign) and isinstance(each.target, ast.Name)]
    assert [field.name for field in dataclasses.fields(CORE[name])] == fields


@pytest.mark.parametrize("name", ["prepare", "chunks", "work", "finish"])
def test_what_is_called_has_the_same_parameters(name: str) -> None:
    (function,) = (each for each in TREE.body if isinstance(each, ast.FunctionDef) and each.name == name)
    assert list(inspect.signature(CORE[name]).parameters) == [each.arg for each in function.args.args]


def test_what_comes_out_has_what_is_read_from_it() -> None:
    for name in ("job", "timing", "timing_source", "notes", "frames", "rows", "cols", "estimate"):
        assert name in {field.name for field in dataclasses.fields(clip_job.ClipTask)} | set(vars(clip_job.ClipTask))
    assert {"notes", "restored", "left", "failed", "seconds"} <= {field.name for field in dataclasses.fields(clip.Outcome)}
    assert {"pictures", "sha256"} <= set(chunk.ChunkRecord.model_fields)
