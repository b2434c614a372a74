"""Each mistake ends in one clear line, the promised exit code, and nothing half-written."""

import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image

from rsvideo.gpu import device
from tests.cli.conftest import STAND_IN, Run
from tests.cli.forked import INSTALLED

GOOD = ("--exposure", "1/50", "--readout", "20ms", "--focal-px", "100")


def one_line(done: subprocess.CompletedProcess[str], code: int, *words: str) -> None:
    """The run ended with `code` and said one line that holds all `words`."""
    assert done.returncode == code, done.stderr
    assert done.stderr.startswith("rsvideo: ")
    assert done.stderr.count("\n") == 1
    assert "Traceback" not in done.stderr
    for word in words:
        assert word in done.stderr
    assert not done.stdout or done.stdout == "working\n"


def text_named_png(path: Path) -> None:
    path.write_text("this is a letter, not a picture")


def truncated(ending: str) -> Callable[[Path], None]:
    def make(path: Path) -> None:
        file = path.with_name(f"whole{ending}")
        cv2.imwrite(str(file), np.random.default_rng(0).integers(0, 256, (64, 64, 3), dtype=np.uint8))
        path.write_bytes(file.read_bytes()[:3000])

    return make


def one_pixel(path: Path) -> None:
    cv2.imwrite(str(path), np.zeros((1, 1, 3), np.uint8))


def cmyk(path: Path) -> None:
    Image.new("CMYK", (64, 64)).save(path, "JPEG")


def nan_tiff(path: Path) -> None:
    pixels = np.zeros((64, 64), np.float32)
    pixels[3, 4] = np.nan
    tifffile.imwrite(path, pixels)


def folder(path: Path) -> None:
    path.mkdir()


def raw_header_only(path: Path) -> None:
    """LibRaw itself remarks on this one."""
    tifffile.imwrite(path, np.zeros((64, 64), np.uint16), photometric="cfa", extratags=[(50706, 1, 4, (1, 4, 0, 0), True)])
    path.write_bytes(path.read_bytes()[:-4000])


def circle(path: Path) -> None:
    path.symlink_to(path.name)


def pipe(path: Path) -> None:
    os.mkfifo(path)


def nothing(path: Path) -> None:
    pass


def empty(path: Path) -> None:
    path.touch()


