"""What the undisturbed run writes."""

import pytest

from tests.robustness import jobs


@pytest.fixture(scope="session")
def whole(tmp_path_factory: pytest.TempPathFactory) -> jobs.Files:
    """All files beside the results of a job that nothing disturbs."""
    job = jobs.make(tmp_path_factory.mktemp("whole"))
    done = jobs.run(job)
    assert done.returncode == 0, done.stderr
    assert not jobs.left_behind(job)
    return jobs.results(job)
