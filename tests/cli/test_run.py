"""Batches through the command, with a quick core: what is asked for, what is done, and what survives."""

import contextlib
import json
import os
import pty
import random
import re
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.batch.runs import STAND_IN, begun, call, environment, under_way

CLIPS = {"a b.mp4": b"abcdefghijklmn", "\u00fcber.mov": b"klmnopqr", "c.mp4": b"stuvwxyz01234"}
JOB = """\
defaults:
  camera: {exposure: 1/50, readout: 20ms, focal_px: 1400}
clips:
  - clips/*.mp4
  - source: clips/\u00fcber.mov
    camera: {exposure: 1/100}
"""
CHUNKS = 4 + 2 + 4
AT_LAST = "a b.mp4 3"  # the first clip's last chunk

Run = Callable[..., subprocess.CompletedProcess[str]]


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """Three clips, one with a space and one with an umlaut in its name, and a file that asks for them."""
    (tmp_path / "clips").mkdir()
    for name, data in CLIPS.items():
        (tmp_path / "clips" / name).write_bytes(data)
    path = tmp_path / "job.yaml"
    path.write_text(JOB, encoding="utf-8")
    return path


def results(job: Path, folder: str = "restored") -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in (job.parent / folder).iterdir() if path.is_file()}


def one_line(done: subprocess.CompletedProcess[str], code: int, *words: str) -> None:
    assert done.returncode == code, done.stderr
    assert done.stderr.startswith("rsvideo: ")
    assert done.stderr.count("\n") == 1, done.stderr
    for word in words:
        assert word in done.stderr


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> dict[str, bytes]:
    """What an uninterrupted run writes."""
    folder = tmp_path_factory.mktemp("whole")
    (folder / "clips").mkdir()
    for name, data in CLIPS.items():
        (folder / "clips" / name).write_bytes(data)
    (folder / "job.yaml").write_text(JOB, encoding="utf-8")
    assert call("run", folder / "job.yaml").returncode == 0
    return results(folder / "job.yaml")


def test_two_workers_look_at_two_clips_before_they_are_planned(job: Path, whole: dict[str, bytes]) -> None:
    opened = job.parent / "opened"
    assert call("run", job, "-j", 2, OPENED=opened).returncode == 0
    lines = [line.rpartition(" ") for line in opened.read_text().splitlines()]
    lookers = [pid for _, _, pid in lines[:3]]  # each clip is opened once before it is planned, in yet another process
    assert sorted(name for name, _, _ in lines[:3]) == sorted(CLIPS)
    assert len({*lookers}) == 2
    assert [name for name, _, pid in lines if pid not in lookers] == [
        item.rpartition(" ")[0] for item in ("a b.mp4 ", "c.mp4 ", "über.mov ")
    ]
    assert results(job) == whole


def test_a_batch_ends_with_its_results_a_table_and_nothing_else(job: Path, whole: dict[str, bytes]) -> None:
    done = call("run", job, "-j", 2)
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    assert results(job) == whole
    assert {"a b_rsvideo.mp4", "a b_rsvideo.rsvideo.json", "\u00fcber_rsvideo.mov"} <= set(whole)
    assert sorted(path.name for path in (job.parent / "restored").iterdir()) == sorted(whole)
    header, *rows = done.stderr.splitlines()
    assert header.split() == ["clip", "restored", "left", "failed", "seconds", "output"]
    told = [tuple(cell.strip() for cell in row.split("  ") if cell) for row in rows[:3]]
    sizes = {"a b.mp4": "14", "c.mp4": "13", "\u00fcber.mov": "8"}
    assert [(Path(clip).name, *counts) for clip, *counts, _ in told] == [(name, size, "0", "0", "1.5") for name, size in sizes.items()]
    assert "note: " in done.stderr
    assert "timecode is dropped" in done.stderr


