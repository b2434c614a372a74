"""Benchmarks name what they measure by the names that the code has today."""

import runpy
import subprocess
import sys
from importlib import import_module
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).resolve().parent / "benchmarks"
SENSITIVITY = runpy.run_path(str(BENCHMARKS / "sensitivity.py"))


@pytest.mark.parametrize("number", [*SENSITIVITY["NUMBERS"], *SENSITIVITY["OF_CLIPS"]])
def test_a_number_that_is_halved_and_doubled_is_one_of_its_room(number: str) -> None:
    room, name = number.split(".")
    assert isinstance(getattr(import_module(f"rsvideo.restoration.{room}"), name), int | float)


@pytest.mark.parametrize("number", [*SENSITIVITY["NUMBERS"], *SENSITIVITY["OF_CLIPS"]])
def test_no_compiled_loop_reads_a_number_that_is_halved_and_doubled(number: str) -> None:
    room, name = number.split(".")
    compiled = [each for each in vars(import_module(f"rsvideo.restoration.{room}")).values() if hasattr(each, "py_func")]
    assert not [each for each in compiled if name in each.py_func.__code__.co_names]  # numba keeps the value that it compiled


def printed(benchmark: str, *words: str | Path) -> str:
    done = subprocess.run([sys.executable, BENCHMARKS / benchmark, *words], capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.slow
def test_the_stages_of_a_photograph_and_of_a_clip_are_timed() -> None:
    table = printed("stages.py", "--sizes", "160x120", "--blur", "4", "--frames", "3")
    assert "160 x 120, a photograph" in table
    assert "160 x 120, a frame of a clip" in table


@pytest.mark.slow
def test_the_memory_of_clips_is_measured_and_the_worst_is_named() -> None:
    clip = BENCHMARKS.parents[1] / "samples" / "clip" / "blurred.mp4"
    table = printed("memory.py", clip, "--size", "160x120", "--to", "0.15", "--", "--method", "rectify")
    assert f"of {clip.name}" in table
    assert 0.05 < float(table.split("most memory: ")[1].split(" GB")[0]) < 1
