"""Runs that are ended at random moments, by what can be caught and what cannot: nothing is lost, and they go on to the same bytes."""

import contextlib
import os
import random
import signal
import time
from pathlib import Path

import pytest

from tests.robustness import jobs

COUNT = 100
SENT = (signal.SIGKILL, signal.SIGTERM, signal.SIGHUP)
LONGEST = 2.5  # seconds from the start of a run until it is ended


def ended(job: Path, sent: signal.Signals, after: float, chance: random.Random) -> int:
    """The exit code of a run that gets a signal, alone or with all its workers."""
    with jobs.under_way(job, "-j", chance.choice([1, 2]), PACE=0.01) as working:
        time.sleep(after)
        with contextlib.suppress(ProcessLookupError):
            (os.killpg if chance.random() < 0.5 else os.kill)(working.pid, sent)
        _, words = working.communicate(timeout=60)
    assert "Traceback" not in words
    return working.returncode


def survives(job: Path, whole: jobs.Files, sent: signal.Signals, chance: random.Random, *, times: int) -> None:
    for _ in range(times):
        code = ended(job, sent, chance.random() * LONGEST, chance)
        assert code in (0, 4, -sent, 128 + sent), code  # 4: all was done before
        if sent is not signal.SIGKILL:
            jobs.check_pairs(job, whole)
    if jobs.left_behind(job) or len(jobs.results(job)) < len(whole):
        done = jobs.run(job)
        assert done.returncode == 0, done.stderr
    assert jobs.results(job) == whole
    assert not jobs.left_behind(job)


@pytest.mark.parametrize("sent", SENT, ids=lambda sent: sent.name)
def test_a_run_that_is_ended_goes_on_to_the_same_bytes(tmp_path: Path, whole: jobs.Files, sent: signal.Signals) -> None:
    survives(jobs.make(tmp_path / "job"), whole, sent, random.Random(3), times=1)


@pytest.mark.long
@pytest.mark.parametrize("seed", range(COUNT))
def test_runs_that_are_ended_at_random_moments(tmp_path: Path, whole: jobs.Files, seed: int) -> None:
    survives(jobs.make(tmp_path / "job"), whole, SENT[seed % len(SENT)], random.Random(seed), times=1)
