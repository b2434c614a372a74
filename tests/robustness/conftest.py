"""What the undisturbed run writes, and a run that was halted."""

from pathlib import Path

import pytest

from tests.robustness import jobs


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> jobs.Files:
    """All files beside the results of a job that nothing disturbs."""
    return jobs.undisturbed(tmp_path_factory.mktemp("whole"))


@pytest.fixture(scope="session")
def halted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job one of whose clips is not finished; tests work on copies of it."""
    return jobs.halted(tmp_path_factory.mktemp("halted"))
