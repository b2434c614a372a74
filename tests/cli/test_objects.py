"""Jobs whose sources and results lie in object storage, with a quick core: the bytes of a folder, on machines that share no disk."""

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.batch import clusters
from tests.batch.buckets import Bucket
from tests.batch.runs import begun, call, under_way
from tests.robustness import jobs


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> jobs.Files:
    """What a run in folders writes."""
    return made(jobs.undisturbed(tmp_path_factory.mktemp("whole") / "job"))


@pytest.fixture
def job(tmp_path: Path, bucket: Bucket) -> Path:
    """The same job with its clips and results in a bucket; beside it lies nothing."""
    bucket.put(**{f"clips/{name}": data for name, data in jobs.CLIPS.items()})
    path = tmp_path / "one" / "job.yaml"
    path.parent.mkdir()
    text = jobs.JOB.replace("clips/*", f"{bucket.address}/clips/*")
    path.write_text(f"output: {{folder: '{bucket.address}/restored'}}\n{text}")
    return path


def made(files: jobs.Files) -> jobs.Files:
    """The results among files; a sidecar states where the job's file lies, which differs."""
    return {name: data.replace(b'"../job.yaml"', b'"job.yaml"') for name, data in files.items() if data != jobs.MINE}


def results(bucket: Bucket) -> jobs.Files:
    return bucket.files("restored/")


def tidy(job: Path) -> bool:
    return [path.name for path in job.parent.iterdir()] == ["job.yaml"]


def one_line(done: "subprocess.CompletedProcess[str]", code: int, *words: str) -> None:
    assert (done.returncode, done.stderr.count("\n")) == (code, 1), done.stderr
    assert all(word in done.stderr for word in words), done.stderr


def test_a_bucket_gets_the_bytes_that_a_folder_gets(job: Path, bucket: Bucket, whole: jobs.Files) -> None:
    done = call("run", job)
    assert done.returncode == 0, done.stderr
    assert results(bucket) == whole
    assert f"{bucket.address}/restored/one_rsvideo.mp4" in done.stderr
    assert tidy(job)


@pytest.mark.slow
def test_chunks_by_hand_on_machines_with_the_jobs_file_alone(job: Path, bucket: Bucket, whole: jobs.Files, tmp_path: Path) -> None:
    job.write_text(job.read_text().replace("*", "two.mov"))
    assert [each["chunk"] for each in json.loads(call("chunks", job).stdout)] == [0, 1, 2]
    for number, some in enumerate([(2,), (1, 0)]):
        other = shutil.copytree(job.parent, tmp_path / f"machine{number}") / job.name
        done = call("work", other, "--chunks", ",".join(map(str, some)), how=None, RSVIDEO_CACHE=tmp_path / f"cache{number}")
        assert done.returncode == 0, done.stderr
        assert tidy(other)
    last = shutil.copytree(job.parent, tmp_path / "last") / job.name
    done = call("finish", last, how=None, RSVIDEO_CACHE=tmp_path / "cache", TALLY=tmp_path / "tally")
    assert done.returncode == 0, done.stderr
    assert results(bucket) == {name: data for name, data in whole.items() if name.startswith("two_")}
    assert not (tmp_path / "tally").exists()


@pytest.mark.long
@pytest.mark.parametrize("ledger", ["kept", "damaged"])
def test_results_that_were_uploaded_are_not_made_again(job: Path, bucket: Bucket, whole: jobs.Files, ledger: str) -> None:
    failed = call("run", job, how=None, KILLED="two.mov 2")
    assert failed.returncode == 1
    assert set(results(bucket)) == {name for name in whole if not name.startswith("two_")}
    if ledger == "damaged":
        next(job.parent.glob(".rsvideo-*/ledger.sqlite")).write_bytes(b"no ledger")
    done = call("run", job)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("is done already") == 2
    assert results(bucket) == whole
    assert tidy(job)


@pytest.mark.parametrize("last", ["two_rsvideo.mov", pytest.param("two_rsvideo.rsvideo.json", marks=pytest.mark.long)])
def test_a_run_that_is_killed_while_it_uploads_goes_on(job: Path, bucket: Bucket, whole: jobs.Files, last: str) -> None:
    """What it has uploaded is the job's own, though the ledger had no time to note it."""
    job.write_text(job.read_text().replace("*", "two.mov"))
    assert call("run", job, how=None, UPLOADED=last).returncode == -signal.SIGKILL
    assert ("two_rsvideo.rsvideo.json" in results(bucket)) == (last != "two_rsvideo.mov")
    done = call("run", job, how=None, TALLY=job.with_name("tally"))
    assert done.returncode == 0, done.stderr
    assert not job.with_name("tally").exists()
    assert results(bucket) == {name: data for name, data in whole.items() if name.startswith("two_")}


