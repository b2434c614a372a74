"""A file beside what is worked on is never run, whatever its name."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.cli.conftest import INSTALLED
from tests.video.clips import make

NAMES = ("multiprocessing", "numpy", "json", "rsvideo", "av", "signal", "sitecustomize", "usercustomize", "telemetry_parser", "encodings")
TRACE = "import pathlib\npathlib.Path({mark!r}).touch()\nraise SystemExit('a foreign module was run')\n"


def hostile(folder: Path, mark: Path) -> None:
    """Modules named as those that workers import; each leaves a mark when it is run."""
    folder.mkdir(exist_ok=True)
    for name in NAMES:
        (folder / f"{name}.py").write_text(TRACE.format(mark=str(mark)))


@pytest.fixture
def trap(tmp_path: Path) -> Path:
    """A job, its clip and the current folder, each among hostile modules."""
    for folder in ("here", "job", "clip"):
        hostile(tmp_path / folder, tmp_path / "run")
    make(tmp_path / "clip" / "in.mp4", frames=2)
    (tmp_path / "job" / "job.yaml").write_text("output: {folder: ../out}\nclips: [{source: ../clip/in.mp4, deblur: {method: none}}]\n")
    return tmp_path


def called(here: Path, *words: object) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONSAFEPATH"}
    program = [INSTALLED, *map(str, words)]
    return subprocess.run(program, capture_output=True, text=True, timeout=120, cwd=here, env=environment, check=False)


@pytest.mark.slow
@pytest.mark.parametrize("here", ["here", "job", "clip"])
def test_workers_run_no_module_that_lies_about(trap: Path, here: str) -> None:
    done = called(trap / here, "run", trap / "job" / "job.yaml")
    assert not (trap / "run").exists(), done.stderr
    assert done.returncode == 0, done.stderr
    assert (trap / "out" / "in_rsvideo.mp4").exists()


@pytest.mark.slow
def test_methods_that_are_compared_run_no_module_that_lies_about(trap: Path) -> None:
    done = called(trap / "here", "compare", trap / "clip" / "in.mp4", "-o", trap / "report", "--methods", "none")
    assert not (trap / "run").exists(), done.stderr
    assert done.returncode == 0, done.stderr


def test_reading_a_clips_telemetry_runs_no_module_that_lies_about(trap: Path) -> None:
    done = called(trap / "here", "inspect", trap / "clip" / "in.mp4", "--json")
    assert not (trap / "run").exists(), done.stderr
    assert done.returncode == 0, done.stderr


def test_the_trap_catches_a_process_without_the_safe_path(trap: Path) -> None:
    code = "from multiprocessing.spawn import spawn_main"
    subprocess.run([sys.executable, "-c", code], cwd=trap / "here", capture_output=True, check=False)
    assert (trap / "run").exists()
