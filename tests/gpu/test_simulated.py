"""What the kernels compute is proven without a device: in numba-cuda's simulator, which has to be chosen before numba is loaded."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rsvideo.gpu.device import SIMULATOR

CHECKOUT = Path(__file__).resolve().parent.parent.parent


@pytest.mark.slow
def test_in_the_simulator_the_kernels_agree_with_their_twins() -> None:
    words = ["-m", "pytest", "tests/gpu/twins", "-q", "-n", "0", "-p", "no:cacheprovider", "-m", "gpu"]
    done = subprocess.run(
        [sys.executable, *words], cwd=CHECKOUT, env={**os.environ, SIMULATOR: "1"}, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "skipped" not in done.stdout
