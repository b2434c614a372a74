"""A job in numbered chunks through the command, with a quick core: in any order, by anybody, and with what farms do to it."""

import json
import os
import random
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from rsvideo.config import placing
from tests.batch.runs import STAND_IN, begun, call, environment, under_way
from tests.robustness import jobs

FARMS = Path(__file__).resolve().parents[2] / "configs" / "farms"
ALL = f"0-{jobs.CHUNKS - 1}"


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> jobs.Files:
    """What an uninterrupted run writes."""
    return jobs.undisturbed(tmp_path_factory.mktemp("whole") / "job")


@pytest.fixture(scope="module")
def cut(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A job that is cut into its twelve chunks."""
    job = jobs.make(tmp_path_factory.mktemp("cut") / "job")
    done = call("chunks", job)
    assert done.returncode == 0, done.stderr
    listed = json.loads(done.stdout)
    assert [each["chunk"] for each in listed] == list(range(jobs.CHUNKS))
    assert [(Path(each["source"]).name, each["first"], each["last"]) for each in listed[4:6]] == [("one.mp4", 16, 16), ("three.mp4", 0, 3)]
    assert {Path(each["output"]).name for each in listed} == {"one_rsvideo.mp4", "two_rsvideo.mov", "three_rsvideo.mp4"}
    return job


@pytest.fixture
def job(cut: Path, tmp_path: Path) -> Path:
    """A copy of it."""
    return jobs.copied(cut, tmp_path / "job")


def work(job: Path, chunks: object, *words: object, **mishaps: object) -> subprocess.CompletedProcess[str]:
    return call("work", job, "--chunks", chunks, *words, how=None, **mishaps)


def finished(job: Path, whole: jobs.Files) -> None:
    done = call("finish", job)
    assert done.returncode == 0, done.stderr
    assert jobs.results(job) == whole
    assert not jobs.left_behind(job)


def test_chunks_by_hand_in_random_order_make_the_bytes_of_a_run(job: Path, whole: jobs.Files) -> None:
    order = random.Random(2).sample(range(jobs.CHUNKS), jobs.CHUNKS)
    for some in (order[:5], order[5:]):
        done = work(job, ",".join(map(str, some)), "-j", 2)
        assert done.returncode == 0, done.stderr
    finished(job, whole)


def test_missing_chunks_are_named_in_one_line_and_complete_clips_are_finished(job: Path, whole: jobs.Files) -> None:
    assert work(job, "1,3-8").returncode == 0
    done = call("finish", job)
    assert done.returncode == 3
    (line,) = [line for line in done.stderr.splitlines() if "--chunks" in line]
    assert line == f"rsvideo: chunks 0,2,9-11 are missing; rsvideo work {job} --chunks 0,2,9-11 restores them"
    assert (job.parent / "restored" / "three_rsvideo.mp4").read_bytes() == whole["three_rsvideo.mp4"]
    assert not (job.parent / "restored" / "one_rsvideo.mp4").exists()
    tally = job.with_name("tally")
    assert work(job, f"0,2-3,5-{jobs.CHUNKS - 1}", TALLY=tally).returncode == 0
    finished(job, whole)
    assert tally.read_text().count("\n") == 5  # what a store holds, and what is finished, is not restored again


@pytest.mark.long
def test_a_run_goes_on_from_what_a_farm_has_restored(job: Path, whole: jobs.Files) -> None:
    assert work(job, "2-5").returncode == 0
    assert call("run", job, "--dry-run").returncode == 0
    tally = job.with_name("tally")
    done = call("run", job, TALLY=tally)
    assert done.returncode == 0, done.stderr
    assert jobs.results(job) == whole
    assert not jobs.left_behind(job)
    assert tally.read_text().count("\n") == jobs.CHUNKS - 4


@pytest.mark.long
def test_workers_that_are_killed_or_find_the_disk_full_leave_nothing_half_done(job: Path, whole: jobs.Files) -> None:
    tally = job.with_name("tally")
    with under_way("work", job, "--chunks", ALL, PACE=0.01, TALLY=tally) as working:
        begun(tally, 3)
        os.kill(working.pid, signal.SIGKILL)
    done = work(job, ALL, KILLED="three.mp4 2", FULL=3)
    assert done.returncode == 1
    full, dead, also_full = sorted(done.stderr.splitlines())
    assert full.startswith("rsvideo: chunk 3 failed: [Errno 28] No space left on device")
    assert dead.startswith("rsvideo: chunk 7 failed: a worker process ended (killed by SIGKILL")
    assert also_full.startswith("rsvideo: chunk 8 failed: ")
    assert work(job, "3,7,8").returncode == 0
    finished(job, whole)


@pytest.mark.slow
def test_what_a_worker_that_was_killed_has_left_is_cleared_away_by_the_next(job: Path, tmp_path: Path) -> None:
    own, tally = tmp_path / "own", job.with_name("tally")
    own.mkdir()
    with placing.aside(own) as of_one_that_lives:
        with under_way("work", job, "--chunks", "0", HELD="one.mp4 0", TALLY=tally, TMPDIR=own) as working:
            begun(tally, 1)
            os.kill(working.pid, signal.SIGKILL)
            working.wait()
        assert len(list(own.iterdir())) == 2
        assert work(job, "1", TMPDIR=own).returncode == 0
        assert list(own.iterdir()) == [of_one_that_lives]


def settings_changed(job: Path) -> None:
    job.write_text(jobs.JOB.replace("1/50", "1/60"))


def source_changed(job: Path) -> None:
    (job.parent / "clips" / "one.mp4").write_bytes(b"ABCDEFGHIJKLMNOPQ")


def source_added(job: Path) -> None:
    (job.parent / "clips" / "four.mp4").write_bytes(b"abc")


def layout_lost(job: Path) -> None:
    next(job.parent.glob("restored/.rsvideo-*/store/layout.json")).unlink()


def layout_damaged(job: Path) -> None:
    next(job.parent.glob("restored/.rsvideo-*/store/layout.json")).write_text('{"rsvideo": ')


def version_changed(job: Path) -> None:
    path = next(job.parent.glob("restored/.rsvideo-*/store/layout.json"))
    path.write_text(json.dumps(json.loads(path.read_text()) | {"rsvideo": "0.0.9"}))


@pytest.mark.parametrize(
    ("change", "code", "words"),
    [
        (settings_changed, 2, ["one.mp4 has other settings since it was cut", "--set"]),
        (source_changed, 2, ["one.mp4 has changed since it was cut"]),
        (layout_lost, 2, ["is not cut into chunks", "rsvideo chunks ", "all machines must see it"]),
        (layout_damaged, 3, ["layout.json is damaged"]),
        (version_changed, 2, ["was cut by rsvideo 0.0.9, this is ", "all machines need the same version"]),
    ],
)
def test_work_and_finish_refuse_what_was_not_cut_like_this(job: Path, change: Callable[[Path], None], code: int, words: list[str]) -> None:
    change(job)
    for done in (work(job, 1), call("finish", job)):
        assert done.returncode == code, done.stderr
        assert done.stderr.count("\n") == 1
        assert all(word in done.stderr for word in words), done.stderr


def test_a_clip_that_came_later_has_to_be_cut_first(job: Path) -> None:
    source_added(job)
    done = call("finish", job)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1)
    assert "four.mp4 is not among the chunks of this job" in done.stderr
    assert call("chunks", job).returncode == 0


@pytest.mark.parametrize(
    ("chunks", "words"),
    [
        ("", "chunks must read like 3, 3-17 or 3,5-7, got"),
        ("3-", "must read like"),
        ("-3", "must read like"),
        ("three", "must read like"),
        ("5-3", "from a lower to a higher number"),
        ("1-99999999", "from a lower to a higher number"),
        ("12", "chunks must lie in 0 to 11, got 12"),
    ],
)
def test_numbers_that_cannot_be_meant_are_refused(job: Path, chunks: str, words: str) -> None:
    done = call("work", job, f"--chunks={chunks}")
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert words in done.stderr


def test_results_of_others_are_kept(job: Path) -> None:
    mine = job.parent / "restored" / "two_rsvideo.mov"
    mine.write_bytes(jobs.MINE)
    for verb in ("chunks", "finish"):
        done = call(verb, job)
        assert (done.returncode, done.stderr.count("\n")) == (4, 1), done.stderr
    assert mine.read_bytes() == jobs.MINE


def on_the_path(folder: Path) -> dict[str, str]:
    """An environment in which the command is the one with the quick core."""
    command = folder / "bin" / "rsvideo"
    command.parent.mkdir()
    command.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{STAND_IN}" "$@"\n')
    command.chmod(0o755)
    return environment({"PATH": f"{command.parent}:{Path(sys.executable).parent}:{os.environ['PATH']}"})


@pytest.mark.slow
def test_the_slurm_script_restores_the_chunk_of_its_task(tmp_path: Path, job: Path) -> None:
    script = ["bash", str(FARMS / "slurm.sh"), str(job)]
    where = on_the_path(tmp_path)
    subprocess.run(script, env=where | {"SLURM_ARRAY_TASK_ID": "9"}, check=True, timeout=60)
    assert subprocess.run(script, env=where, check=False, timeout=60, capture_output=True).returncode != 0
    assert "0-8,10-11" in call("finish", job).stderr.splitlines()[-1]


@pytest.mark.long
def test_the_openjd_template_restores_and_finishes_a_job(tmp_path: Path, job: Path, whole: jobs.Files) -> None:
    words = ["--step", "Finish", "--run-dependencies", "-p", f"Job={job}", "-p", f"Last={jobs.CHUNKS - 1}", "-p", "AtOnce=12"]
    openjd = [str(Path(sys.executable).with_name("openjd")), "run", str(FARMS / "openjd.yaml"), *words]
    done = subprocess.run(openjd, env=on_the_path(tmp_path), check=False, timeout=120, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout
    assert "Chunks run: 2" in done.stdout  # all of them at once, and the end
    assert jobs.results(job) == whole
