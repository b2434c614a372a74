"""What a run states of itself beside its ledger, and how it obeys whoever watches it."""

import os
import signal
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from rsvideo.batch import control, plan, status
from rsvideo.batch.status import Status
from tests.batch.runs import call, under_way

JOB = "output: {folder: out}\ndefaults: {camera: {exposure: 1/50, readout: 15ms, focal_px: 200}}\nclips: [a.mp4, b.mp4]\n"


@pytest.fixture
def job(tmp_path: Path) -> Path:
    (tmp_path / "a.mp4").write_bytes(b"abcdefghijkl")
    (tmp_path / "b.mp4").write_bytes(b"mnop")
    path = tmp_path / "job.yaml"
    path.write_text(JOB)
    return path


def working(job: Path) -> Path:
    return plan.working_of(job, "out")


def until(job: Path, reached: Callable[[Status], bool]) -> Status:
    """The status once it says this."""
    end = time.monotonic() + 30
    while time.monotonic() < end:
        held = status.read(working(job))
        if held and reached(held):
            return held
        time.sleep(0.02)
    raise AssertionError(status.read(working(job)))


def a_chunk_is_done(held: Status) -> bool:
    return bool(held.clips) and held.clips[0].chunks_done >= 1


@pytest.mark.slow
def test_a_run_states_how_far_it_is_and_leaves_nothing_when_all_is_done(job: Path) -> None:
    with under_way("run", job, "--progress", "none", PACE=0.05) as run:
        held = until(job, lambda s: s.done > 2 and a_chunk_is_done(s))
        assert (held.state, held.frames, held.pid, held.alive) == ("running", 16, run.pid, True)
        assert [clip.frames for clip in held.clips] == [12, 4]
        assert held.clips[0].chunks == 3
        assert held.seconds_left is not None
        assert run.wait(timeout=60) == 0
    assert not working(job).exists()


@pytest.mark.slow
def test_a_run_pauses_within_a_chunk_and_goes_on(job: Path, tmp_path: Path) -> None:
    diary = tmp_path / "diary"
    with under_way("run", job, "--progress", "none", PACE=0.1, DIARY=diary) as run:
        until(job, lambda s: s.done > 1)
        control.want(working(job), "pause")
        until(job, lambda s: s.state == "paused")
        time.sleep(2 * control.EVERY)
        before = diary.read_text()
        time.sleep(1.0)  # ten frames, or two chunks
        assert diary.read_text() == before
        control.want(working(job), "go")
        assert run.wait(timeout=60) == 0
    assert (job.parent / "out" / "a_rsvideo.mp4").exists()


@pytest.mark.slow
def test_a_run_that_is_cancelled_by_the_file_keeps_its_chunks(job: Path) -> None:
    with under_way("run", job, "--progress", "none", PACE=0.1) as run:
        until(job, a_chunk_is_done)
        control.want(working(job), "cancel")
        assert run.wait(timeout=60) == 143
    held = status.read(working(job))
    assert held is not None
    assert (held.state, held.code, held.words) == ("ended", 143, "cancelled")
    again = call("run", job)
    assert again.returncode == 0, again.stderr
    assert "chunks are done already" in again.stderr


@pytest.mark.slow
def test_a_wish_of_an_earlier_run_does_not_hold_up_the_next(job: Path) -> None:
    with under_way("run", job, "--progress", "none", PACE=0.1) as run:
        until(job, a_chunk_is_done)
        control.want(working(job), "pause")
        until(job, lambda s: s.state == "paused")
        os.kill(run.pid, signal.SIGTERM)
        assert run.wait(timeout=60) == 143
    assert call("run", job).returncode == 0


@pytest.mark.slow
def test_a_run_that_was_killed_is_not_alive(job: Path) -> None:
    with under_way("run", job, "--progress", "none", PACE=0.1) as run:
        until(job, a_chunk_is_done)
        run.kill()
        run.wait()
    held = status.read(working(job))
    assert held is not None
    assert (held.state, held.alive) == ("running", False)


@pytest.mark.slow
def test_a_clip_that_fails_is_stated_with_its_reason(job: Path) -> None:
    (job.parent / "b.mp4").write_bytes(b"mn!p")
    assert call("run", job).returncode == 3
    held = status.read(working(job))
    assert held is not None
    assert [clip.state for clip in held.clips] == ["finished", "failed"]
    assert "damaged at frame 2" in held.clips[1].words


@pytest.mark.parametrize("text", ["", "{}", "[1]", '{"version": 2}', "\0" * 100, '{"version":1,"pid":"x"}'])
def test_a_status_that_is_damaged_is_none(tmp_path: Path, text: str) -> None:
    (tmp_path / status.NAME).write_text(text)
    assert status.read(tmp_path) is None


def test_a_word_that_is_no_wish_is_none(tmp_path: Path) -> None:
    assert control.wish(tmp_path) == "go"
    (tmp_path / "ledger.control").write_text("halt")
    assert control.wish(tmp_path) == "go"
