"""Runs that are ended at random moments, by what can be caught and what cannot: nothing is lost, and they go on to the same bytes."""

import contextlib
import os
import random
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.batch.runs import under_way
from tests.robustness import jobs

COUNT = 100
SENT = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP)
LONGEST = 0.25  # seconds from the beginning of a chunk until the run is ended


def ended(job: Path, sent: signal.Signals, chance: random.Random) -> int:
    """The exit code of a run that gets a signal, alone or with all its workers, some time after a random chunk was begun."""
    tally, chunks = job.with_name("tally"), chance.randrange(jobs.CHUNKS + 1)
    with under_way("run", job, "-j", chance.choice([1, 2]), PACE=0.01, TALLY=tally) as working:
        while working.poll() is None and chunks and not (tally.exists() and tally.read_text().count("\n") >= chunks):
            time.sleep(0.005)
        time.sleep(chance.random() * LONGEST)
        with contextlib.suppress(ProcessLookupError):
            (os.killpg if chance.random() < 0.5 else os.kill)(working.pid, sent)
        _, words = working.communicate(timeout=60)
    assert "Traceback" not in words
    return working.returncode


def survives(job: Path, whole: jobs.Files, sent: signal.Signals, chance: random.Random) -> int:
    """The exit code of a run that is ended; another goes on from there."""
    code = ended(job, sent, chance)
    assert code in (0, -sent, 128 + sent), code
    if sent is not signal.SIGKILL:
        jobs.check_pairs(job, whole)
    if jobs.left_behind(job) or len(jobs.results(job)) < len(whole):
        done = jobs.run(job)
        assert done.returncode == 0, done.stderr
    assert jobs.results(job) == whole
    assert not jobs.left_behind(job)
    return code


@pytest.mark.slow
def test_a_run_that_is_ended_goes_on_to_the_same_bytes(tmp_path: Path, whole: jobs.Files) -> None:
    survives(jobs.make(tmp_path / "job"), whole, signal.SIGTERM, random.Random(3))


@pytest.mark.long
@pytest.mark.parametrize("seed", range(COUNT))
def test_runs_that_are_ended_at_random_moments(
    tmp_path: Path, whole: jobs.Files, seed: int, record_property: Callable[[str, object], None]
) -> None:
    record_property("code", survives(jobs.make(tmp_path / "job"), whole, SENT[seed % len(SENT)], random.Random(seed)))
