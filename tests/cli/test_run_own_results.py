"""What a job takes for its own: its results by its job, its input and their content, and nothing of anybody else's."""

import contextlib
import json
import signal
import sqlite3
import subprocess
import sys
import time
from pathlib import Path

import pytest

from rsvideo.batch import ledger
from tests.batch.runs import STAND_IN, environment, under_way
from tests.robustness import jobs


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> jobs.Files:
    return jobs.undisturbed(tmp_path_factory.mktemp("whole"))


@pytest.fixture
def job(tmp_path: Path) -> Path:
    return jobs.make(tmp_path / "job")


@pytest.fixture(scope="module")
def once(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return jobs.halted(tmp_path_factory.mktemp("halted"))


@pytest.fixture
def halted(once: Path, tmp_path: Path) -> Path:
    """A job one of whose clips is not finished; the two others are."""
    return jobs.copied(once, tmp_path / "job")


def refused(done: subprocess.CompletedProcess[str], *words: str) -> None:
    assert done.returncode == 4, done.stderr
    last = done.stderr.splitlines()[-1]
    for word in ("rsvideo: ", "exists already", *words):
        assert word in last


def test_another_job_of_the_same_name_replaces_nothing_and_loses_nothing(halted: Path, whole: jobs.Files) -> None:
    other = halted.parent / "other"
    (other / "clips").mkdir(parents=True)
    (other / "clips" / "one.mp4").write_bytes(b"nmlkjihgfedcba")
    (other / "job.yaml").write_text("output: {folder: ../restored}\n" + jobs.JOB)
    refused(jobs.run(other / "job.yaml"), "one_rsvideo.mp4")
    refused(jobs.run(other / "job.yaml", "--fresh"), "one_rsvideo.mp4")
    tally = halted.with_name("tally")
    assert jobs.run(halted, TALLY=tally).returncode == 0
    assert jobs.results(halted) == whole
    assert tally.read_text() == "two.mov 2\n"


def test_another_input_under_the_same_name_replaces_nothing(halted: Path, whole: jobs.Files) -> None:
    (halted.parent / "more").mkdir()
    (halted.parent / "more" / "one.mp4").write_bytes(b"nmlkjihgfedcba")
    halted.write_text(jobs.JOB.replace("'clips/*'", "'clips/t*', 'more/one.mp4'"))
    refused(jobs.run(halted), "one_rsvideo.mp4")
    jobs.check_pairs(halted, whole)


@pytest.mark.parametrize("name", ["one_rsvideo.mp4", "one_rsvideo.rsvideo.json"])
def test_a_result_that_was_changed_is_somebodys(halted: Path, name: str) -> None:
    result = halted.parent / "restored" / name
    result.write_bytes(jobs.MINE)
    refused(jobs.run(halted), "one_rsvideo")
    assert result.read_bytes() == jobs.MINE
    assert jobs.run(halted, "--overwrite").returncode == 0


@pytest.mark.slow
def test_what_appears_while_a_job_works_is_kept(job: Path) -> None:
    tally, output = job.with_name("tally"), job.parent / "restored" / "two_rsvideo.mov"
    with under_way("run", job, TALLY=tally, PACE=0.05) as working:
        while not tally.exists() or "two.mov 0" not in tally.read_text():
            time.sleep(0.01)
        output.write_bytes(jobs.MINE)
        _, words = working.communicate(timeout=60)
    assert working.returncode == 1
    assert "two_rsvideo.mov has appeared or changed meanwhile; give --overwrite" in words
    assert output.read_bytes() == jobs.MINE


@pytest.mark.parametrize("words", [(), ("--fresh",)])
@pytest.mark.parametrize("damage", ["empty", "newer", "foreign", "noise"])
def test_a_ledger_that_is_lost_stops_nothing(halted: Path, whole: jobs.Files, damage: str, words: tuple[str, ...]) -> None:
    (file,) = halted.parent.rglob("ledger.sqlite")
    if damage == "newer":
        with contextlib.closing(sqlite3.connect(file)) as database:
            database.execute("PRAGMA user_version = 99")
    else:
        file.write_bytes({"empty": b"", "noise": b"no ledger" * 999}.get(damage, b""))
    if damage == "foreign":
        with contextlib.closing(sqlite3.connect(file)) as database:
            database.execute("CREATE TABLE notes (words TEXT)")
    tally = halted.with_name("tally")
    for dry in (["--dry-run"], []):
        done = jobs.run(halted, *dry, *words, TALLY=tally)
        assert done.returncode == 0, done.stderr
    assert jobs.results(halted) == whole
    assert tally.read_text().count("\n") == (jobs.CHUNKS if words else 3)


def test_a_ledger_that_was_lost_does_not_make_other_peoples_results_ours(halted: Path) -> None:
    (file,) = halted.parent.rglob("ledger.sqlite")
    file.write_bytes(b"")
    result = halted.parent / "restored" / "one_rsvideo.mp4"
    result.write_bytes(jobs.MINE)
    refused(jobs.run(halted), "one_rsvideo.mp4")
    refused(jobs.run(halted, "--fresh"), "one_rsvideo.mp4")
    assert result.read_bytes() == jobs.MINE


@pytest.mark.parametrize("believed", [False, True])
def test_chunks_that_do_not_cover_the_clip_are_done_anew(halted: Path, whole: jobs.Files, believed: bool) -> None:
    (file,) = halted.parent.rglob("ledger.sqlite")
    with contextlib.closing(sqlite3.connect(file, isolation_level=None)) as database:
        key = b"two_rsvideo.mov"
        ((text,),) = database.execute("SELECT entry FROM clip WHERE output = ?", (key,))
        entry = json.loads(text)
        assert entry["chunks"][-1]["last"] == 9
        entry["chunks"][-1]["last"] = 8
        text = json.dumps(entry)
        database.execute("UPDATE clip SET entry = ? WHERE output = ?", (text, key))
        if believed:
            database.execute("UPDATE clip SET checksum = ? WHERE output = ?", (ledger.row_checksum(key, text), key))
        ((chunks,),) = database.execute("SELECT count(*) FROM chunk WHERE output = ?", (key,))
    done = jobs.run(halted)
    assert done.returncode == 0, done.stderr
    assert ("not those of the clip" if believed else f"{1 + chunks} of its rows are damaged") in done.stderr  # the clip's and its chunks'
    assert jobs.results(halted) == whole


@pytest.mark.parametrize("kind", ["link", "file"])
def test_what_stands_in_the_place_of_what_is_kept_is_left_alone(halted: Path, whole: jobs.Files, kind: str) -> None:
    job = halted
    (kept,) = (path.parent for path in job.parent.rglob("ledger.sqlite"))
    mine = job.parent / "mine"
    (mine / "0123456789abcdef").mkdir(parents=True)
    kept.rename(job.parent / "kept")
    kept.symlink_to(mine) if kind == "link" else kept.write_bytes(jobs.MINE)
    refused(jobs.run(job), kept.name)
    assert [path.name for path in mine.iterdir()] == ["0123456789abcdef"]
    kept.unlink()
    (job.parent / "kept").rename(kept)
    (kept / "letter.txt").write_bytes(jobs.MINE)
    assert jobs.run(job).returncode == 0
    assert [path.name for path in kept.iterdir()] == ["letter.txt"]
    assert jobs.results(job) == whole


@pytest.mark.parametrize("name", ["two_rsvideo.gcsv", "two_rsvideo.rsvideo.json"])
def test_a_file_that_the_job_reads_is_not_written_beside_a_result(job: Path, name: str) -> None:
    log = job.parent / "restored" / name
    log.write_bytes(jobs.MINE)
    job.write_text(jobs.JOB.replace("'clips/*'", f"clips/two.mov, {{source: clips/one.mp4, motion: {{trajectory: restored/{name}}}}}"))
    done = jobs.run(job, "--overwrite")
    assert done.returncode == 2, done.stderr
    assert "is read by this job too" in done.stderr
    assert log.read_bytes() == jobs.MINE


@pytest.mark.slow
def test_a_hang_up_ends_a_run_whose_terminal_is_gone(job: Path, whole: jobs.Files) -> None:
    tally = job.with_name("tally")
    program = [sys.executable, str(STAND_IN), "run", str(job)]
    with subprocess.Popen(program, stderr=subprocess.PIPE, env=environment({"TALLY": tally, "HELD": "two.mov 1"})) as working:
        while not tally.exists() or "two.mov 1" not in tally.read_text():
            time.sleep(0.01)
        children = Path(f"/proc/{working.pid}/task/{working.pid}/children").read_text().split()
        workers = [child for child in children if b"spawn_main" in Path(f"/proc/{child}/cmdline").read_bytes()]
        assert working.stderr
        working.stderr.close()
        working.send_signal(signal.SIGHUP)
        assert working.wait(timeout=20) == 128 + signal.SIGHUP
    assert workers
    assert not any(Path(f"/proc/{worker}").exists() for worker in workers)
    assert jobs.run(job).returncode == 0
    assert jobs.results(job) == whole
