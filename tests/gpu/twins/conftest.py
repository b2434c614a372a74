"""Kernels beside their twins: on a device, or in numba-cuda's simulator, as tests/gpu/test_simulated.py starts them."""

import sys
from collections.abc import Iterator
from pathlib import Path

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
