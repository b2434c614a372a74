"""Disks that are full at a random moment: one clear line, whole pairs or none, and once there is room the run goes on to the same bytes."""

import os
import random
import resource
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.robustness import jobs

COUNT = 20
ROOM = 160 * 1024  # bytes of the small disk; the job needs about 60 kB of it at once


@pytest.fixture
def small(tmp_path: Path) -> Iterator[Path]:
    """A job whose results go to a small disk of their own."""
    job = jobs.make(tmp_path / "job")
    held = jobs.results(job)
    disk = job.parent / "restored"
    command = ["mount", "-t", "tmpfs", "-o", f"size={ROOM}", "tmpfs", disk]
    if os.getuid() or subprocess.run(command, check=False, capture_output=True).returncode:
        pytest.skip("a small file system can be mounted by root only")
    try:
        for name, data in held.items():
            (disk / name).write_bytes(data)
        yield job
    finally:
        subprocess.run(["umount", disk], check=True)


def survives(job: Path, whole: jobs.Files, chance: random.Random) -> int:
    """The exit code of a run on a disk that has a random number of blocks left."""
    other = job.parent / "restored" / "other"
    other.write_bytes(bytes(ROOM // 4096 * 4096 - 4096 * chance.randrange(4, 24)))
    done = jobs.run(job)
    found = other.read_bytes()
    other.unlink()
    jobs.check_pairs(job, whole)
    assert not any(found)
    if done.returncode:
        assert done.returncode == 1, done.stderr
        assert "No space left" in done.stderr
        assert "Traceback" not in done.stderr
        again = jobs.run(job)
        assert again.returncode == 0, again.stderr
    assert jobs.results(job) == whole
    assert not jobs.left_behind(job)
    return done.returncode


@pytest.mark.slow
def test_a_full_disk_leaves_whole_pairs_and_the_run_goes_on(small: Path, whole: jobs.Files) -> None:
    assert survives(small, whole, random.Random(1)) == 1


@pytest.mark.long
@pytest.mark.parametrize("seed", range(COUNT))
def test_disks_that_are_full_at_random_moments(
    small: Path, whole: jobs.Files, seed: int, record_property: Callable[[str, object], None]
) -> None:
    record_property("code", survives(small, whole, random.Random(seed)))


@pytest.mark.slow
def test_files_that_may_not_grow_leave_whole_pairs(tmp_path: Path, whole: jobs.Files) -> None:
    def limited() -> None:
        resource.setrlimit(resource.RLIMIT_FSIZE, (3000, 3000))

    job = jobs.make(tmp_path / "job")
    done = jobs.run(job, how=limited)
    assert done.returncode == 1
    assert "could not be written" in done.stderr
    jobs.check_pairs(job, whole)
    assert jobs.run(job).returncode == 0
    assert jobs.results(job) == whole