@pytest.mark.parametrize("verb", ["run", pytest.param("chunks", marks=pytest.mark.long), pytest.param("finish", marks=pytest.mark.long)])
def test_results_of_others_are_kept(job: Path, bucket: Bucket, verb: str) -> None:
    if verb == "finish":
        assert call("chunks", job).returncode == 0
    bucket.put(**{"restored/two_rsvideo.rsvideo.json": jobs.MINE})
    one_line(call(verb, job), 4, f"{bucket.address}/restored/two_rsvideo.rsvideo.json exists already; give --overwrite")
    assert results(bucket)["two_rsvideo.rsvideo.json"] == jobs.MINE


@pytest.mark.long
def test_overwrite_replaces_them(job: Path, bucket: Bucket, whole: jobs.Files) -> None:
    bucket.put(**{"restored/two_rsvideo.mov": jobs.MINE})
    assert call("run", job, "--overwrite").returncode == 0
    assert results(bucket) == whole


@pytest.mark.long
def test_a_chunk_that_was_changed_in_the_bucket_is_not_taken(job: Path, bucket: Bucket, whole: jobs.Files) -> None:
    job.write_text(job.read_text().replace("*", "two.mov"))
    assert call("chunks", job).returncode == 0
    assert call("work", job, "--chunks", "0-2").returncode == 0
    data = next(key for key, held in bucket.files().items() if "/store/" in key and len(held) == 4 and not key.endswith(".json"))
    bucket.put(**{data: b"hmmm"})
    done = call("finish", job)
    assert done.returncode == 3
    numbers = done.stderr.splitlines()[-1].rpartition("--chunks ")[2].split()[0]
    assert numbers.isdecimal()
    assert call("work", job, "--chunks", numbers).returncode == 0
    assert call("finish", job).returncode == 0
    assert results(bucket) == {name: data for name, data in whole.items() if name.startswith("two_")}


@pytest.mark.parametrize(
    ("source", "folder", "code", "words"),
    [
        ("{}/clips/none.mp4", "{}/r", 3, ["job.yaml:3: ", "/clips/none.mp4 does not exist"]),
        ("{}/clips/*.avi", "{}/r", 2, ["job.yaml:3: ", "nothing matches ", "*.avi"]),
        ("s3://no-such-bucket-of-ours/a.mp4", "{}/r", 2, ["s3://no-such-bucket-of-ours/a.mp4 cannot be used: there is no bucket"]),
        ("s3://no-such-bucket-of-ours/*.mp4", "{}/r", 2, ["cannot be used: there is no bucket"]),
        ("{}/clips/one.mp4", "s3://no-such-bucket-of-ours/r", 2, ["s3://no-such-bucket-of-ours/r", "there is no such bucket"]),
        ("http://127.0.0.1/a.mp4", "{}/r", 2, ["an address must begin with s3://, gs://, az://, abfs:// and chain no others"]),
        ("s3://me:secret@bucket/a.mp4", "{}/r", 2, ["must not hold a user or a password"]),
        ("{}", "{}/r", 2, ["must name an object"]),
        ("{}/clips/one.mp4", "{}/r*", 2, ["job.yaml:1: output.folder", "must be one address, not a pattern"]),
        ("{}/clips/one.mp4", "http://127.0.0.1/r", 2, ["job.yaml:1: output.folder", "must begin with s3://"]),
        ("{}/clips/one.mp4", "{}/clips, name: one.mp4", 2, ["is the result of", "and a source too"]),
    ],
)  # fmt: skip
def test_addresses_that_cannot_be_meant_are_refused_in_one_line(
    job: Path, bucket: Bucket, source: str, folder: str, code: int, words: list[str]
) -> None:
    text = f'output: {{folder: {folder}}}\ndefaults: {{camera: {{exposure: 1/50}}}}\nclips: ["{source}"]\n'
    job.write_text(text.replace("{}", bucket.address))
    done = call("run", job)
    one_line(done, code, *words)
    assert "secret" not in done.stderr
    assert set(bucket.files()) == {f"clips/{name}" for name in jobs.CLIPS}
    assert tidy(job)


