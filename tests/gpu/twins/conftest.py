"""Kernels beside their twins: on a device, or in numba-cuda's simulator, as tests/gpu/test_simulated.py starts them."""

import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsvideo.gpu import device

HERE = Path(__file__).resolve().parent


class _Skipped(pytest.Module):
    """A file of tests that cannot even be imported here."""

    def collect(self) -> list[pytest.Item]:
        pytest.skip(f"no device: {device.unavailable()}", allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> pytest.Module | None:
    """Without a device, and outside the simulator, the file is skipped."""
    return _Skipped.from_parent(parent, path=module_path) if HERE in module_path.parents and device.unavailable() else None


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Everything here carries the marker."""
    for item in items:
        if HERE in item.path.parents:
            item.add_marker(pytest.mark.gpu)


@pytest.fixture(autouse=True)
def _switching() -> Iterator[None]:
    """The simulator's threads wait for each other all the time."""
    before = sys.getswitchinterval()
    sys.setswitchinterval(1e-5)
    yield
    sys.setswitchinterval(before)


@pytest.fixture(autouse=True)
def _sharing(monkeypatch: pytest.MonkeyPatch) -> None:
    """The simulator's threads share an array even where several ask for it at once; its own look-up hands out an array to each of them."""
    if not device.simulated():
        return
    from numba.cuda.simulator.kernelapi import FakeCUDAShared
    from numba.np.numpy_support import as_dtype

    dynamic = FakeCUDAShared.array  # of several sizes in one memory: the launch gives its size

    def array(self: Any, size: int, dtype: Any) -> np.ndarray:
        if size == 0:
            return dynamic(self, size, dtype)
        asking = sys._getframe(1)
        return self._allocations.setdefault((asking.f_code.co_filename, asking.f_lineno), np.empty(size, as_dtype(dtype)))

    monkeypatch.setattr(FakeCUDAShared, "array", array)
