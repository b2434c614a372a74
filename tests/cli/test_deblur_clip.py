"""`rsvideo deblur` and `rsvideo run` on clips, through the installed command and with the real core."""

import json
import subprocess
import time
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rsvideo.video import decode
from tests.batch.runs import under_way
from tests.cli.forked import INSTALLED, call
from tests.cli.test_bad_input import one_line
from tests.pipeline.moving import Moving, encode, luma, planes
from tests.video.clips import make, packets

CLIP = Moving(frames=6)
GOOD = ("--exposure", "1/50", "--readout", "20ms", "--focal-px", str(CLIP.lens.fx))
QUICK = ("--prior", "tv", "--quality", "draft")


def rsvideo(*words: object) -> subprocess.CompletedProcess[str]:
    """The installed command."""
    return call(*words, timeout=400)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six frames with sound; its name holds a space and an umlaut."""
    return CLIP.clip(tmp_path_factory.mktemp("clip") / "Fl\u00fcgel 1.mp4", sound=True)


@pytest.fixture
def motion(tmp_path: Path) -> Path:
    (tmp_path / "given").mkdir()
    return CLIP.motion(tmp_path / "given" / "motion.csv")


def decibels(pictures: list[np.ndarray], truth: list[np.ndarray], margin: int = 10) -> np.ndarray:
    """PSNR of each picture's luma, a frame of `margin` px left out."""
    inner = np.s_[margin:-margin, margin:-margin]
    errors = [np.mean((a[inner].astype(float) - b[inner]) ** 2) for a, b in zip(pictures, truth, strict=True)]
    return 10 * np.log10(219**2 / np.array(errors))


def gains(source: Path, output: Path, truth: list[np.ndarray]) -> np.ndarray:
    return decibels(luma(output), truth) - decibels(luma(source), truth)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir() if path.name != "given")


