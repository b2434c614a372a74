"""Kernels of one size, to be quick, wherever a baseline begins with the uniform one."""

import pytest

from rsvideo.baselines import uniform


@pytest.fixture
def small_kernels(monkeypatch: pytest.MonkeyPatch) -> None:
    """No kernel grows beyond 17 px."""
    monkeypatch.setattr(uniform, "SIZES", (17,))
