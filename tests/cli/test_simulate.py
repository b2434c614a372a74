"""`rsvideo simulate`, as a user runs it."""

import json
import re

import imageio.v3 as iio
import numpy as np
import pytest
import typer

from rsvideo.cli import exit_codes
from rsvideo.cli.options import RequestCommand
from rsvideo.cli.simulate import simulate
from tests.cli.forked import call

VERB = typer.Typer()
VERB.command(cls=RequestCommand)(simulate)
TIMING = ["--exposure", "1/50", "--readout", "20ms", "--focal-px", "300"]
LOG = "\n".join(f"{k * 5_000_000} 0.1 0.5 -0.3" for k in range(100))


def run(*words):
    done = call("simulate", *words)
    assert not done.stdout
    assert "Traceback" not in done.stderr
    return done


def refused(code, *words):
    """The line that the front door tells, without a second process."""
    with pytest.raises(Exception) as caught:  # noqa: PT011 # which one is between the verb and the front door
        VERB([*map(str, words)], standalone_mode=False)
    told, line = exit_codes.code_and_line(caught.value)
    assert told == code, line
    assert "Traceback" not in line
    return line


@pytest.fixture(scope="module")
def photo(tmp_path_factory):
    path = tmp_path_factory.mktemp("photo") / "sharp.png"
    iio.imwrite(path, np.random.default_rng(0).integers(0, 256, (100, 140, 3), dtype=np.uint8))
    return path


@pytest.fixture(scope="module")
def rendered(photo, tmp_path_factory):
    folder = tmp_path_factory.mktemp("rendered")
    done = run(photo, "-o", folder / "blurred.png", *TIMING, "--shake", "--seed", 2, "--blur-px", 6)
    assert done.returncode == 0, done.stderr
    return folder


def test_it_writes_the_frame_the_truth_the_motion_and_the_case(rendered):
    assert sorted(path.name for path in rendered.iterdir()) == ["blurred.png", "case.json", "motion.csv", "truth.png"]
    case = json.loads((rendered / "case.json").read_text())
    blurred, truth = iio.imread(rendered / "blurred.png"), iio.imread(rendered / "truth.png")
    assert blurred.shape == truth.shape == (case["rows"], case["cols"], 3)
    assert blurred.dtype == np.uint8
    assert case["exposure_s"] == 0.02
    assert case["readout_s"] == pytest.approx(0.02)
    assert case["blur_px"] == pytest.approx(6)
    assert case["roll"] is True
    assert np.std(blurred) < 0.7 * np.std(truth)


def test_the_truth_is_the_middle_of_the_photograph(photo, rendered):
    truth, sharp = iio.imread(rendered / "truth.png"), iio.imread(photo)
    top, left = (100 - truth.shape[0]) // 2, (140 - truth.shape[1]) // 2
    middle = sharp[top : top + truth.shape[0], left : left + truth.shape[1]]
    assert np.abs(truth.astype(int) - middle).max() <= 1