@pytest.fixture(scope="module")
def unmeasured(source: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[subprocess.CompletedProcess[str], Path]:
    """The clip restored without a number, and how the command ended."""
    output = tmp_path_factory.mktemp("unmeasured") / "out.mkv"
    words = [INSTALLED, "deblur", source, "-o", output, "--codec", "ffv1", "--json"]
    done = subprocess.run(words, capture_output=True, text=True, timeout=120, check=False)  # a fresh process, as a user's
    return done, output


def test_a_clip_needs_no_numbers(source: Path, unmeasured: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    done, output = unmeasured
    assert done.returncode == 0, done.stderr
    timing = json.loads(done.stdout)["frames"][0]["timing"]
    assert "measured" in timing["source"] or "assumed" in timing["source"]
    assert "focal length" in done.stderr
    gained = gains(source, output, CLIP.truth)
    assert np.mean(gained) > 1
    assert (gained > 0).sum() >= 5, gained


def test_without_numbers_no_frame_gets_worse(source: Path, unmeasured: tuple[subprocess.CompletedProcess[str], Path]) -> None:
    assert min(gains(source, unmeasured[1], CLIP.truth)) > -0.1


def test_a_clip_is_closer_to_the_truth_than_before_and_keeps_its_sound(source: Path, tmp_path: Path) -> None:
    done = rsvideo("deblur", source, "-o", tmp_path / "out.mp4", *GOOD)
    assert done.returncode == 0, done.stderr
    assert "0 failed" in done.stderr
    assert done.stdout == ""
    assert names(tmp_path) == ["out.gcsv", "out.mp4", "out.rsvideo.json"]
    gained = gains(source, tmp_path / "out.mp4", CLIP.truth)
    assert gained.mean() > 4, gained
    assert (gained > 0).sum() >= 5, gained
    before, after = decode.probe(source), decode.probe(tmp_path / "out.mp4")
    assert [int(t) * before.time_base for t in before.times] == [int(t) * after.time_base for t in after.times]
    assert before.colour == after.colour
    assert packets(source, "audio") == packets(tmp_path / "out.mp4", "audio") != []


@pytest.mark.slow
def test_an_exposure_that_blur_does_not_show_is_told_and_nothing_is_deblurred(tmp_path: Path) -> None:
    moving = Moving(frames=8, rows=128, cols=192)
    clip = moving.clip(tmp_path / "clip.mp4")
    wrong = ("--exposure", "1/25", "--readout", "20ms", "--focal-px", str(moving.lens.fx), "--force")
    done = rsvideo("deblur", clip, "-o", tmp_path / "out.mkv", *wrong, "--codec", "ffv1")
    assert done.returncode == 0, done.stderr
    assert "frames does not show 40 ms" in done.stderr
    assert "0 frames restored" in done.stderr


def test_given_motion_is_used_and_gains_more(source: Path, motion: Path, tmp_path: Path) -> None:
    done = rsvideo("deblur", source, "-o", tmp_path / "out.mp4", *GOOD, *QUICK, "--trajectory", motion)
    assert done.returncode == 0, done.stderr
    gained = gains(source, tmp_path / "out.mp4", CLIP.truth)
    assert gained.mean() > 2, gained
    assert json.loads((tmp_path / "out.rsvideo.json").read_text())["settings"]["trajectory_from"] == str(motion)


def test_the_sidecar_of_one_run_is_the_motion_of_the_next(source: Path, motion: Path, tmp_path: Path) -> None:
    given, part = motion, (*GOOD, *QUICK, "--range", "0-0.08")
    for name in "ab":
        done = rsvideo("deblur", source, "-o", tmp_path / f"{name}.mp4", *part, "--trajectory", given)
        assert done.returncode == 0, done.stderr
        given = tmp_path / "a.rsvideo.json"
    for a, b in zip(*(luma(tmp_path / f"{name}.mp4") for name in "ab"), strict=True):
        assert np.abs(a.astype(float) - b).mean() < 0.5


def test_json_puts_the_sidecar_on_standard_output(source: Path, tmp_path: Path) -> None:
    done = rsvideo("deblur", source, "-o", tmp_path / "out.mp4", "--method", "none", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout) == json.loads((tmp_path / "out.rsvideo.json").read_text())
    assert [frame["index"] for frame in json.loads(done.stdout)["frames"]] == list(range(6))
    assert done.stderr == ""


def test_what_is_changed_is_told_once(tmp_path: Path) -> None:
    before = make(tmp_path / "in.mp4", codec="mpeg4", rows=96, cols=160)
    done = rsvideo("deblur", before, "-o", tmp_path / "out.mp4", "--method", "none")
    assert (done.returncode, done.stderr.count("mpeg4 is not written")) == (0, 1)


def test_a_range_beside_its_source_is_a_preview(source: Path, tmp_path: Path) -> None:
    preview = ("--range", "0.08-0.2", "--side-by-side", "--codec", "ffv1", "--method", "none")
    done = rsvideo("deblur", source, "-o", tmp_path / "out.mkv", *preview)
    assert done.returncode == 0, done.stderr
    shown = luma(tmp_path / "out.mkv")
    assert len(shown) == 3  # frames 2, 3 and 4
    for picture, whole in zip(shown, luma(source)[2:5], strict=True):
        np.testing.assert_array_equal(picture, np.hstack([whole, whole]))
    assert decode.probe(tmp_path / "out.mkv").times[0] == 0


@pytest.mark.slow
def test_a_smooth_path_is_shown_with_a_crop_that_is_told(tmp_path: Path) -> None:
    swaying = Moving(frames=8, reach=6.0)
    source = swaying.clip(tmp_path / "in.mkv")
    done = rsvideo("deblur", source, "-o", tmp_path / "out.mkv", *GOOD, *QUICK, "--path", "smooth")
    assert done.returncode == 0, done.stderr
    assert "smoothed: the picture is enlarged by" in done.stderr
    steady, truth = luma(tmp_path / "out.mkv"), swaying.truth
    assert steady[0].shape == truth[0].shape
    moves = [np.mean([np.abs(a.astype(float) - b).mean() for a, b in pairwise(p)]) for p in (steady, truth)]
    assert moves[0] < 0.5 * moves[1]  # neighbours differ less


def text(path: Path) -> None:
    path.write_text("this is a letter, not a clip")


def sound_only(path: Path) -> None:
    make(path, video=False, sound=True)


def empty(path: Path) -> None:
    path.touch()


def truncated(path: Path) -> None:
    whole = make(path.with_name("whole.mp4"), rows=96, cols=160).read_bytes()
    path.write_bytes(whole[: 2 * len(whole) // 3])
    path.with_name("whole.mp4").unlink()


def missing(path: Path) -> None:
    del path


@pytest.mark.parametrize("bad", [text, sound_only, empty, truncated, missing])
def test_what_is_no_whole_clip_is_told_in_one_line_and_nothing_is_written(bad, tmp_path: Path) -> None:
    bad(tmp_path / "in.mp4")
    there = names(tmp_path)
    done = rsvideo("deblur", tmp_path / "in.mp4", "-o", tmp_path / "out.mp4", *GOOD)
    one_line(done, 3, "in.mp4")
    assert names(tmp_path) == there


@pytest.mark.parametrize(
    ("words", "code", "said"),
    [
        (("--exposure", "1/50", "--readout", "50ms", "--focal-px", "190"), 2, "readout"),
        (("--frames", "cold", "--readout", "20ms", "--focal-px", "190"), 2, "exposure"),
        ((*GOOD, "--range", "1:00-2:00"), 2, "range"),
        ((*GOOD, "--codec", "prores"), 2, ".mov"),
        ((*GOOD, "--codec", "h265"), 2, "h265"),
        ((*GOOD, "--transfer", "bt708"), 2, "bt709"),
        ((*GOOD, "--trajectory", "nowhere.csv"), 3, "nowhere.csv"),
    ],
)
def test_a_request_that_cannot_be_met_is_refused_before_any_work(
    source: Path, tmp_path: Path, words: tuple[str, ...], code: int, said: str
) -> None:
    done = rsvideo("deblur", source, "-o", tmp_path / "out.mp4", *words)
    one_line(done, code, said)
    assert names(tmp_path) == []


def test_a_result_that_exists_is_not_replaced_unless_asked(source: Path, tmp_path: Path) -> None:
    (tmp_path / "out.gcsv").write_text("mine")
    words = ("deblur", source, "-o", tmp_path / "out.mp4", "--method", "none")
    one_line(rsvideo(*words), 4, "out.gcsv", "--overwrite")
    assert (tmp_path / "out.gcsv").read_text() == "mine"
    assert rsvideo(*words, "--overwrite").returncode == 0


def test_a_readout_longer_than_a_frame_is_taken_if_forced(source: Path, tmp_path: Path) -> None:
    longer = ("--exposure", "1/50", "--readout", "45ms", "--focal-px", "190", *QUICK, "--range", "0-0.07")
    done = rsvideo("deblur", source, "-o", tmp_path / "out.mp4", *longer, "--force")
    assert done.returncode == 0, done.stderr


JOB = """\
defaults:
  camera: {exposure: 1/50, readout: 20ms, focal_px: 192}
  deblur: {prior: tv, quality: draft}
  encoding: {codec: ffv1}
output: {folder: restored, name: "{stem}.mkv"}
clips: ["*.mkv"]
"""


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """Two clips, one of three scenes, so that there are four chunks."""
    scenes = [Moving(frames=3, reach=10.0, scene=scene) for scene in ("camera", "page", "camera")]
    encode(tmp_path / "three scenes.mkv", [planes(r.blurred) for scene in scenes for r in scene.renderings], sound=True)
    encode(tmp_path / "one.mkv", [planes(r.blurred) for r in scenes[1].renderings])
    (tmp_path / "job.yaml").write_text(JOB)
    return tmp_path / "job.yaml"


def shown(folder: Path) -> dict[str, list[bytes]]:
    """The bytes of every restored frame."""
    clips = sorted(folder.glob("*.mkv"))
    return {path.name: [b"".join(p.tobytes() for p in x.planes) for x in decode.pictures(decode.probe(path))] for path in clips}


@pytest.mark.slow
def test_two_workers_restore_the_same_bytes_as_one(job: Path) -> None:
    done = rsvideo("run", job, "-j", 1)
    assert done.returncode == 0, done.stderr
    one = shown(job.parent / "restored")
    assert {name: len(frames) for name, frames in one.items()} == {"one.mkv": 3, "three scenes.mkv": 9}
    done = rsvideo("run", job, "-j", 2, "--set", "output.folder=other")
    assert done.returncode == 0, done.stderr
    assert shown(job.parent / "other") == one
    deblurred = rsvideo("deblur", job.parent / "one.mkv", "-o", job.parent / "deblurred.mkv", *GOOD, *QUICK)
    assert deblurred.returncode == 0, deblurred.stderr
    assert shown(job.parent)["deblurred.mkv"] == one["one.mkv"]


@pytest.mark.long
def test_a_job_killed_at_any_moment_goes_on_to_the_same_result(job: Path) -> None:
    assert rsvideo("run", job, "-j", 1, "--set", "output.folder=whole").returncode == 0
    whole, folder = shown(job.parent / "whole"), job.parent / "restored"
    for kept in (1, 2, 3):
        with under_way("run", job, "-j", 1, program=INSTALLED) as working:
            while working.poll() is None and len(list(folder.glob(".rsvideo-*/**/*.zip"))) < kept:
                time.sleep(0.02)
            assert working.poll() is None, "it was to be killed while it works"
        assert not {path.name for path in folder.glob("*.mkv")} - set(whole)
    done = rsvideo("run", job, "-j", 2)
    assert done.returncode == 0, done.stderr
    assert shown(folder) == whole
    assert names(folder) == sorted(f"{stem}{end}" for stem in ("one", "three scenes") for end in (".gcsv", ".mkv", ".rsvideo.json"))


@pytest.mark.long
def test_the_sample_clip_is_restored_by_the_example_that_ships(samples: Path, tmp_path: Path) -> None:
    done = rsvideo("run", samples.parent / "configs" / "jobs" / "one_clip.yaml", "--set", f"output.folder={tmp_path}")
    assert done.returncode == 0, done.stderr
    truth = luma(samples / "clip" / "truth.mp4")
    gained = gains(samples / "clip" / "blurred.mp4", tmp_path / "clip.mp4", truth)
    assert gained.mean() > 4, gained
    assert gained.min() > 1, gained
    assert packets(samples / "clip" / "blurred.mp4", "audio") == packets(tmp_path / "clip.mp4", "audio") != []