@pytest.mark.parametrize(
    ("name", "make", "words"),
    [
        ("absent.png", nothing, ["does not exist"]),
        ("folder.png", folder, ["no pictures"]),
        ("empty.png", empty, ["is empty"]),
        ("letter.png", text_named_png, ["must be a PNG, TIFF, JPEG or raw photograph"]),
        ("cut.png", truncated(".png"), ["is cut short"]),
        ("cut.jpg", truncated(".jpg"), ["is damaged"]),
        ("pixel.png", one_pixel, ["at least 32 x 32 px", "1 x 1"]),
        ("nan.tif", nan_tiff, ["NaN"]),
        ("inks.jpg", cmyk, ["CMYK"]),
        ("not.dng", text_named_png, ["is damaged"]),
        ("circle.png", circle, ["symbolic links"]),
        ("circle.mp4", circle, ["symbolic links"]),
        ("pipe.png", pipe, ["is not a file"]),
        ("pipe.mp4", pipe, ["is not a file"]),
        ("x" * 300 + ".png", nothing, ["name too long"]),
        ("x" * 300 + ".mp4", nothing, ["name too long"]),
        ("cut.dng", raw_header_only, ["is damaged"]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_an_input_that_is_no_photograph_is_refused_by_name(
    rsvideo: Run, tmp_path: Path, name: str, make: Callable[[Path], None], words: list[str]
) -> None:
    make(tmp_path / name)
    output = tmp_path / f"out{Path(name).suffix}" if name.endswith(".mp4") else tmp_path / "out.png"
    one_line(rsvideo("deblur", tmp_path / name, "-o", output, *GOOD), 3, name, *words)
    assert not output.exists()


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ("--exposure 0 --readout 20ms", ["exposure must lie in (0, 1] s", "got 0 s"]),
        ("--exposure 20 --readout 20ms", ["exposure must lie in (0, 1] s", "got 20 s", "milliseconds", "20ms"]),
        ("--exposure -1/50 --readout 20ms", ["exposure must not be negative", "-1/50"]),
        ("--exposure 20mm --readout 20ms", ["exposure must be a time", "20mm", "s, ms and us"]),
        ("--exposure 1/50 --readout 33", ["readout must lie in [0, 1] s", "got 33 s", "milliseconds"]),
        ("--exposure 1/50 --readout -20ms", ["readout must not be negative", "--direction bottom-to-top"]),
        ("--exposure 1/50 --row-time 0.03", ["row-time", "48 rows", "1.44 s", "is it in milliseconds"]),
        ("--exposure 1/50", ["exactly one of --readout and --row-time", "neither"]),
        ("--exposure 1/50 --readout 20ms --row-time 1us", ["exactly one of --readout and --row-time", "both"]),
        ("--readout 20ms", ["exposure must be given", "EXIF"]),
        ("--exposure 1/50 --readout 20ms --focal-px -3", ["focal-px must be a positive number", "-3"]),
        ("--exposure 1/50 --readout 20ms --focal-px 4.2", ["focal-px must be at least", "millimetres"]),
        ("--exposure 1/50 --readout 20ms --motion sideways", ["--motion", "sideways"]),
        ("--exposure 1/50 --readout 20ms --colour red", ["No such option", "--colour"]),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_a_wrong_setting_is_refused_with_its_rule_its_value_and_the_likely_slip(
    rsvideo: Run, photograph: Path, options: str, words: list[str]
) -> None:
    focal = [] if "--focal-px" in options else ["--focal-px", "100"]
    one_line(rsvideo("deblur", photograph, "-o", photograph.with_name("out.png"), *options.split(), *focal), 2, *words)
    assert not photograph.with_name("out.png").exists()


def test_no_command_at_all_is_told_where_to_look(rsvideo: Run) -> None:
    one_line(rsvideo(), 2, "Missing command", "--help")


def test_rotation_asks_for_the_focal_length(rsvideo: Run, photograph: Path) -> None:
    done = rsvideo("deblur", photograph, "-o", photograph.with_name("out.png"), "--exposure", "1/50", "--readout", "20ms")
    one_line(done, 2, "focal-px must be given", "35 mm equivalent", "--motion shift")


@pytest.mark.skipif(device.unavailable() is None, reason="there is a GPU")
def test_a_gpu_that_is_not_there_is_refused(rsvideo: Run, photograph: Path) -> None:
    done = rsvideo("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD, "--device", "cuda")
    one_line(done, 2, "the device cuda cannot be used: ", "--device cpu does without")


@pytest.mark.parametrize(
    ("output", "words"),
    [
        ("out.bmp", ["must end in one of", ".png"]),
        ("nowhere/out.png", ["nowhere", "must exist"]),
        ("in.png", ["OUTPUT must not be INPUT"]),
    ],
)
def test_an_output_that_cannot_be_is_refused(rsvideo: Run, photograph: Path, output: str, words: list[str]) -> None:
    before = photograph.read_bytes()
    one_line(rsvideo("deblur", photograph, "-o", photograph.parent / output, *GOOD, "--overwrite"), 2, *words)
    assert photograph.read_bytes() == before


@pytest.mark.skipif(not Path("/proc").is_dir(), reason="no folder that even root cannot write into")
def test_a_folder_that_cannot_be_written_is_refused_before_the_work(rsvideo: Run, photograph: Path) -> None:
    one_line(rsvideo("deblur", photograph, "-o", "/proc/out.png", *GOOD), 2, "/proc", "must be writable")


@pytest.mark.parametrize("name", ["out.png", "out.rsvideo.json"])
def test_an_output_that_exists_is_kept(rsvideo: Run, photograph: Path, name: str) -> None:
    there = photograph.with_name(name)
    there.write_text("mine")
    one_line(rsvideo("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD), 4, name, "--overwrite")
    assert there.read_text() == "mine"


def files_of_at_most_2000_bytes() -> None:
    resource.setrlimit(resource.RLIMIT_FSIZE, (2000, 2000))


def test_a_full_disk_leaves_nothing_behind(rsvideo_at_once: Run, photograph: Path) -> None:
    output = photograph.with_name("out.png")
    one_line(
        rsvideo_at_once("deblur", photograph, "-o", output, *GOOD, preexec_fn=files_of_at_most_2000_bytes), 1, "out.png", "could not be"
    )
    assert [path.name for path in photograph.parent.iterdir()] == ["in.png"]


def test_a_full_disk_keeps_the_older_output(rsvideo_at_once: Run, photograph: Path) -> None:
    output = photograph.with_name("out.png")
    output.write_text("older")
    done = rsvideo_at_once("deblur", photograph, "-o", output, *GOOD, "--overwrite", preexec_fn=files_of_at_most_2000_bytes)
    one_line(done, 1, "out.png")
    assert output.read_text() == "older"


def test_a_file_system_that_is_full_leaves_nothing_behind(rsvideo_at_once: Run, photograph: Path, tmp_path: Path) -> None:
    small = tmp_path / "small"
    small.mkdir()
    if (
        os.getuid()
        or subprocess.run(["mount", "-t", "tmpfs", "-o", "size=8k", "tmpfs", small], check=False, capture_output=True).returncode
    ):
        pytest.skip("a small file system can be mounted by root only")
    try:
        one_line(rsvideo_at_once("deblur", photograph, "-o", small / "out.png", *GOOD), 1, "No space left")
        assert not list(small.iterdir())
    finally:
        subprocess.run(["umount", small], check=True)


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143), (signal.SIGHUP, 129)])
def test_an_interrupt_during_work_leaves_nothing_behind(photograph: Path, sent: signal.Signals, code: int) -> None:
    words = [sys.executable, STAND_IN, "deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD]
    environment = os.environ | {"DAWDLE": "60"}
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, env=environment) as working:
        assert working.stdout is not None
        assert working.stdout.readline() == "working\n"
        working.send_signal(sent)
        _, told = working.communicate(timeout=20)
    assert (working.returncode, told) == (code, f"rsvideo: stopped by {sent.name}; nothing was written\n")
    assert [path.name for path in photograph.parent.iterdir()] == ["in.png"]


@pytest.mark.parametrize("level", [0, 255], ids=["black", "white"])
def test_a_picture_without_texture_is_left_as_it_was(rsvideo: Run, tmp_path: Path, level: int) -> None:
    cv2.imwrite(str(tmp_path / "in.png"), np.full((64, 64, 3), level, np.uint8))
    one_line(rsvideo("deblur", tmp_path / "in.png", "-o", tmp_path / "out.png", *GOOD), 0, "no texture", "out.png")
    assert (tmp_path / "out.png").read_bytes() == (tmp_path / "in.png").read_bytes()


def test_a_trajectory_that_leaves_out_part_of_the_frame_is_refused(rsvideo: Run, photograph: Path) -> None:
    motion = photograph.with_name("motion.csv")
    motion.write_text("t_s,pitch_rad,yaw_rad,roll_rad\n0,0,0,0\n0.02,0,0,0\n")
    done = rsvideo("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD, "--trajectory", motion)
    one_line(done, 2, "motion.csv", "0 to 0.04 s", "0 to 0.02 s")


def test_a_trajectory_file_that_is_absent_is_named(rsvideo: Run, photograph: Path) -> None:
    done = rsvideo("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD, "--trajectory", "absent.csv")
    one_line(done, 3, "absent.csv", "does not exist")


def test_a_sidecar_that_is_none_cannot_be_plotted(rsvideo: Run, photograph: Path) -> None:
    one_line(rsvideo("plot", photograph, "-o", photograph.with_name("fig.png")), 3, "in.png", "sidecar")


def absurd(path: Path) -> None:
    record = json.loads(path.read_text())
    record["frames"][0]["trajectory"]["x_px"][3] = 1e300
    path.write_text(json.dumps(record))


def test_a_sidecar_with_absurd_numbers_is_refused_with_file_and_key(rsvideo: Run, photograph: Path) -> None:
    output, record = photograph.with_name("out.png"), photograph.with_name("out.rsvideo.json")
    assert rsvideo("deblur", photograph, "-o", output, *GOOD, "--method", "none").returncode == 0
    absurd(record)
    words = ("out.rsvideo.json", "frames.0.trajectory.x_px.3", "is it a sidecar")
    one_line(rsvideo("plot", record, "-o", photograph.with_name("fig.png")), 3, *words)
    done = rsvideo("deblur", photograph, "-o", photograph.with_name("again.png"), *GOOD, "--trajectory", record)
    one_line(done, 3, "out.rsvideo.json", "trajectory.x_px.3")


def test_a_motion_out_of_the_frame_is_refused_before_the_work(rsvideo: Run, photograph: Path) -> None:
    motion = photograph.with_name("motion.csv")
    lines = [f"{t:.3f},{2 * np.sin(40 * t):.6f},0,0" for t in np.arange(0, 0.05, 1e-3)]
    motion.write_text("\n".join(["t_s,pitch_rad,yaw_rad,roll_rad", *lines]))
    done = rsvideo("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD, "--trajectory", motion)
    one_line(done, 3, "motion.csv", "must keep in view", "64 x 48", "degrees")


def test_what_needs_more_memory_than_the_process_may_have_is_refused_with_both_figures(rsvideo: Run, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "in.png"), np.zeros((12_000, 12_000), np.uint8))

    def little_memory() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))

    done = rsvideo("deblur", tmp_path / "in.png", "-o", tmp_path / "out.png", *GOOD[:-1], "9000", preexec_fn=little_memory)
    one_line(done, 3, "in.png", "needs about 4.3 GB of memory", "12000 x 12000")
    assert [path.name for path in tmp_path.iterdir()] == ["in.png"]


@pytest.mark.parametrize("output", ["out.mp4", "out.png"])
def test_control_characters_of_names_do_not_reach_the_terminal(rsvideo: Run, tmp_path: Path, output: str) -> None:
    path = tmp_path / ("a\x1b[31mred\x9b\u202e\n" + Path(output).suffix)
    path.write_text("no picture")
    done = rsvideo("deblur", path, "-o", tmp_path / output, *GOOD)
    one_line(done, 3, "a\\x1b[31mred\\u009b\\u202e")
    job = tmp_path / "job.yaml"
    job.write_text(f"clips: ['a*{path.suffix}']\ndefaults: {{camera: {{exposure: 1/50, readout: 20ms, focal_px: 100}}}}\n")
    for how in ("none", "jsonl"):
        told = rsvideo("run", job, "--progress", how)
        assert told.returncode == 3
        assert (told.stdout + told.stderr).replace("\n", "").isprintable()
        assert "x1b[31mred" in told.stderr


def test_streams_that_are_closed_stop_nothing_and_no_file_gets_their_numbers(photograph: Path) -> None:
    output = photograph.with_name("out.png")
    words = ["deblur", photograph, "-o", output, *GOOD, "--method", "none"]
    done = subprocess.run(["/bin/sh", "-c", 'exec "$@" <&- >&- 2>&-', "sh", INSTALLED, *words], check=False)
    assert done.returncode == 0
    with Image.open(output) as picture:
        picture.load()