def test_an_upload_that_fails_ends_with_what_was_done_kept(job: Path, bucket: Bucket, whole: jobs.Files, monkeypatch) -> None:
    """A policy of the bucket's owner forbids the sidecars, which come last."""
    job.write_text(job.read_text().replace("*", "two.mov"))
    done = call("run", job, how=None, REFUSED="two_rsvideo.rsvideo.json")
    assert done.returncode == 1
    assert f"{bucket.address}/restored/two_rsvideo.rsvideo.json could not be written: " in done.stderr.splitlines()[-1]
    assert "3 chunks of others are kept, the same command goes on from there" in done.stderr.splitlines()[-1]
    assert set(results(bucket)) == {"two_rsvideo.mov", "two_rsvideo.gcsv"} & set(whole)
    done = call("run", job, how=None, TALLY=job.with_name("tally"))
    assert done.returncode == 0, done.stderr
    assert not job.with_name("tally").exists()
    assert results(bucket) == {name: data for name, data in whole.items() if name.startswith("two_")}


def test_without_credentials_the_command_says_where_they_come_from(job: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("AWS_ACCESS_KEY_ID")
    one_line(call("run", job), 2, "there are no credentials", "AWS_PROFILE")


def test_a_server_that_does_not_answer_is_named(job: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    one_line(call("run", job), 2, "cannot be used", "http://127.0.0.1:9")


def test_without_the_extra_the_command_says_how_to_get_it(job: Path) -> None:
    program = f"import sys; sys.modules['fsspec'] = None; sys.argv = ['rsvideo', 'run', {str(job)!r}]"
    done = subprocess.run(
        [sys.executable, "-c", f"{program}; from rsvideo.cli import main; main()"], capture_output=True, text=True, check=False, timeout=60
    )
    one_line(done, 2, "pip install 'rsvideo[objects]'")


@pytest.fixture
def machines(tmp_path: Path, bucket: Bucket) -> Iterator[clusters.Machines]:
    """A scheduler without workers."""
    (tmp_path / "dask").mkdir()
    with clusters.running(tmp_path / "dask") as machines:
        yield machines


def worker(machines: clusters.Machines, job: Path, number: int, **mishaps: Any) -> "subprocess.Popen[bytes]":
    """One that sees neither the folder of the job nor the sources of others, and has a disk of its own."""
    own = machines.folder / f"disk{number}"
    own.mkdir()
    return machines.worker(UNSEEN=job.parent, RSVIDEO_CACHE=own / "sources", TMPDIR=own, **mishaps)


@pytest.mark.long
def test_workers_that_share_no_disk_write_the_bytes_of_a_run_and_may_be_killed(
    job: Path, bucket: Bucket, whole: jobs.Files, machines: clusters.Machines, tmp_path: Path
) -> None:
    tally, mine = tmp_path / "tally", {"RSVIDEO_CACHE": job.parent / "sources"}
    first = worker(machines, job, 1, TALLY=tally, PACE=0.05)
    with under_way("run", job, "--scheduler", machines.address, **mine) as working:
        begun(tally, 4)
        os.killpg(first.pid, signal.SIGKILL)
        worker(machines, job, 2, TALLY=tally)
        worker(machines, job, 3, TALLY=tally)
        _, told = working.communicate(timeout=100)
    assert working.returncode == 0, told
    assert results(bucket) == whole
    assert tally.read_text().count("\n") == jobs.CHUNKS + 1
    assert set(bucket.files()) == {f"clips/{name}" for name in jobs.CLIPS} | {f"restored/{name}" for name in whole}


@pytest.mark.long
@pytest.mark.parametrize(
    ("mishap", "words"),
    [
        ({"AWS_ACCESS_KEY_ID": "", "AWS_SECRET_ACCESS_KEY": ""}, "is refused: it cannot use s3://"),
        ({"AWS_ENDPOINT_URL": "http://127.0.0.1:9"}, "Could not connect"),
        ({"BARE": "1"}, "pip install 'rsvideo[objects]'"),
    ],
    ids=["no credentials", "no network", "no extra"],
)
def test_a_worker_that_cannot_use_the_address_is_refused_in_one_line(
    job: Path, bucket: Bucket, machines: clusters.Machines, mishap: dict[str, object], words: str
) -> None:
    worker(machines, job, 1, **mishap)
    done = call("run", job, "--scheduler", machines.address)
    assert done.returncode == 2
    first, last = done.stderr.splitlines()
    assert words in first
    assert last == f"rsvideo: no worker of {machines.address} can work for this run, see above; start others, or put them right"
    assert set(bucket.files()) == {f"clips/{name}" for name in jobs.CLIPS}
    assert tidy(job)
