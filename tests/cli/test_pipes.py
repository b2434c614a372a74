"""`-` as INPUT and OUTPUT: FFmpeg on either side of the installed command, and what cannot be."""

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from rsvideo.video import decode
from tests.cli.conftest import STAND_IN, Run
from tests.cli.forked import INSTALLED, call
from tests.cli.test_bad_input import one_line
from tests.pipeline.moving import Moving
from tests.video.clips import make

CLIP = Moving(frames=3)
GOOD = ("--exposure", "1/50", "--readout", "20ms", "--focal-px", str(CLIP.lens.fx), "--force", "--prior", "tv", "--quality", "draft")
NONE = ("--method", "none")
FFMPEG = (imageio_ffmpeg.get_ffmpeg_exe(), "-v", "error", "-nostdin")
HEADER = b"YUV4MPEG2 W64 H48 F24:1 Cmono\n"
FRAME = b"FRAME\n" + bytes(64 * 48)


def through(*programs: tuple[object, ...]) -> None:
    """Programs that a shell lays in a row; all of them end well."""
    line = " | ".join(shlex.join(map(str, words)) for words in programs)
    done = subprocess.run(["bash", "-o", "pipefail", "-c", line], capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr


def planes(path: Path) -> list[np.ndarray]:
    return [plane for picture in decode.pictures(decode.probe(path)) for plane in picture.planes]


@pytest.mark.slow
@pytest.mark.parametrize("bare", [False, True])
def test_through_pipes_a_clip_gets_the_pixels_that_it_gets_in_files(tmp_path: Path, bare: bool) -> None:
    source, files, piped = CLIP.clip(tmp_path / "in.mp4"), tmp_path / "files.mkv", tmp_path / "piped.mkv"
    how = NONE if bare else (*GOOD, "--trajectory", CLIP.motion(tmp_path / "motion.csv"))
    done = call("deblur", source, "-o", files, *how, "--codec", "ffv1")
    assert done.returncode == 0, done.stderr
    kind = ("-f", "rawvideo") if bare else ("-f", "yuv4mpegpipe")
    size = ("--format", "rawvideo", "--size", "160x96", "--rate", 24, "--pixel-format", "yuv420p") if bare else ()
    back = (*kind, "-s", "160x96", "-r", "24", "-pix_fmt", "yuv420p") if bare else kind
    through(
        (*FFMPEG, "-i", source, *kind, "-"),
        (INSTALLED, "deblur", "-", "-o", "-", *how, *size, "--matrix", "bt709"),
        (*FFMPEG, *back, "-i", "-", "-c:v", "ffv1", piped),
    )
    wanted, found = planes(files), planes(piped)
    assert len(wanted) == len(found) == 9
    assert bare or any((a != b).any() for a, b in zip(found, planes(source), strict=True))
    for one, other in zip(wanted, found, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_pipe_becomes_a_file_and_a_track(tmp_path: Path) -> None:
    (tmp_path / "in.y4m").write_bytes(HEADER + 3 * FRAME)
    done = call("deblur", "-", "-o", tmp_path / "out.mp4", *NONE, stdin=tmp_path / "in.y4m")
    assert done.returncode == 0, done.stderr
    assert "assumed is the matrix bt601 (--matrix states it) and the curve bt709 (--transfer states it)" in done.stderr
    assert (decode.probe(tmp_path / "out.mp4").frames, decode.probe(tmp_path / "out.mp4").codec) == (3, "h264")
    assert '"input":"-"' in (tmp_path / "out.rsvideo.json").read_text()
    done = call("track", "-", "-o", tmp_path / "a.json", "--exposure", "1/50", "--readout", "0", stdin=tmp_path / "in.y4m")
    assert done.returncode == 0, done.stderr


def test_what_a_pipe_does_not_carry_is_said_before_the_work(tmp_path: Path) -> None:
    source = make(tmp_path / "in.mp4", rotation=90, sound=True)
    done = subprocess.run([INSTALLED, "deblur", source, "-o", "-", *NONE], capture_output=True, timeout=60, check=False)
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith(b"YUV4MPEG2 W64 H48 F24:1 Ip A1:1 C420mpeg2 XCOLORRANGE=LIMITED\nFRAME\n")
    assert len(done.stdout) == 62 + 8 * (6 + 64 * 48 * 3 // 2)
    assert b"lost are the sidecar, the gyroscope's log, colour tags, rotation, sound; rsvideo track" in done.stderr
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.mp4"]


def test_a_reader_that_goes_ends_the_run(tmp_path: Path) -> None:
    source = make(tmp_path / "in.mp4", frames=60)  # more than a pipe holds
    words = [INSTALLED, "deblur", source, "-o", "-", *NONE]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, env=os.environ | {"TMPDIR": str(tmp_path)}) as working:
        assert working.stdout
        assert working.stderr
        working.stdout.read(5000)
        working.stdout.close()
        told = working.stderr.read().decode().splitlines()
    assert working.returncode == 128 + signal.SIGPIPE, told
    assert told[-1].startswith("rsvideo: the reader of standard output has gone: ")
    assert told[-1].endswith(" of 60 frames were written")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.mp4"]


def test_a_signal_ends_the_reading_and_clears_its_file_away(tmp_path: Path) -> None:
    (tmp_path / "temporary").mkdir()
    words = [sys.executable, STAND_IN, "deblur", "-", "-o", tmp_path / "out.mkv", *NONE]
    pipes = {"stdin": subprocess.PIPE, "stderr": subprocess.PIPE, "env": os.environ | {"TMPDIR": str(tmp_path / "temporary")}}
    with subprocess.Popen(words, **pipes) as working:
        assert working.stdin
        working.stdin.write(HEADER + 3 * FRAME)
        working.stdin.flush()
        while working.poll() is None and not list((tmp_path / "temporary").glob(".rsvideo-*/pictures")):
            time.sleep(0.02)
        working.send_signal(signal.SIGTERM)
        assert working.wait(60) == 128 + signal.SIGTERM
        assert working.stderr
        assert working.stderr.read() == b"rsvideo: stopped by SIGTERM; nothing was written\n"
    assert list((tmp_path / "temporary").iterdir()) == []


@pytest.mark.parametrize(
    ("data", "words", "code", "line"),
    [
        (b"", (), 3, "standard input is empty"),
        (HEADER + FRAME + FRAME[:100], (), 3, "standard input is cut short: picture 1 has 94 of 3072 bytes"),
        (HEADER.replace(b"W64", b"W16") + FRAME[: 6 + 16 * 48], (), 3, "at least 32 x 32 px, it is 16 x 48"),
        (HEADER + 3 * FRAME, ("--rate", "25"), 2, "--rate is 25, standard input states 24"),
        (HEADER + 3 * FRAME, ("--frames", "cold", "--method", "rsvideo"), 2, "exposure must be given, the clip does not say it"),
        (HEADER + 3 * FRAME, ("--gyro", "none.gcsv", "--method", "gyro", "--exposure", "1/50", "--readout", "0"), 3, "none.gcsv"),
    ],
)
def test_a_pipe_that_cannot_be_restored_is_refused(tmp_path: Path, data: bytes, words: tuple[str, ...], code: int, line: str) -> None:
    (tmp_path / "in.y4m").write_bytes(data)
    one_line(call("deblur", "-", "-o", tmp_path / "out.mkv", *NONE, *words, stdin=tmp_path / "in.y4m"), code, line)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["in.y4m"]


@pytest.mark.parametrize(
    ("source", "output", "words", "line"),
    [
        ("in.png", "-", (), "in.png is taken for a photograph, which is written to a file"),
        ("in.png", "out.png", ("--matrix", "bt709"), "--matrix concerns clips"),
        ("in.mp4", "out.mp4", ("--format", "rawvideo"), "--format concerns pipes, neither INPUT nor OUTPUT is -"),
        ("in.mp4", "-", ("--matrix", "bt709"), "--matrix concerns a pipe as INPUT"),
        ("in.mp4", "-", ("--codec", "hevc"), "--codec concerns files, OUTPUT - carries y4m"),
        ("in.mp4", "-", ("--path", "smooth"), "--path smooth must be written to a file"),
        ("in.mp4", "-", ("--json",), "--json prints on standard output"),
        ("in.mp4", "-", ("--pixel-format", "gbrp"), "y4m must be given a layout that it holds"),
        ("-", "out.mkv", ("--size", "64x48"), "--size concerns --format rawvideo"),
        ("-", "out.mkv", ("--format", "rawvideo"), "--size and --rate and --pixel-format must be given with --format rawvideo"),
        ("-", "out.mkv", ("--format", "rawvideo", "--size", "64", "--rate", "24"), "size must read like 1920x1080"),
        ("-", "out.mkv", ("--format", "rawvideo", "--size", "99999x99999", "--rate", "24"), "at most 100 Mpx"),
        ("-", "out.mkv", ("--format", "rawvideo", "--size", "64x48", "--rate", "24", "--pixel-format", "nv12"), "must be planar"),
        ("-", "no/out.mkv", (), "the folder"),
        ("-", "out.mkv", ("--method", "vidstab"), "needs a clip in a file"),
    ],
)
def test_what_cannot_be_meant_of_a_pipe_is_refused(
    rsvideo: Run, photograph: Path, tmp_path: Path, source: str, output: str, words: tuple[str, ...], line: str
) -> None:
    make(tmp_path / "in.mp4", frames=2)
    given = [name if name == "-" else photograph.parent / name for name in (source, output)]
    one_line(rsvideo("deblur", given[0], "-o", given[1], *words), 2, line)
