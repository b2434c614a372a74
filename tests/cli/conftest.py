"""The command as a user calls it, and a photograph to call it on."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.forked import INSTALLED, call

STAND_IN = Path(__file__).with_name("stand_in.py")

Run = Callable[..., subprocess.CompletedProcess[str]]


def _run(program: Path, *words: object, preexec_fn: Callable[[], None] | None = None) -> subprocess.CompletedProcess[str]:
    environment = os.environ | {"DAWDLE": "0"}
    if preexec_fn is None:
        return call(*words, program=program, env=environment)
    environment |= {
        "PYTHONDONTWRITEBYTECODE": "1"
    }  # where files are cut short, Python would cache its own bytecode cut short, for all later runs
    fresh = [sys.executable, str(program), *map(str, words)]
    return subprocess.run(fresh, capture_output=True, text=True, timeout=120, env=environment, check=False, preexec_fn=preexec_fn)


@pytest.fixture
def rsvideo() -> Run:
    """The installed command."""
    assert INSTALLED.exists(), "the tests call the installed command; pip install -e . installs it"
    return lambda *words, **how: _run(INSTALLED, *words, **how)


@pytest.fixture
def rsvideo_at_once() -> Run:
    """The command with a core that brightens the photograph instead of restoring it."""
    return lambda *words, **how: _run(STAND_IN, *words, **how)


@pytest.fixture
def photograph(tmp_path: Path) -> Path:
    """64 x 48 pixels of noise, smoothed."""
    noise = np.random.default_rng(0).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    path = tmp_path / "in.png"
    assert cv2.imwrite(str(path), cv2.GaussianBlur(noise, (0, 0), 2))
    return path
