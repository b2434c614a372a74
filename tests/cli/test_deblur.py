"""What the command says and writes when all is well."""

import contextlib
import json
import os
import pty
import re
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from PIL import Image
from PIL.TiffImagePlugin import IFDRational

from tests.cli.conftest import STAND_IN, Run

GOOD = ("--exposure", "1/50", "--readout", "20ms", "--focal-px", "100")


def test_the_picture_and_its_sidecar_appear_side_by_side(rsvideo_at_once: Run, photograph: Path) -> None:
    done = rsvideo_at_once("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD)
    assert done.returncode == 0, done.stderr
    assert done.stderr == f"rsvideo: restored, 0.2 s: {photograph.with_name('out.png')}\n"
    assert sorted(path.name for path in photograph.parent.iterdir()) == ["in.png", "out.png", "out.rsvideo.json"]
    before, after = (cv2.imread(str(photograph.with_name(name))) for name in ("in.png", "out.png"))
    assert before is not None
    assert after is not None
    assert after.mean() > 1.2 * before.mean()
    record = json.loads(photograph.with_name("out.rsvideo.json").read_text())
    assert record["frames"][0]["timing"] == {"exposure_s": 0.02, "row_time_s": 0.02 / 48, "source": "explicit"}
    assert record["settings"]["camera"] == {"fx": 100, "fy": 100, "cx": 31.5, "cy": 23.5, "rows": 48, "cols": 64, "source": "explicit"}


def test_json_puts_the_sidecar_on_standard_output(rsvideo_at_once: Run, photograph: Path) -> None:
    done = rsvideo_at_once("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD, "--json")
    record = json.loads(done.stdout.removeprefix("working\n"))
    assert record == json.loads(photograph.with_name("out.rsvideo.json").read_text())
    assert done.stderr == ""


def test_the_sidecar_of_one_run_is_the_trajectory_of_the_next(rsvideo_at_once: Run, photograph: Path) -> None:
    motion = photograph.with_name("motion.csv")
    motion.write_text("t_s,pitch_rad,yaw_rad,roll_rad\n" + "".join(f"{t},0.01,{t * t * 30},{t}\n" for t in np.linspace(0, 0.04, 81)))
    first = rsvideo_at_once("deblur", photograph, "-o", photograph.with_name("a.png"), *GOOD, "--trajectory", motion)
    assert first.returncode == 0, first.stderr
    record = photograph.with_name("a.rsvideo.json")
    second = rsvideo_at_once("deblur", photograph, "-o", photograph.with_name("b.png"), *GOOD, "--trajectory", record)
    assert second.returncode == 0, second.stderr
    a, b = (json.loads(photograph.with_name(f"{name}.rsvideo.json").read_text())["frames"][0]["trajectory"] for name in "ab")
    assert np.ptp(a["x_px"]) == pytest.approx(100 * 30 * 0.04**2, abs=0.02)
    for axis in ("t_s", "x_px", "y_px", "roll_rad"):
        np.testing.assert_allclose(a[axis], b[axis], atol=0.02)


def test_a_profile_answers_for_lens_readout_and_tone(rsvideo_at_once: Run, photograph: Path) -> None:
    profile = photograph.with_name("mine.yaml")
    lens = "{fx: 120, fy: 121, cx: 31, cy: 24}"
    timing = "{readout_s: 0.024, direction: bottom-to-top}"
    curve = "{curve: [0, 0.25, 1]}"
    profile.write_text(f"name: Mine\nmode: {{rows: 48, cols: 64}}\nintrinsics: {lens}\ntiming: {timing}\ntone: {curve}\n")
    words = ("--exposure", "1/50", "--camera", profile, "--json")
    done = rsvideo_at_once("deblur", photograph, "-o", photograph.with_name("out.png"), *words)
    record = json.loads(done.stdout.removeprefix("working\n"))
    assert record["settings"]["camera"] == {
        "fx": 120, "fy": 121, "cx": 31, "cy": 24, "rows": 48, "cols": 64, "source": "the profile of Mine"
    }  # fmt: skip
    assert record["settings"]["direction"] == "bottom-to-top"
    assert record["settings"]["transfer"] == "measured"
    timing = record["frames"][0]["timing"]
    assert timing["row_time_s"] == pytest.approx(0.024 / 48)
    assert timing["source"] == "exposure: explicit; readout: the profile of Mine"


def test_sideways_readout_counts_columns(rsvideo_at_once: Run, photograph: Path) -> None:
    done = rsvideo_at_once("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD, "--direction", "left-to-right", "--json")
    record = json.loads(done.stdout.removeprefix("working\n"))
    assert record["frames"][0]["timing"]["row_time_s"] == 0.02 / 64
    assert record["settings"]["direction"] == "left-to-right"


def test_exposure_and_focal_length_come_from_exif_and_are_said_to(rsvideo_at_once: Run, tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[274] = 6
    exif[0x8769] = {33434: IFDRational(1, 25), 41989: 28}
    Image.fromarray(np.random.default_rng(0).integers(0, 256, (60, 80, 3), dtype=np.uint8)).save(tmp_path / "in.jpg", exif=exif)
    done = rsvideo_at_once("deblur", tmp_path / "in.jpg", "-o", tmp_path / "out.jpg", "--readout", "20ms")
    assert done.returncode == 0, done.stderr
    assert "focal length 65 px from EXIF" in done.stderr
    record = json.loads((tmp_path / "out.rsvideo.json").read_text())
    assert record["frames"][0]["timing"]["exposure_s"] == 0.04
    assert "EXIF" in record["frames"][0]["timing"]["source"]
    assert record["settings"]["camera"]["source"] == "EXIF"
    with Image.open(tmp_path / "out.jpg") as image:
        assert image.getexif()[274] == 6
        assert image.size == (80, 60)


def test_a_shift_needs_no_focal_length(rsvideo_at_once: Run, photograph: Path) -> None:
    words = ("--exposure", "1/50", "--readout", "0", "--motion", "shift", "--degree", "3", "--json")
    done = rsvideo_at_once("deblur", photograph, "-o", photograph.with_name("out.tif"), *words)
    record = json.loads(done.stdout.removeprefix("working\n"))
    assert record["settings"]["camera"]["source"] == "assumed"
    assert record["settings"]["restoration"]["motion"] == "shift"
    assert record["settings"]["restoration"]["degree"] == 3
    assert record["frames"][0]["timing"]["row_time_s"] == 0


def test_what_the_output_cannot_hold_is_noted(rsvideo_at_once: Run, tmp_path: Path) -> None:
    cv2.imwrite(str(tmp_path / "in.png"), np.random.default_rng(0).integers(0, 65536, (40, 40, 4), dtype=np.uint16))
    done = rsvideo_at_once("deblur", tmp_path / "in.png", "-o", tmp_path / "out.jpg", *GOOD)
    assert done.returncode == 0, done.stderr
    assert "note: JPEG holds no transparency" in done.stderr
    assert "note: JPEG holds 8 bits" in done.stderr


def test_a_bar_shows_on_a_terminal_and_only_there(photograph: Path) -> None:
    ours, theirs = pty.openpty()
    words = [sys.executable, STAND_IN, "deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD]
    environment = os.environ | {"TERM": "xterm", "NO_COLOR": "1", "DAWDLE": "0.3"}
    with subprocess.Popen(words, stdout=subprocess.DEVNULL, stderr=theirs, env=environment):
        os.close(theirs)
        told = b""
        with contextlib.suppress(OSError):  # how Linux says that the other end of a terminal is gone
            while more := os.read(ours, 4096):
                told += more
    os.close(ours)
    assert b"half way" in told
    assert b"50 %" in told
    assert not re.search(rb"\x1b\[[0-9;]*3[0-8]", told)  # no colour


def test_a_drawn_sidecar_is_a_figure(rsvideo: Run, rsvideo_at_once: Run, photograph: Path) -> None:
    rsvideo_at_once("deblur", photograph, "-o", photograph.with_name("out.png"), *GOOD)
    figure = photograph.with_name("fig.png")
    done = rsvideo("plot", photograph.with_name("out.rsvideo.json"), "-o", figure)
    assert done.returncode == 0, done.stderr
    with Image.open(figure) as image:
        assert min(image.size) > 500
    assert rsvideo("plot", photograph.with_name("out.rsvideo.json"), "-o", figure).returncode == 4
    assert rsvideo("plot", photograph.with_name("out.rsvideo.json"), "-o", photograph.with_name("fig.bmp")).returncode == 2


def test_help_and_version_answer_without_loading_the_libraries(rsvideo: Run) -> None:
    assert rsvideo("--version").stdout.startswith("rsvideo ")
    for words in (["--help"], ["deblur", "--help"]):
        done = rsvideo(*words)
        assert done.returncode == 0
        assert "Usage:" in done.stdout
    code = "import sys, rsvideo.cli; print([m for m in ('numpy', 'scipy', 'numba', 'cv2', 'matplotlib', 'pydantic') if m in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.slow
def test_an_unexpected_failure_shows_no_traceback_unless_asked(tmp_path: Path, photograph: Path) -> None:
    code = (
        "from rsvideo.restoration import single_frame\n"
        "def restore(*_, **__): raise KeyError('inside')\n"
        "single_frame.restore = restore\n"
        "from rsvideo.cli import main\n"
        "main()\n"
    )
    words = [sys.executable, "-c", code, "deblur", photograph, "-o", tmp_path / "out.png", *GOOD]
    done = subprocess.run(words, capture_output=True, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr == "rsvideo: failed while working: KeyError: 'inside' (RSVIDEO_DEBUG=1 shows where)\n"
    done = subprocess.run(words, capture_output=True, text=True, check=False, env={"RSVIDEO_DEBUG": "1"})
    assert done.returncode == 1
    assert "Traceback" in done.stderr


def test_a_thread_in_opencv_does_not_abort_the_end() -> None:
    code = (
        "import sys, threading, time, cv2, numpy as np\n"
        "def work(pixels):\n"
        "    while True: cv2.GaussianBlur(pixels, (31, 31), 3)\n"
        "threading.Thread(target=work, args=(np.ones((300, 300), np.float32),), daemon=True).start()\n"
        "time.sleep(0.2)\n"
        "from rsvideo.cli import main\n"
        "sys.argv = ['rsvideo', 'absent']\n"
        "main()\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "rsvideo: No such command 'absent'. (rsvideo --help lists what there is)\n")


def test_standard_output_that_takes_nothing_is_named() -> None:
    words = [sys.executable, "-c", "from rsvideo.cli import main; main()", "--version"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(words, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert (done.returncode, done.stderr) == (1, "rsvideo: standard output could not be written: No space left on device\n")
