"""What the undisturbed run writes."""

import pytest

from tests.robustness import jobs


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> jobs.Files:
    """All files beside the results of a job that nothing disturbs."""
    return jobs.undisturbed(tmp_path_factory.mktemp("whole"))