def test_the_motion_covers_the_interval_and_is_zero_at_its_middle(rendered):
    motion = np.loadtxt(rendered / "motion.csv", delimiter=",", skiprows=1)
    assert motion[0, 0] == 0
    assert motion[-1, 0] == pytest.approx(0.04)
    np.testing.assert_allclose(motion[len(motion) // 2, 1:], 0, atol=1e-9)
    assert np.ptp(motion[:, 1:], axis=0).all()


def test_a_seed_repeats_the_frame_and_another_does_not(photo, rendered, tmp_path):
    for seed in (2, 3):
        (tmp_path / str(seed)).mkdir()
        run(photo, "-o", tmp_path / str(seed) / "blurred.png", *TIMING, "--shake", "--seed", seed, "--blur-px", 6)
    for name in ("blurred.png", "motion.csv"):
        assert (tmp_path / "2" / name).read_bytes() == (rendered / name).read_bytes()
        assert (tmp_path / "3" / name).read_bytes() != (rendered / name).read_bytes()


def test_another_seed_gives_other_noise_on_the_same_motion(photo, tmp_path):
    for seed in ("2", "3"):
        (tmp_path / seed).mkdir()
        VERB([str(photo), "-o", str(tmp_path / seed / "b.png"), *TIMING, "--polynomial", "x:0,3", "--seed", seed], standalone_mode=False)
    assert (tmp_path / "2" / "motion.csv").read_bytes() == (tmp_path / "3" / "motion.csv").read_bytes()
    assert (tmp_path / "2" / "b.png").read_bytes() != (tmp_path / "3" / "b.png").read_bytes()


def test_a_gyro_log_gives_the_motion_it_recorded(photo, tmp_path):
    log = tmp_path / "gyro.txt"
    log.write_text(LOG)
    words = [photo, "-o", tmp_path / "b.png", "--exposure", "10ms", "--row-time", "100us", "--focal-px", 300]
    done = run(
        *words, "--gyro", log, "--start", 0.2, "--gyro-axes", "YxZ", "--motion", "shift", "--truth", tmp_path / "t.tif", "--bits", 16
    )
    assert done.returncode == 0, done.stderr
    motion = np.loadtxt(tmp_path / "motion.csv", delimiter=",", skiprows=1)
    rates = (motion[-1, 1:] - motion[0, 1:]) / (motion[-1, 0] - motion[0, 0])
    np.testing.assert_allclose(rates, [0.5, -0.1, 0], atol=2e-3)
    assert iio.imread(tmp_path / "t.tif").dtype == np.uint16
    assert json.loads((tmp_path / "case.json").read_text())["roll"] is False


@pytest.mark.parametrize("as_file", [False, True])
def test_a_polynomial_moves_as_written(photo, tmp_path, as_file):
    terms = "x:0,6,-3;roll:0,0.01"
    if as_file:
        (tmp_path / "p.yaml").write_text("x: [0, 6, -3]\nroll: [0, 0.01]\n")
        terms = str(tmp_path / "p.yaml")
    done = run(photo, "-o", tmp_path / "b.png", *TIMING, "--polynomial", terms, "--direction", "left-to-right", "--size", "64x48")
    assert done.returncode == 0, done.stderr
    motion = np.loadtxt(tmp_path / "motion.csv", delimiter=",", skiprows=1)
    u = motion[:, 0] / motion[-1, 0]
    np.testing.assert_allclose(motion[:, 2] * 300, 6 * u - 3 * u**2 - 2.25, atol=1e-6)
    np.testing.assert_allclose(motion[:, 3], 0.01 * (u - 0.5), atol=1e-9)
    np.testing.assert_allclose(motion[:, 1], 0, atol=1e-9)
    assert iio.imread(tmp_path / "b.png").shape == (48, 64, 3)
    assert json.loads((tmp_path / "case.json").read_text())["row_time_s"] == pytest.approx(0.02 / 64)


PROFILE = """\
name: Wide
mode: {rows: 120, cols: 160}
intrinsics:
  {fx: 100, fy: 100, cx: 80, cy: 59, distortion: {model: brown-conrady, coefficients: [-0.3, 0.12, 0, 0]}}
timing: {readout_s: 0.02, direction: bottom-to-top}
noise: {read: 0.002, shot: 1e-5}
"""


def test_a_profile_is_the_camera(photo, tmp_path):
    (tmp_path / "wide.yaml").write_text(PROFILE)
    words = [photo, "-o", tmp_path / "b.png", "--exposure", "1/50", "--polynomial", "x:0,6;roll:0,0.05", "--camera", tmp_path / "wide.yaml"]
    VERB([*map(str, words)], standalone_mode=False)
    case = json.loads((tmp_path / "case.json").read_text())
    assert (case["rows"] * 160) == pytest.approx(case["cols"] * 120, abs=120)
    assert case["focal_px"] == pytest.approx(100 * case["cols"] / 160)
    assert case["distortion"] == {"model": "brown-conrady", "coefficients": [-0.3, 0.12, 0, 0]}
    assert case["noise"] == {"read": 0.002, "shot": 1e-5}
    assert "noise_sigma_linear" not in case
    assert (case["readout_s"], case["direction"]) == (pytest.approx(0.02), "bottom-to-top")
    VERB([*map(str, words), "--overwrite", "--noise", "0.01", "--focal-px", "120", "--readout", "0"], standalone_mode=False)
    case = json.loads((tmp_path / "case.json").read_text())
    assert "distortion" not in case
    assert (case["focal_px"], case["noise_sigma_linear"], case["readout_s"]) == (120, 0.01, 0)


def test_a_profile_that_has_no_lens_needs_a_focal_length(photo, tmp_path):
    (tmp_path / "wide.yaml").write_text("name: Wide\nmode: {rows: 120, cols: 160}\n")
    line = refused(2, photo, "-o", tmp_path / "b.png", *TIMING[:4], "--shake", "--camera", tmp_path / "wide.yaml")
    assert "focal-px must be given to simulate, the profile of Wide has no intrinsics" in line


@pytest.mark.slow
def test_a_distorted_frame_is_restored_better_by_its_profile_than_without_its_distortion(tmp_path, samples):
    sharp = iio.imread(samples / "astronaut" / "truth.png")[60:260, 100:360]
    iio.imwrite(tmp_path / "sharp.png", sharp)
    (tmp_path / "bent.yaml").write_text(PROFILE)
    (tmp_path / "plain.yaml").write_text(re.sub(r", distortion: {.*?}", "", PROFILE))
    words = [tmp_path / "sharp.png", "-o", tmp_path / "blurred.png", "--exposure", "1/50", "--camera", tmp_path / "bent.yaml"]
    VERB([*map(str, words), "--polynomial", "x:0,9,-3;y:0,-6;roll:0,0.08", "--blur-px", "7"], standalone_mode=False)
    truth = iio.imread(tmp_path / "truth.png")[10:-10, 10:-10] / 255
    left = {}
    for name in ("bent", "plain"):
        words = [
            "deblur",
            tmp_path / "blurred.png",
            "-o",
            tmp_path / f"{name}.png",
            "--exposure",
            "1/50",
            "--camera",
            tmp_path / f"{name}.yaml",
        ]
        words += ["--trajectory", tmp_path / "motion.csv", "--prior", "tv"]
        done = call(*words)
        assert done.returncode == 0, done.stderr
        left[name] = np.mean((iio.imread(tmp_path / f"{name}.png")[10:-10, 10:-10] / 255 - truth) ** 2)
        camera = json.loads((tmp_path / f"{name}.rsvideo.json").read_text())["settings"]["camera"]
        assert camera["noise"] == {"read": 0.002, "shot": 1e-5}
        assert ("distortion" in camera) == (name == "bent")
    assert left["plain"] > 1.5 * left["bent"]  # 1.8 dB


def test_a_refusal_is_one_line_on_stderr_and_an_exit_code(photo, tmp_path):
    done = run(photo, "-o", tmp_path / "b.png", "--exposure", "20", "--readout", "20ms", "--focal-px", 300, "--shake")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert "milliseconds" in done.stderr
    assert not list(tmp_path.iterdir())


def test_an_existing_file_is_kept_unless_overwrite_is_given(photo, tmp_path):
    for name in ("b.png", "truth.png", "motion.csv", "case.json"):
        (tmp_path / name).write_bytes(b"mine")
        line = refused(4, photo, "-o", tmp_path / "b.png", *TIMING, "--shake")
        assert name in line
        assert "--overwrite" in line
        assert (tmp_path / name).read_bytes() == b"mine"
        (tmp_path / name).unlink()
    (tmp_path / "case.json").write_bytes(b"mine")
    assert run(photo, "-o", tmp_path / "b.png", *TIMING, "--shake", "--overwrite").returncode == 0
    assert (tmp_path / "case.json").read_bytes() != b"mine"


@pytest.mark.parametrize(
    ("words", "slip"),
    [
        ([], "one of"),
        (["--shake", "--polynomial", "x:0,1"], "--polynomial and --shake"),
        (["--polynomial", "x=3"], "must read like"),
        (["--polynomial", ""], "got nothing"),
        (["--polynomial", "x:0,nan"], "finite"),
        (["--polynomial", "z:0,1"], "axes"),
        (["--shake", "--blur-px", "-3"], "blur"),
        (["--shake", "--blur-px", "nan"], "blur"),
        (["--shake", "--blur-px", "400"], "larger than"),
        (["--shake", "--noise", "3"], "8-bit"),
        (["--shake", "--gain", "0"], "gain"),
        (["--shake", "--size", "10by20"], "1920x1080"),
        (["--shake", "--size", "139x99", "--blur-px", "9"], "must hold"),
        (["--shake", "--size", "2000x1000"], "must hold"),
        (["--shake", "--size", "4x4"], "16 px"),
        (["--shake", "--row-time", "30us"], "both"),
        (["--shake", "--truth", "OUT/b.png"], "four names"),
        (["--shake", "--truth", "nowhere/truth.png"], "folder"),
        (["--shake", "--truth", "OUT/truth.gif"], "ending"),
    ],
)
def test_a_contradiction_is_told_in_one_line(photo, tmp_path, words, slip):
    line = refused(2, photo, "-o", tmp_path / "b.png", *TIMING, *(word.replace("OUT", str(tmp_path)) for word in words))
    assert slip in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("name", "value", "slip"),
    [
        ("exposure", "20", "milliseconds"),
        ("exposure", "0", "exposure"),
        ("exposure", "-1ms", "negative"),
        ("exposure", "soon", "1/50"),
        ("readout", "20", "milliseconds"),
        ("readout", "nan", "1/50"),
        ("focal-px", "0.05", "millimetres"),
        ("focal-px", "nan", "focal"),
        ("focal-px", "-300", "focal"),
    ],
)
def test_an_absurd_camera_is_told_in_one_line(photo, tmp_path, name, value, slip):
    timing = {"--exposure": "1/50", "--readout": "20ms", "--focal-px": "300"} | {f"--{name}": value}
    words = [word for pair in timing.items() for word in pair]
    assert slip in refused(2, photo, "-o", tmp_path / "b.png", *words, "--shake")


@pytest.mark.parametrize("name", ["exposure", "readout", "focal-px"])
def test_what_nothing_states_of_the_camera_is_asked_for_by_name(photo, tmp_path, name):
    timing = {"--exposure": "1/50", "--readout": "20ms", "--focal-px": "300"}
    del timing[f"--{name}"]
    words = [word for pair in timing.items() for word in pair]
    assert f"{name} must be given to simulate" in refused(2, photo, "-o", tmp_path / "b.png", *words, "--shake")


@pytest.mark.parametrize(
    ("log", "slip"), [("hello world", "line 1"), ("", "empty"), ("0 0 0 0\n5000000 200 0 0", "degrees"), (None, "exist")]
)
def test_a_log_that_is_none_is_unreadable(photo, tmp_path, log, slip):
    if log is not None:
        (tmp_path / "gyro.txt").write_text(log)
    line = refused(3, photo, "-o", tmp_path / "b.png", *TIMING, "--gyro", tmp_path / "gyro.txt")
    assert slip in line
    assert "gyro.txt" in line


@pytest.mark.parametrize("text", ["", "3", "x: {a: 1}", "x: [[1]]", "[", "x: [a]"])
def test_a_polynomial_file_that_is_none_is_unreadable(photo, tmp_path, text):
    (tmp_path / "p.yaml").write_text(text)
    assert "p.yaml" in refused(3, photo, "-o", tmp_path / "b.png", *TIMING, "--polynomial", tmp_path / "p.yaml")


def test_a_photograph_that_is_none_is_unreadable(tmp_path):
    (tmp_path / "sharp.png").write_bytes(b"no picture")
    assert "sharp.png" in refused(3, tmp_path / "sharp.png", "-o", tmp_path / "b.png", *TIMING, "--shake")
    assert "exist" in refused(3, tmp_path / "none.png", "-o", tmp_path / "b.png", *TIMING, "--shake")


def test_the_photograph_itself_is_never_overwritten(photo):
    before = photo.read_bytes()
    assert "lost" in refused(2, photo, "-o", photo.with_name("b.png"), "--truth", photo, "--overwrite", *TIMING, "--shake")
    assert photo.read_bytes() == before
