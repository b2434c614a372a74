"""A job on the workers of dask.distributed, with a quick core: the bytes of a run, whatever happens to workers, scheduler and command."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsvideo.batch import machine
from rsvideo.batch.objects import Objects
from rsvideo.batch.places import Folder
from tests.batch import clusters
from tests.batch.buckets import Bucket
from tests.batch.runs import begun, call, under_way
from tests.robustness import jobs


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> jobs.Files:
    """What an uninterrupted run on this machine writes."""
    return jobs.undisturbed(tmp_path_factory.mktemp("whole") / "job")


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """A job of twelve chunks."""
    return jobs.make(tmp_path / "job")


@pytest.fixture
def machines(tmp_path: Path) -> Iterator[clusters.Machines]:
    """A scheduler without workers."""
    (tmp_path / "dask").mkdir()
    with clusters.running(tmp_path / "dask") as machines:
        yield machines


@pytest.mark.slow
def test_a_cluster_on_this_machine_writes_the_bytes_of_a_run(job: Path, whole: jobs.Files) -> None:
    tally = job.with_name("tally")
    done = call("run", job, "--scheduler", "local", how=None, TALLY=tally, **clusters.EVERYWHERE)
    assert done.returncode == 0, done.stderr
    assert jobs.results(job) == whole
    assert not jobs.left_behind(job)
    assert tally.read_text().count("\n") == jobs.CHUNKS


@pytest.mark.parametrize(
    ("address", "words"),
    [
        pytest.param("tcp://127.0.0.1:9", ["nobody answers at tcp://127.0.0.1:9 within 10 s"], marks=pytest.mark.slow),
        ("127.0.0.1:8786", ["scheduler must be local, or an address such as tcp://HOST:8786, got '127.0.0.1:8786'"]),
    ],
)
def test_an_address_without_a_scheduler_is_refused_in_one_line(job: Path, address: str, words: list[str]) -> None:
    done = call("run", job, "--scheduler", address)
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert all(word in done.stderr for word in words)
    assert not jobs.left_behind(job)


def test_without_the_extra_the_command_says_how_to_get_it(job: Path) -> None:
    program = f"import sys; sys.modules['distributed'] = None; sys.argv = ['rsvideo', 'run', {str(job)!r}, '--scheduler', 'local']"
    done = subprocess.run(
        [sys.executable, "-c", f"{program}; from rsvideo.cli import main; main()"], capture_output=True, text=True, check=False, timeout=60
    )
    assert (done.returncode, done.stderr.count("\n")) == (2, 1), done.stderr
    assert "pip install 'rsvideo[cluster]'" in done.stderr


def test_a_machine_says_which_folder_it_does_not_share(tmp_path: Path) -> None:
    stores = Folder(path=tmp_path / "store")
    stores.within("run").state(machine.TOKEN, b"words")
    assert machine.unshared(stores, "run", "words", [str(tmp_path)]) is None
    assert f"it finds in {tmp_path}/store what the run has not written" in str(machine.unshared(stores, "run", "others", []))
    assert f"it does not see {tmp_path}/x," in str(machine.unshared(Folder(path=tmp_path / "x"), "run", "words", []))
    assert "it does not see /clips," in str(machine.unshared(stores, "run", "words", [str(tmp_path), "/clips"]))


def test_a_machine_says_which_bucket_it_cannot_use(bucket: Bucket, tmp_path: Path) -> None:
    stores = Objects(address=f"{bucket.address}/store")
    stores.within("run").state(machine.TOKEN, b"words")
    bucket.put(**{"clips/a.mp4": b"clip"})
    assert machine.unshared(stores, "run", "words", [f"{bucket.address}/clips/a.mp4"]) is None
    assert "it finds in s3://" in str(machine.unshared(stores, "run", "others", []))
    missing = f"{bucket.address}/clips/b.mp4"
    assert machine.unshared(stores, "run", "words", [missing]) == f"it cannot use {missing}: it does not exist"
    elsewhere = Objects(address="s3://no-such-bucket-of-ours/store")
    assert "it cannot use s3://no-such-bucket-of-ours/store/run/token: there is no bucket" in str(
        machine.unshared(elsewhere, "run", "words", [])
    )


@pytest.mark.long
def test_two_workers_of_a_scheduler_write_the_bytes_of_a_run(
    job: Path, whole: jobs.Files, machines: clusters.Machines, tmp_path: Path
) -> None:
    tally = tmp_path / "tally"
    for _ in range(2):
        machines.worker(TALLY=tally)
    done = call("run", job, "--scheduler", machines.address)
    assert done.returncode == 0, done.stderr
    assert jobs.results(job) == whole
    assert not jobs.left_behind(job)
    assert sorted(tally.read_text().splitlines()) == sorted({*tally.read_text().splitlines()})


@pytest.mark.long
@pytest.mark.parametrize(
    ("mishap", "words"),
    [
        ({"VERSION": "0.0.9"}, "is refused: it has rsvideo 0.0.9, the run has "),
        ({"HIDDEN": "1"}, "pip install 'rsvideo[cluster]' there"),
    ],
)
def test_a_worker_that_cannot_work_for_the_run_is_refused_in_one_line(
    job: Path, machines: clusters.Machines, mishap: dict[str, object], words: str
) -> None:
    machines.worker(threads=1, **mishap)
    done = call("run", job, "--scheduler", machines.address)
    assert done.returncode == 2
    first, last = done.stderr.splitlines()
    assert words in first
    assert last == f"rsvideo: no worker of {machines.address} can work for this run, see above; start others, or put them right"
    assert not jobs.left_behind(job)


@pytest.mark.long
def test_a_worker_whose_disk_is_full_gets_no_more_orders(job: Path, whole: jobs.Files, machines: clusters.Machines) -> None:
    full = machines.worker(FULL=0)
    done = call("run", job, "--scheduler", machines.address)
    assert done.returncode == 1
    assert "gets no more orders: [Errno 28] No space left on device" in done.stderr
    assert "could not be written: No space left on device; 0 clips and 0 chunks of others are kept" in done.stderr.splitlines()[-1]
    machines.worker()
    machines.await_workers(2)
    done = call("run", job, "--scheduler", machines.address)
    assert full.poll() is None
    assert done.returncode == 0, done.stderr
    assert jobs.results(job) == whole


@pytest.mark.long
def test_a_chunk_that_kills_its_worker_fails_its_clip_after_three_tries(
    job: Path, whole: jobs.Files, machines: clusters.Machines, tmp_path: Path
) -> None:
    tally = tmp_path / "tally"
    for _ in range(2):
        machines.worker(KILLED="one.mp4 2", TALLY=tally)
    done = call("run", job, "--scheduler", machines.address)
    assert done.returncode == 1
    assert "one_rsvideo.mp4: a worker process ended (killed by SIGKILL" in done.stderr
    assert "1 of 3 clips failed; 2 clips and 4 chunks of others are kept" in done.stderr
    assert jobs.results(job) == {name: data for name, data in whole.items() if not name.startswith("one_rsvideo.") or data == jobs.MINE}
    lines = tally.read_text().splitlines()
    assert lines.count("one.mp4 2") == 3
    assert len(lines) == jobs.CHUNKS + 2


@pytest.mark.long
def test_workers_that_are_killed_and_replaced_cost_their_orders_only(
    job: Path, whole: jobs.Files, machines: clusters.Machines, tmp_path: Path
) -> None:
    tally = tmp_path / "tally"
    first = machines.worker(TALLY=tally, PACE=0.05)
    with under_way("run", job, "--scheduler", machines.address) as working:
        begun(tally, 4)
        os.killpg(first.pid, signal.SIGKILL)
        machines.worker(TALLY=tally)
        _, told = working.communicate(timeout=100)
    assert working.returncode == 0, told
    assert "was lost; did its memory run out?; its work is tried once more" in told
    assert jobs.results(job) == whole
    assert tally.read_text().count("\n") == jobs.CHUNKS + 1


@pytest.mark.long
@pytest.mark.parametrize("killed", ["command", "scheduler"])
def test_a_run_whose_command_or_scheduler_dies_goes_on(
    job: Path, whole: jobs.Files, machines: clusters.Machines, tmp_path: Path, killed: str
) -> None:
    tally = tmp_path / "tally"
    machines.worker(TALLY=tally, PACE=0.05)
    with under_way("run", job, "--scheduler", machines.address) as working:
        begun(tally, 6)
        os.killpg(working.pid if killed == "command" else machines.running[0].pid, signal.SIGKILL)
        _, told = working.communicate(timeout=100)
    if killed == "scheduler":
        assert working.returncode == 1
        assert "the scheduler is gone: " in told.splitlines()[-1]
        assert "are kept, the same command goes on from there" in told.splitlines()[-1]
    again = tmp_path / "again"
    done = call("run", job, TALLY=again)
    assert done.returncode == 0, done.stderr
    assert jobs.results(job) == whole
    assert again.read_text().count("\n") <= jobs.CHUNKS - 4
