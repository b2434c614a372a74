"""The kernels compile for real architectures: the simulator knows no types."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from rsvideo.gpu.device import SIMULATOR
from tests.gpu.compiling import NONE_HERE

HERE = Path(__file__).resolve().parent


def test_every_kernel_compiles_and_only_phases_are_in_double_precision() -> None:
    env = {**os.environ, SIMULATOR: "0", "PYTHONPATH": str(HERE.parent.parent)}
    done = subprocess.run([sys.executable, HERE / "compiling.py"], env=env, capture_output=True, text=True, check=False)
    if done.returncode == NONE_HERE:
        pytest.skip(done.stdout.strip())
    assert done.returncode == 0, done.stderr
    double = {tuple(line.split()[:2]): int(line.split()[2]) for line in done.stdout.splitlines()}
    assert len(double) == 38  # each for two architectures
    assert all(bool(count) == (kernel == "_symbol") for (kernel, _), count in double.items()), done.stdout
