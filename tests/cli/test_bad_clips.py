"""Clips that are damaged, odd or interrupted, through the installed command: one clear line, or a whole result; never half of one."""

import os
import resource
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from rsvideo.shooting.given_motion import COLUMNS
from rsvideo.video.decode import pictures, probe
from tests.cli.conftest import STAND_IN, Run
from tests.cli.test_bad_input import one_line
from tests.video import test_decode as bad_clips
from tests.video import test_sequence as bad_sequences
from tests.video.clips import make, raw

NONE = ("--method", "none")
GOOD = ("--exposure", "1/4000", "--readout", "0.4ms", "--focal-px", "70", "--prior", "tv")
CODERS = [("libx264", ".mp4"), ("libx265", ".mp4"), ("libx264", ".mkv")]


def untracked(path: Path) -> None:
    make(path, video=False)


def left(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


@pytest.mark.parametrize("share", [0.1, 0.5, 0.9, 0.999])
@pytest.mark.parametrize(("codec", "suffix"), CODERS)
def test_a_clip_cut_short_anywhere_is_refused(rsvideo: Run, tmp_path: Path, codec: str, suffix: str, share: float) -> None:
    path = make(tmp_path / f"in{suffix}", codec=codec, frames=12)
    os.truncate(path, int(share * path.stat().st_size))
    one_line(rsvideo("deblur", path, "-o", tmp_path / "out.mkv", *NONE), 3, path.name)
    assert left(tmp_path) == [path.name]


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(("codec", "suffix"), CODERS)
def test_bits_that_flipped_are_found_or_do_no_harm(rsvideo: Run, tmp_path: Path, codec: str, suffix: str, seed: int) -> None:
    path = make(tmp_path / f"in{suffix}", codec=codec, frames=12)
    data, chance = bytearray(path.read_bytes()), np.random.default_rng(seed)
    for at in chance.integers(600, len(data) - 900, 8):
        data[at] ^= 1 << chance.integers(8)
    path.write_bytes(data)
    done = rsvideo("deblur", path, "-o", tmp_path / "out.mkv", *NONE, "--codec", "ffv1")
    if done.returncode:
        one_line(done, 3, path.name)
        assert left(tmp_path) == [path.name]
    else:
        assert len(list(pictures(probe(tmp_path / "out.mkv")))) == 12


@pytest.mark.parametrize(
    "build",
    [
        untracked,
        bad_clips.without_index,
        bad_clips.longer_in_its_header,
        bad_clips.more_samples_in_its_header,
        bad_clips.two_sizes,  # which is found while it is worked on
    ],
)
def test_a_clip_that_is_not_what_it_says_is_refused(rsvideo: Run, tmp_path: Path, build: Callable[[Path], object]) -> None:
    folder = tmp_path / "clips"
    folder.mkdir()
    build(folder / "ein Clip.mp4")
    before = left(folder)
    one_line(rsvideo("deblur", folder / "ein Clip.mp4", "-o", folder / "out.mp4", *NONE), 3, "ein Clip.mp4")
    assert left(folder) == before


@pytest.mark.parametrize("build", [bad_sequences.missing, bad_sequences.changing, bad_sequences.truncated])
def test_a_faulty_sequence_is_refused(rsvideo: Run, tmp_path: Path, build: Callable[[Path], None]) -> None:
    folder = tmp_path / "a take"
    folder.mkdir()
    build(folder)
    one_line(rsvideo("deblur", folder, "-o", tmp_path / "out.mkv", *NONE, "--codec", "ffv1"), 3, "a take", ".dng")
    assert left(tmp_path) == ["a take"]


def test_a_raw_sequence_becomes_a_clip(rsvideo: Run, tmp_path: Path) -> None:
    folder = tmp_path / "a take"
    folder.mkdir()
    for number in range(3):
        raw(folder / f"A001_{number:04d}.dng", seed=number)
    done = rsvideo("deblur", folder, "-o", tmp_path / "out.mkv", *NONE, "--codec", "ffv1")
    assert done.returncode == 0, done.stderr
    written = probe(tmp_path / "out.mkv")
    assert (written.frames, written.rows, written.cols) == (3, 48, 64)


@pytest.mark.slow
@pytest.mark.parametrize(("rate", "frames"), [(24, 1), (2, 3), (1000, 3)])
def test_few_frames_and_odd_rates_are_restored(rsvideo: Run, tmp_path: Path, rate: int, frames: int) -> None:
    known = ()
    if frames > 1:  # a motion that is known, to be quick
        lines = [f"{t:.4f},0,{0.01 * np.sin(9 * t):.9f},0" for t in np.arange(0, 1.1, 1e-4)]
        (tmp_path / "motion.csv").write_text("\n".join([",".join(COLUMNS), *lines]))
        known = ("--trajectory", tmp_path / "motion.csv")
    path = make(tmp_path / "in.mov", rate=rate, frames=frames, rows=32, cols=40)
    done = rsvideo("deblur", path, "-o", tmp_path / "out.mov", *GOOD, *known)
    assert done.returncode == 0, done.stderr
    assert ", 0 failed" in done.stderr
    before, after = probe(path), probe(tmp_path / "out.mov")
    assert after.frames == frames
    assert [Fraction(int(t)) * before.time_base for t in before.times] == [Fraction(int(t)) * after.time_base for t in after.times]


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no folder that even root cannot write into")
def test_an_output_folder_that_cannot_be_written_is_refused(rsvideo: Run, tmp_path: Path) -> None:
    one_line(rsvideo("deblur", make(tmp_path / "in.mp4"), "-o", "/proc/out.mp4", *NONE), 2, "/proc", "must be writable")


def files_of_at_most_2000_bytes() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))


@pytest.mark.parametrize("name", ["out.mp4", "out.mkv"])
def test_a_full_disk_leaves_what_stood_there(rsvideo: Run, tmp_path: Path, name: str) -> None:
    path = make(tmp_path / "in.mp4")
    (tmp_path / name).write_text("older")
    done = rsvideo("deblur", path, "-o", tmp_path / name, *NONE, "--overwrite", preexec_fn=files_of_at_most_2000_bytes)
    one_line(done, 1, "could not be written")
    assert (tmp_path / name).read_text() == "older"
    assert left(tmp_path) == sorted(["in.mp4", name])


def working_on(folder: Path) -> subprocess.Popen[str]:
    """A clip being restored, as soon as it is under way; it would take minutes."""
    words = [sys.executable, STAND_IN, "deblur", make(folder / "in.mp4"), "-o", folder / "out.mp4", *GOOD]
    environment = os.environ | {"DAWDLE": "60"}
    working = subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment)
    while working.poll() is None and not list(folder.glob(".rsvideo-*/*")):
        time.sleep(0.02)
    return working


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_an_interrupt_leaves_nothing_behind(tmp_path: Path, sent: signal.Signals, code: int) -> None:
    with working_on(tmp_path) as working:
        working.send_signal(sent)
        _, told = working.communicate(timeout=60)
    assert (working.returncode, told) == (code, f"rsvideo: stopped by {sent.name}; nothing was written\n")
    assert left(tmp_path) == ["in.mp4"]


def test_what_a_kill_leaves_behind_the_next_run_clears_away(rsvideo: Run, tmp_path: Path) -> None:
    with working_on(tmp_path) as working:
        working.kill()
        working.communicate(timeout=60)
    assert len(left(tmp_path)) == 2
    assert rsvideo("deblur", tmp_path / "in.mp4", "-o", tmp_path / "out.mp4", *NONE).returncode == 0
    assert left(tmp_path) == ["in.mp4", "out.mp4", "out.rsvideo.json"]
