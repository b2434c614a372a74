"""What all tests share: shapes and types that are checked, and the folder of external cases."""

import os
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
from hypothesis import settings

if TYPE_CHECKING:
    from playwright.sync_api import Browser

    from tests.batch.buckets import Bucket

# as the command has it: threads of two tests at a time would spin and starve each other; numpy reads these once, when it is imported
os.environ |= {name: os.environ.get(name, "1") for name in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")}

# the commands that tests start find the project's modules compiled, whatever the machine's habit: to compile them takes each 0.3 s
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

from tests import checked

checked.install()

settings.register_profile("whatever the machine", deadline=None)  # a busy one is no fault of the code
settings.load_profile("whatever the machine")

CHROMIUM = Path("/usr/bin/chromium")
CHECKOUT = Path(__file__).resolve().parent.parent


@pytest.fixture(autouse=True)
def every_function_is_checked_again() -> None:
    """Of every test the first calls."""
    checked.begin()


@pytest.fixture(scope="session")
def shared() -> Path:
    """The folder of rendered and recorded cases that do not ship with the project."""
    folder = Path(os.environ.get("RSVIDEO_SHARED") or CHECKOUT.parent / "shared")
    if not (folder / "cases").is_dir():
        pytest.skip(f"no cases in {folder}; set RSVIDEO_SHARED to the folder that holds cases/ and real/")
    return folder


@pytest.fixture(scope="session")
def samples() -> Path:
    """The samples that ship with the project."""
    return CHECKOUT / "samples"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Everything in tests/benchmarks carries the marker that leaves it out of an ordinary run."""
    for item in items:
        if CHECKOUT / "tests" / "benchmarks" in item.path.parents:
            item.add_marker(pytest.mark.benchmark)


@pytest.fixture
def bucket(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> "Bucket":
    """Object storage with one bucket, and a folder of this test's own for what is brought from it."""
    from tests.batch import buckets

    for name, value in {**buckets.environment(), "RSVIDEO_CACHE": str(tmp_path / "sources")}.items():
        monkeypatch.setenv(name, value)
    return buckets.made()


@pytest.fixture(scope="module")
def browser() -> "Iterator[Browser]":
    """A real one, for pages of reports."""
    from playwright.sync_api import sync_playwright

    if not CHROMIUM.exists():
        pytest.skip(f"no browser at {CHROMIUM}; apt-get install chromium")
    with sync_playwright() as program:
        chromium = program.chromium.launch(executable_path=CHROMIUM, args=["--no-sandbox"])
        yield chromium
        chromium.close()