def test_the_dry_run_says_everything_and_does_nothing(job: Path) -> None:
    done = call("run", job, "--dry-run")
    assert done.returncode == 0, done.stderr
    for word in ("a b.mp4 -> ", "a b_rsvideo.mp4", "14 frames of 64 x 48", "0-3, 4-7, 8-11, 12-13", "exposure 20 ms", "exposure 10 ms"):
        assert word in done.stdout
    for word in ("readout 20 ms top-to-bottom", "(exposure explicit, readout explicit)", "0:00:28", "0.035 GB"):
        assert word in done.stdout
    assert not (job.parent / "restored").exists()
    plan = json.loads(call("run", job, "--dry-run", "--json").stdout)
    assert [clip["frames"] for clip in plan["clips"]] == [14, 13, 8]
    assert plan["clips"][2]["exposure_s"] == 0.01
    assert plan["clips"][2]["chunks"][1] == {"index": 1, "first": 4, "last": 7, "warm_up": 2}


def test_validate_names_sources_and_results_and_opens_no_clip(job: Path) -> None:
    (job.parent / "clips" / "c.mp4").write_bytes(b"BAD")
    done = call("validate", job)
    assert done.returncode == 0, done.stderr
    assert [Path(line.split("\t")[1]).name for line in done.stdout.splitlines()] == [
        "a b_rsvideo.mp4",
        "c_rsvideo.mp4",
        "\u00fcber_rsvideo.mov",
    ]


def test_the_schema_is_json() -> None:
    assert json.loads(call("schema").stdout)["properties"]["clips"]["type"] == "array"


def test_lines_for_machines_end_with_the_result(job: Path) -> None:
    done = call("run", job, "--progress", "jsonl")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    assert {line["event"] for line in lines} == {"stage", "frame", "chunk", "finished", "ended"}
    assert [line["event"] for line in lines].count("chunk") == CHUNKS
    assert all(0 <= line["done"] <= line["frames"] == 35 for line in lines[:-1])
    done_frames = [line["done"] for line in lines[:-1]]
    assert done_frames == sorted(done_frames)
    assert lines[-1]["code"] == 0
    assert [clip["restored"] for clip in lines[-1]["clips"]] == [14, 13, 8]


@pytest.mark.slow
def test_a_terminal_sees_the_batch_the_clip_the_frame_and_the_time_left(job: Path) -> None:
    ours, theirs = pty.openpty()
    program = [sys.executable, STAND_IN, "run", job]
    shown = environment({"TERM": "xterm", "NO_COLOR": "1", "PACE": 0.03, "COLUMNS": "140"})
    with subprocess.Popen(program, stdout=subprocess.DEVNULL, stderr=theirs, env=shown):
        os.close(theirs)
        told = b""
        with contextlib.suppress(OSError):  # how Linux says that the other end of a terminal is gone
            while more := os.read(ours, 4096):
                told += more
    os.close(ours)
    for word in (rb"batch", rb"a b_rsvideo.mp4: frame \d+, motion", rb"0:00:\d\d left"):
        assert re.search(word, told)


