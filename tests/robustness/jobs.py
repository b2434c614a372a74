"""Jobs that are ended, damaged and resumed: the same few clips for all tests, with a core that costs nothing."""

import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

from tests.batch import runs

CLIPS = {"one.mp4": b"abcdefghijklmnopq", "two.mov": b"klmnopqrst", "three.mp4": b"stuvwxyz01234"}
JOB = "defaults: {camera: {exposure: 1/50, readout: 20ms, focal_px: 1400}}\nclips: ['clips/*']\n"
CHUNKS = 5 + 3 + 4
MINE = b"mine, made by nobody else"  # in files that no run may touch

Files = dict[str, bytes]


def make(folder: Path) -> Path:
    """A job of three clips in a folder, and files of other people's beside its results."""
    (folder / "clips").mkdir(parents=True)
    for name, data in CLIPS.items():
        (folder / "clips" / name).write_bytes(data)
    (folder / "job.yaml").write_text(JOB)
    (folder / "restored").mkdir()
    for name in ("one_rsvideo.mp4.part", "one_rsvideo.rsvideo.json.part", "letter.txt"):
        (folder / "restored" / name).write_bytes(MINE)
    return folder / "job.yaml"


def run(job: Path, *words: object, how: Callable[[], None] | None = None, **mishaps: object) -> subprocess.CompletedProcess[str]:
    """A run of the job to its end, as `runs.call` does it."""
    return runs.call("run", job, *words, how=how, **mishaps)


def results(job: Path) -> Files:
    """All files beside the results, by their names."""
    return {path.name: path.read_bytes() for path in (job.parent / "restored").iterdir() if path.is_file()}


def undisturbed(folder: Path) -> Files:
    """All files beside the results of a job that nothing disturbs."""
    job = make(folder)
    done = run(job)
    assert done.returncode == 0, done.stderr
    assert not left_behind(job)
    return results(job)


def halted(folder: Path) -> Path:
    """A job one of whose clips is not finished, with chunks that are kept; the two others are."""
    job = make(folder)
    done = run(job, KILLED="two.mov 2")
    assert done.returncode == 1, done.stderr
    assert len(list(folder.glob("restored/*_rsvideo.mp4"))) == 2
    return job


def copied(job: Path, folder: Path) -> Path:
    """The same job with all that it has made, elsewhere."""
    return shutil.copytree(job.parent, folder) / job.name


def left_behind(job: Path) -> list[str]:
    """Folders beside the results: a run that has ended well leaves none."""
    return [path.name for path in (job.parent / "restored").iterdir() if path.is_dir()]


def check_pairs(job: Path, whole: Files) -> None:
    """What has a name is as in the undisturbed run, and no result has one without its sidecar."""
    found = results(job)
    assert {name: whole[name] for name in found} == found
    for name in (name for name in found if name.endswith(("_rsvideo.mp4", "_rsvideo.mov"))):
        assert Path(name).stem + ".rsvideo.json" in found
    for name in (name for name in found if name.endswith("_rsvideo.rsvideo.json")):
        assert any(other.startswith(name.removesuffix(".rsvideo.json") + ".m") for other in found)


def check_one_line(done: subprocess.CompletedProcess[str]) -> None:
    """The run was refused in one clear line, after its notes."""
    *notes, last = done.stderr.splitlines()
    assert all(note.startswith("rsvideo: note: ") for note in notes), done.stderr
    assert last.startswith("rsvideo: ")
    for word in ("Traceback", "failed while working", "Error:", "no such table", "Expecting value"):
        assert word not in done.stderr
