"""Photographs in a batch, alone and beside clips: planned, restored, resumed and reported as clips are."""

import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import cv2
import numpy as np
import pytest

from tests.cli import forked
from tests.cli.conftest import STAND_IN
from tests.cli.test_bad_input import one_line
from tests.video.clips import make

JOB = """\
defaults:
  camera: {exposure: 1/50, readout: 20ms, focal_px: 100}
  encoding: {codec: h264}
clips:
  - source: take/*
    deblur: {method: none}
  - photos/sharp.png
"""


def call(*words: object) -> subprocess.CompletedProcess[str]:
    """The command with a core that brightens photographs."""
    return forked.call(*words, program=STAND_IN)


def picture(path: Path, seed: int = 0) -> Path:
    path.parent.mkdir(exist_ok=True)
    noise = np.random.default_rng(seed).integers(0, 256, (48, 64, 3)).astype(np.uint8)
    assert cv2.imwrite(str(path), cv2.GaussianBlur(noise, (0, 0), 2))
    return path


@pytest.fixture
def job(tmp_path: Path) -> Path:
    """A clip and a photograph under one pattern, and a photograph by name."""
    picture(tmp_path / "take" / "still.png")
    make(tmp_path / "take" / "moving.mp4", frames=3)
    picture(tmp_path / "photos" / "sharp.png", seed=1)
    path = tmp_path / "job.yaml"
    path.write_text(JOB)
    return path


def test_a_pattern_may_match_photographs_and_clips(job: Path) -> None:
    done = call("run", job, "-j", 2, "--progress", "jsonl")
    assert done.returncode == 0, done.stderr
    folder = job.parent / "restored"
    assert {path.name for path in folder.iterdir()} == {
        *("moving_rsvideo.mp4", "moving_rsvideo.rsvideo.json"),
        *("still_rsvideo.png", "still_rsvideo.rsvideo.json", "sharp_rsvideo.png", "sharp_rsvideo.rsvideo.json"),
    }
    assert (folder / "still_rsvideo.png").read_bytes() == (job.parent / "take" / "still.png").read_bytes()
    before, after = (cv2.imread(str(path)) for path in (job.parent / "photos" / "sharp.png", folder / "sharp_rsvideo.png"))
    assert before is not None
    assert after is not None
    assert after.mean() > 1.2 * before.mean()
    record = json.loads((folder / "sharp_rsvideo.rsvideo.json").read_text())
    assert record["frames"][0]["timing"] == {"exposure_s": 0.02, "row_time_s": 0.02 / 48, "source": "explicit"}
    events = [json.loads(line) for line in done.stdout.splitlines()]
    assert {Path(event["output"]).name for event in events[:-1] if event["event"] == "finished"} == {
        *("moving_rsvideo.mp4", "still_rsvideo.png", "sharp_rsvideo.png")
    }
    assert any(event["event"] == "frame" and event["words"] == "half way" for event in events)
    assert [(clip["restored"], clip["left"]) for clip in events[-1]["clips"]] == [(0, 3), (0, 1), (1, 0)]


def test_a_photograph_is_restored_as_deblur_does(job: Path) -> None:
    assert call("run", job).returncode == 0
    words = ("--exposure", "1/50", "--readout", "20ms", "--focal-px", "100")
    assert call("deblur", job.parent / "photos" / "sharp.png", "-o", job.parent / "alone.png", *words).returncode == 0
    assert (job.parent / "alone.png").read_bytes() == (job.parent / "restored" / "sharp_rsvideo.png").read_bytes()
    one, other = (json.loads((job.parent / name).read_text()) for name in ("alone.rsvideo.json", "restored/sharp_rsvideo.rsvideo.json"))
    assert (one.pop("written")["sha256"]["alone.png"],) == tuple(other.pop("written")["sha256"].values())
    assert one == other


def test_the_plan_and_the_check_tell_photographs_from_clips(job: Path) -> None:
    plan = call("run", job, "--dry-run").stdout
    assert "a photograph of 64 x 48\n  exposure 20 ms, readout 20 ms top-to-bottom (explicit)" in plan
    assert "3 frames of 64 x 48" in plan
    assert "1 clip and 2 photographs" in call("validate", job).stderr


@pytest.mark.slow
def test_what_is_done_is_not_done_again(job: Path) -> None:
    picture(job.parent / "photos" / "other.png", seed=2)
    with job.open("a") as file:
        file.write("  - photos/other.png\n")
    program = [sys.executable, STAND_IN, "run", job]
    null = subprocess.DEVNULL
    with subprocess.Popen(program, stdout=null, stderr=null, env=os.environ | {"DAWDLE": "3"}, start_new_session=True) as working:
        while working.poll() is None and not (job.parent / "restored" / "sharp_rsvideo.rsvideo.json").exists():
            time.sleep(0.02)
        os.killpg(working.pid, signal.SIGKILL)
    assert not (job.parent / "restored" / "other_rsvideo.png").exists()
    done = call("run", job)
    assert done.returncode == 0, done.stderr
    assert "still_rsvideo.png: is done already" in done.stderr
    assert (job.parent / "restored" / "other_rsvideo.png").exists()


@pytest.mark.parametrize(
    ("entry", "words"),
    [
        ("{source: photos/sharp.png, input: {range: 0-1}}", "--range concerns clips"),
        ("{source: photos/sharp.png, name: '{stem}.mp4'}", "must end in one of .png"),
        ("{source: photos/sharp.png, deblur: {method: rectify}}", "method rectify concerns clips"),
    ],
)
def test_what_photographs_cannot_be_asked_is_refused_with_its_line(job: Path, entry: str, words: str) -> None:
    job.write_text(JOB.replace("- photos/sharp.png", f"- {entry}"))
    one_line(call("run", job), 2, "job.yaml:7: ", words)


def test_a_damaged_photograph_does_not_hold_up_the_others(job: Path) -> None:
    (job.parent / "take" / "still.png").write_bytes(b"no picture")
    done = call("run", job)
    assert done.returncode == 3
    assert "1 of 1 clip and 2 photographs failed" in done.stderr
    assert (job.parent / "restored" / "sharp_rsvideo.png").exists()
