"""Names beside an output: what stands there is never written through, and no input is replaced by what is written with a result."""

import shutil
import subprocess
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli.conftest import Run
from tests.cli.forked import call
from tests.cli.test_bad_input import GOOD, one_line
from tests.cli.test_compare import compare
from tests.video.clips import make

NULL = ("--method", "none")
MINE = b"t_ns wx wy wz, mine"


def deblur(*words: object) -> subprocess.CompletedProcess[str]:
    return call("deblur", *words)


def pictures(folder: Path, numbers: range, stem: str = "shot_{}") -> Path:
    """A take of small pictures."""
    folder.mkdir(exist_ok=True)
    for n in numbers:
        assert cv2.imwrite(str(folder / f"{stem.format(n)}.png"), np.full((48, 64, 3), 10 * n, np.uint8))
    return folder


@pytest.mark.parametrize("beside", ["out.png.part", "out.rsvideo.json.part"])
@pytest.mark.parametrize("kind", ["link", "file", "folder"])
def test_a_file_called_part_is_somebodys(photograph: Path, rsvideo_at_once: Run, beside: str, kind: str) -> None:
    part, mine = photograph.with_name(beside), photograph.with_name("mine")
    mine.write_bytes(MINE)
    if kind == "link":
        part.symlink_to(mine)
    elif kind == "file":
        part.write_bytes(MINE)
    else:
        part.mkdir()
        (part / "within").write_bytes(MINE)
    done = rsvideo_at_once("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD)
    assert done.returncode == 0, done.stderr
    assert mine.read_bytes() == (part / "within" if kind == "folder" else part).read_bytes() == MINE
    assert {path.name for path in photograph.parent.iterdir()} == {"in.png", "mine", beside, "out.png", "out.rsvideo.json"}


@pytest.mark.parametrize("name", ["out.mp4.part", "out.gcsv.part"])
def test_a_clip_is_not_written_through_a_link(tmp_path: Path, name: str) -> None:
    make(tmp_path / "in.mp4", frames=2)
    (tmp_path / "mine").write_bytes(MINE)
    (tmp_path / name).symlink_to(tmp_path / "mine")
    assert deblur(tmp_path / "in.mp4", "-o", tmp_path / "out.mp4", *NULL).returncode == 0
    assert (tmp_path / name).readlink() == tmp_path / "mine"
    assert (tmp_path / "mine").read_bytes() == MINE


def test_a_link_that_leads_nowhere_is_somebodys_too(photograph: Path, rsvideo: Run) -> None:
    output = photograph.with_name("out.png")
    output.symlink_to(photograph.with_name("not yet"))
    one_line(rsvideo("deblur", photograph, "-o", output, *GOOD), 4, "out.png", "--overwrite")
    assert output.is_symlink()


@pytest.mark.parametrize("link", [False, True])
def test_a_gyroscopes_log_is_not_replaced_by_the_one_that_is_written(tmp_path: Path, link: bool) -> None:
    make(tmp_path / "in.mp4", frames=2)
    log = tmp_path / ("log.gcsv" if link else "out.gcsv")
    log.write_bytes(MINE)
    if link:
        (tmp_path / "out.gcsv").symlink_to(log)
    words = ("--method", "gyro", "--gyro", log, *GOOD)
    one_line(deblur(tmp_path / "in.mp4", "-o", tmp_path / "out.mp4", *words, "--overwrite"), 2, "out.gcsv", "which is read")
    assert log.read_bytes() == MINE


def test_a_motion_that_is_given_is_not_replaced_by_the_sidecar(photograph: Path, rsvideo: Run) -> None:
    given = photograph.with_name("out.rsvideo.json")
    given.write_bytes(MINE)
    done = rsvideo("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD, "--trajectory", given, "--overwrite")
    one_line(done, 2, "out.rsvideo.json", "which is read")
    assert given.read_bytes() == MINE


def test_fewer_pictures_over_an_older_folder_leave_none_of_the_old_ones(tmp_path: Path) -> None:
    words = ("-o", tmp_path / "out", "--codec", "png", "--rate", 24, *NULL)
    assert deblur(pictures(tmp_path / "take", range(6)), *words).returncode == 0
    (tmp_path / "out" / "letter.txt").write_bytes(MINE)
    shutil.rmtree(tmp_path / "take")
    done = deblur(pictures(tmp_path / "take", range(4)), *words, "--overwrite")
    assert done.returncode == 0, done.stderr
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == ["letter.txt", *(f"shot_{n}.png" for n in range(4))]
    assert (tmp_path / "out" / "letter.txt").read_bytes() == MINE


def test_pictures_of_another_take_are_not_mixed_with_new_ones(tmp_path: Path) -> None:
    pictures(tmp_path / "out", range(3), "other_{}")
    words = ("-o", tmp_path / "out", "--codec", "png", "--rate", 24, *NULL, "--overwrite")
    one_line(deblur(pictures(tmp_path / "take", range(2)), *words), 2, "other_0.png", "another OUTPUT")
    assert len(list((tmp_path / "out").iterdir())) == 3


def test_the_folder_of_a_pattern_is_no_output(tmp_path: Path) -> None:
    take = pictures(tmp_path / "take", range(3))
    before = {path.name: path.read_bytes() for path in take.iterdir()}
    done = deblur(take / "shot_#.png", "-o", take, "--codec", "png", "--rate", 24, *NULL, "--overwrite")
    one_line(done, 2, "take", "which is read")
    assert {path.name: path.read_bytes() for path in take.iterdir()} == before


@pytest.mark.parametrize(("name", "folder", "words"), [("out.mp4", True, ()), ("out", False, ("--codec", "png"))])
def test_a_folder_is_no_file_and_a_file_no_folder(tmp_path: Path, name: str, folder: bool, words: tuple[str, ...]) -> None:
    make(tmp_path / "in.mp4", frames=2)
    (tmp_path / name).mkdir() if folder else (tmp_path / name).write_bytes(MINE)
    done = deblur(tmp_path / "in.mp4", "-o", tmp_path / name, *NULL, *words, "--overwrite")
    one_line(done, 2, "OUTPUT must be a", name)
    assert folder or (tmp_path / name).read_bytes() == MINE


def test_simulate_does_not_replace_the_log_that_it_reads(photograph: Path, rsvideo: Run) -> None:
    log = photograph.with_name("motion.csv")
    log.write_bytes(MINE)
    words = ("--exposure", "1/50", "--readout", "20ms", "--focal-px", "300", "--gyro", log, "--overwrite")
    one_line(rsvideo("simulate", photograph, "-o", photograph.with_name("b.png"), *words), 2, "motion.csv", "which is read")
    assert log.read_bytes() == MINE


def test_calibrate_does_not_replace_the_views_that_it_reads(photograph: Path, rsvideo: Run) -> None:
    before = photograph.read_bytes()
    words = ("calibrate", "lens", photograph.parent, "--board", "chessboard:6x5:25mm", "--figure", photograph, "--overwrite")
    one_line(rsvideo(*words), 2, "in.png", "which is read")
    assert photograph.read_bytes() == before


def test_calibrate_does_not_replace_the_profile_that_it_converts(tmp_path: Path, rsvideo: Run) -> None:
    profile = tmp_path / "mine.yaml"
    profile.write_text("name: Mine\nmode: {rows: 48, cols: 64}\nintrinsics: {fx: 60, fy: 60, cx: 31.5, cy: 23.5}\n")
    before = profile.read_bytes()
    one_line(rsvideo("calibrate", "convert", profile, "--to", "opencv", "-o", profile, "--overwrite"), 2, "mine.yaml", "which is read")
    assert profile.read_bytes() == before


@pytest.mark.parametrize("taken", ["results/none/in.png", "results/none/in.rsvideo.json", "index.html"])
def test_compare_replaces_only_what_a_comparison_made(photograph: Path, taken: str) -> None:
    report = photograph.with_name("report")
    mine = report / taken
    mine.parent.mkdir(parents=True)
    mine.write_bytes(MINE)
    words = (photograph, "-o", report, "--methods", "none")
    one_line(compare(*words), 4, mine.name, "--overwrite")
    assert mine.read_bytes() == MINE
    assert compare(*words, "--overwrite").returncode == 0
    assert compare(*words, "--fresh", "--overwrite").returncode == 0
    (report / "index.html").unlink()
    (report / "report.csv").unlink()
    (report / "report.json").unlink()
    done = compare(*words, "--fresh")  # its own results need no permission
    assert done.returncode == 0, done.stderr