@pytest.mark.parametrize(
    ("text", "code", "words"),
    [
        ("clips:\n  - source: clips/*.mp4\n    camera: {exposur: 1/50}\n", 2, ["job.yaml:3: ", "did you mean exposure?"]),
        ("clips: [a]\nclips: [b]\n", 2, ["job.yaml:2: ", "clips", "twice"]),
        ("a: &a [x, x]\nb: &b [*a, *a]\nclips: [*b, *b]\n", 2, ["job.yaml:2", "aliases"]),
        ("clips: [!!python/object/apply:os.system [ls]]\n", 2, ["job.yaml:1", "tags"]),
        ("clips:\n  - clips/a b.mp4\n  - clips/*.avi\n", 2, ["job.yaml:3: ", "nothing in ", "clips/*.avi"]),
        ("clips:\n  - clips/none.mp4\n", 3, ["job.yaml:2: ", "none.mp4", "does not exist"]),
        ("clips:\n  - clips/*.mp4\n  - clips/a b.mp4\n", 2, ["job.yaml:3: ", "as ", "a b.mp4 does", "job.yaml:2"]),
        ("clips:\n  - clips/a b.mp4\n  - {source: clips/c.mp4, name: '../x'}\n", 2, ["job.yaml:3: clips.1.name", "output.folder"]),
        ("output: {folder: clips, name: c.mp4}\nclips:\n  - clips/a b.mp4\n  - {source: clips/c.mp4, name: d}\n", 2, ["a source too"]),
        ("clips:\n  - clips/a b.mp4\n", 2, ["job.yaml:2: ", "a b.mp4", "exposure must be given"]),
        ("", 3, ["job.yaml", "is empty"]),
        ("\tclips: [", 2, ["job.yaml:1"]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_job_that_cannot_be_meant_is_refused_by_file_and_line(job: Path, text: str, code: int, words: list[str]) -> None:
    job.write_text(text)
    one_line(call("run", job), code, *words)
    assert not (job.parent / "restored").exists()


def test_every_fault_of_a_job_is_told(job: Path) -> None:
    job.write_text("clips:\n  - source: x\n    camera: {exposur: 1/50}\n    motion: {degree: 99}\n")
    done = call("validate", job)
    assert done.returncode == 2
    assert [line.split(": ")[1].rpartition(":")[2] for line in done.stderr.splitlines()] == ["3", "4"]


def test_the_command_line_goes_over_the_file(job: Path) -> None:
    done = call(
        "run", job, "--set", "camera.exposure=1/200", "--set", "output.folder=else where", "--set", "output.name=x-{folder}-{stem}.mkv"
    )
    assert done.returncode == 0, done.stderr
    assert {"x-clips-a b.mkv", "x-clips-\u00fcber.mkv"} <= set(results(job, "else where"))
    one_line(call("run", job, "--set", "camera.exposur=1"), 2, "--set camera.exposur: ", "did you mean exposure?")


def test_results_beside_their_sources_are_no_sources(job: Path) -> None:
    job.write_text("output: {folder: clips}\ndefaults: {camera: {exposure: 1/50}}\nclips: ['clips/*.mp4']\n")
    for code in (0, 0):
        done = call("run", job, "--overwrite")
        assert done.returncode == code, done.stderr
    assert len([name for name in results(job, "clips") if name.endswith(".mp4")]) == 4


def test_a_result_never_replaces_its_source(job: Path) -> None:
    job.write_text("output: {folder: clips, name: '{stem}{ext}'}\ndefaults: {camera: {exposure: 1/50}}\nclips: ['clips/*.mp4']\n")
    one_line(call("run", job, "--overwrite"), 2, "a source too")
    assert results(job, "clips") == CLIPS


def test_results_that_exist_are_kept(job: Path) -> None:
    (job.parent / "restored").mkdir()
    (job.parent / "restored" / "c_rsvideo.mp4").write_text("mine")
    one_line(call("run", job), 4, "c_rsvideo.mp4", "--overwrite")
    assert results(job) == {"c_rsvideo.mp4": b"mine"}
    assert len(list((job.parent / "restored").iterdir())) == 1
    assert call("run", job, "--overwrite").returncode == 0


def test_two_clips_never_share_a_sidecar(job: Path) -> None:
    (job.parent / "clips" / "c.mov").write_bytes(b"abc")
    with job.open("a") as file:
        file.write("  - clips/c.mov\n")
    one_line(call("run", job), 2, "c.mov", "c.mp4", "c_rsvideo.rsvideo.json")


def test_a_damaged_clip_does_not_hold_up_the_others(job: Path, whole: dict[str, bytes]) -> None:
    (job.parent / "clips" / "a b.mp4").write_bytes(b"BAD")
    done = call("run", job)
    assert done.returncode == 3
    assert "a b.mp4 is damaged" in done.stderr
    assert "1 of 3 clips failed" in done.stderr
    assert {name: data for name, data in whole.items() if not name.startswith("a b")} == results(job)


def test_damage_found_while_working_fails_that_clip_only(job: Path, whole: dict[str, bytes]) -> None:
    (job.parent / "clips" / "a b.mp4").write_bytes(b"abcdefghi!klmn")
    done = call("run", job, "-j", 2)
    assert done.returncode == 3
    assert "a b.mp4 is damaged at frame 9" in done.stderr
    assert {name: data for name, data in whole.items() if not name.startswith("a b")} == results(job)
    (job.parent / "clips" / "a b.mp4").write_bytes(CLIPS["a b.mp4"])
    tally = job.with_name("tally")
    done = call("run", job, TALLY=tally)
    assert done.returncode == 0, done.stderr
    assert results(job) == whole
    assert {line.rpartition(" ")[0] for line in tally.read_text().splitlines()} == {"a b.mp4"}


def test_more_failed_frames_than_allowed_are_an_exit_code(job: Path) -> None:
    (job.parent / "clips" / "c.mp4").write_bytes(b"ab?")
    done = call("run", job)
    assert done.returncode == 5
    assert "most_failed_frames" in done.stderr
    assert call("run", job, "--overwrite", "--set", "report.most_failed_frames=1").returncode == 0


def test_the_number_of_workers_changes_no_byte(job: Path, whole: dict[str, bytes]) -> None:
    assert call("run", job, "-j", 3).returncode == 0
    assert results(job) == whole


@pytest.mark.slow
def test_a_job_killed_at_random_moments_ends_as_if_it_had_not_been(job: Path, whole: dict[str, bytes]) -> None:
    chance = random.Random(1)
    kept = 0
    for round_ in range(2):
        tally = job.with_name(f"tally{round_}")
        with under_way("run", job, "-j", 2, TALLY=tally, PACE=0.02) as working:
            begun(tally, chance.randrange(2, 5))
            time.sleep(chance.random() * 0.1)
            os.kill(working.pid, signal.SIGKILL)
            working.wait()
        kept += tally.read_text().count("\n") - 2
    last = job.with_name("last")
    done = call("run", job, TALLY=last)
    assert done.returncode == 0, done.stderr
    assert results(job) == whole
    assert sorted(path.name for path in (job.parent / "restored").iterdir()) == sorted(whole)
    assert last.read_text().count("\n") <= CHUNKS - kept


def test_a_job_killed_between_a_result_and_its_entry_in_the_ledger_goes_on(job: Path, whole: dict[str, bytes]) -> None:
    assert call("run", job, ORPHANED="a b_rsvideo.mp4", TALLY=job.with_name("worker")).returncode == -signal.SIGKILL
    assert (job.parent / "restored" / "a b_rsvideo.mp4").exists()
    worker = Path("/proc") / job.with_name("worker").read_text()
    while worker.exists() and "State:\tZ" not in (worker / "status").read_text():  # no worker outlives the command
        time.sleep(0.01)
    tally = job.with_name("tally")
    done = call("run", job, TALLY=tally)
    assert done.returncode == 0, done.stderr
    assert "4 of 4 chunks are done already" in done.stderr
    assert results(job) == whole
    assert "a b" not in tally.read_text()


def test_a_source_that_changes_while_it_is_read_is_no_result(job: Path) -> None:
    done = call("run", job, CHANGED="a b.mp4")
    assert done.returncode == 3
    assert "a b.mp4 changed while it was read" in done.stderr
    assert "a b_rsvideo.mp4" not in results(job)


@pytest.mark.slow
@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_an_interrupt_keeps_what_is_done_and_says_how_to_go_on(
    job: Path, whole: dict[str, bytes], sent: signal.Signals, code: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    tally = job.with_name("tally")
    with under_way("run", job, TALLY=tally, HELD="c.mp4 1") as working:
        begun(tally, 6)
        os.killpg(working.pid, sent)  # as a terminal does
        _, told = working.communicate(timeout=20)
    assert working.returncode == code
    kept = "1 clip and 1 chunk of others are kept, the same command goes on from there"
    assert told.splitlines()[-1] == f"rsvideo: stopped by {sent.name}; {kept}"
    assert "Traceback" not in told
    again = job.with_name("again")
    monkeypatch.chdir(job.parent)  # it goes on from anywhere
    assert call("run", job.name, TALLY=again).returncode == 0
    assert results(job) == whole
    assert again.read_text().count("\n") == CHUNKS - 5


@pytest.mark.parametrize("ruin", ["absent", "changed"])
def test_a_chunk_is_verified_before_it_is_trusted(job: Path, whole: dict[str, bytes], ruin: str) -> None:
    assert call("run", job, KILLED=AT_LAST).returncode == 1
    (clip,) = (path.parent for path in (job.parent / "restored").rglob("00001.bytes"))
    if ruin == "absent":
        (clip / "00001.bytes").unlink()
    else:
        (clip / "00001.bytes").write_bytes(b"othr")
    tally = job.with_name("tally")
    assert call("run", job, TALLY=tally).returncode == 0
    assert results(job) == whole
    assert {line.rpartition(" ")[2] for line in tally.read_text().splitlines()} == {"1", "3"}


@pytest.mark.parametrize("change", ["settings", "source"])
def test_what_was_done_with_other_settings_or_from_another_source_is_done_anew(job: Path, change: str) -> None:
    assert call("run", job, KILLED=AT_LAST).returncode == 1
    words = ["--set", "motion.degree=6"] if change == "settings" else []
    if change == "source":
        (job.parent / "clips" / "a b.mp4").write_bytes(b"ABCDEFGHIJKLMN")
    tally = job.with_name("tally")
    done = call("run", job, *words, TALLY=tally)
    assert done.returncode == 0, done.stderr
    assert f"{'its settings have' if change == 'settings' else 'its source has'} changed; it is done anew" in done.stderr
    begun_chunks = [line for line in tally.read_text().splitlines() if line.startswith("a b")]
    assert len(begun_chunks) == 4
    if change == "settings":
        assert b"degree" in results(job)["\u00fcber_rsvideo.rsvideo.json"]


def test_a_fresh_start_forgets_what_was_done(job: Path) -> None:
    assert call("run", job, KILLED=AT_LAST).returncode == 1
    tally = job.with_name("tally")
    done = call("run", job, "--fresh", "--overwrite", TALLY=tally)
    assert done.returncode == 0, done.stderr
    assert tally.read_text().count("\n") == CHUNKS


def test_a_worker_that_dies_is_replaced_and_its_chunk_tried_once_more(job: Path, whole: dict[str, bytes]) -> None:
    done = call("run", job, "-j", 2, KILLED_ONCE=job.with_name("killed"))
    assert done.returncode == 0, done.stderr
    assert "killed by SIGKILL" in done.stderr
    assert "tried once more" in done.stderr
    assert results(job) == whole


def test_a_chunk_that_kills_two_workers_fails_its_clip_and_the_others_go_on(job: Path, whole: dict[str, bytes]) -> None:
    tally = job.with_name("tally")
    done = call("run", job, "-j", 2, KILLED=AT_LAST, TALLY=tally)
    assert done.returncode == 1
    assert "1 of 3 clips failed; 2 clips and 3 chunks of others are kept" in done.stderr
    assert results(job) == {name: data for name, data in whole.items() if not name.startswith("a b")}
    assert tally.read_text().splitlines().count(AT_LAST) == 2


@pytest.mark.slow
def test_two_runs_of_one_job_do_not_meet(job: Path, whole: dict[str, bytes]) -> None:
    tally = job.with_name("tally")
    with under_way("run", job, TALLY=tally, HELD="c.mp4 0") as working:
        begun(tally, 5)
        one_line(call("run", job), 1, "another run works on this job already")
        one_line(call("run", job, "--fresh"), 1, "another run works on this job already")
        assert working.poll() is None
    assert call("run", job).returncode == 0
    assert results(job) == whole


def test_a_full_disk_ends_the_run_and_keeps_what_is_done(job: Path, whole: dict[str, bytes]) -> None:
    done = call("run", job, FULL=2)
    assert done.returncode == 1
    assert "No space left on device; 0 clips and 2 chunks of others are kept" in done.stderr
    assert done.stderr.count("\n") == 1
    assert call("run", job).returncode == 0
    assert results(job) == whole


def files_of_at_most_2000_bytes() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))


def test_a_disk_too_full_for_the_ledger_is_told(job: Path) -> None:
    done = call("run", job, how=files_of_at_most_2000_bytes)
    one_line(done, 1, "ledger.sqlite", "could not be written")


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no folder that even root cannot write into")
def test_a_folder_that_cannot_be_written_is_refused(job: Path) -> None:
    for folder in ("/proc", "/proc/restored"):
        one_line(call("run", job, "--set", f"output.folder={folder}"), 2, "/proc", "must be writable", "output.folder")
