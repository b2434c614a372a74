"""`rsvideo simulate --from-clip`, as a user runs it."""

import json

import cv2
import numpy as np
import pytest
import skimage.data

from rsvideo.physics import tone
from rsvideo.physics.tone import Transfer
from rsvideo.video import colour, decode
from tests.cli.forked import call
from tests.cli.test_simulate import VERB, refused
from tests.pipeline.moving import encode, luma, planes

SHUTTER = ["--exposure", "1/50", "--readout", "20ms"]
STEP = 3  # px that the scene moves to the left from frame to frame
FRAMES = 12


def lights(scene, step=STEP, frames=FRAMES, rows=96, cols=160):
    photograph = getattr(skimage.data, scene)() / np.float32(255)
    photograph = tone.decode(Transfer.SRGB, photograph[..., 1] if photograph.ndim == 3 else photograph)
    return [photograph[100 : 100 + rows, 100 + step * k : 100 + step * k + cols, None] for k in range(frames)]


def written(path, frames):
    return encode(path, [planes(light) for light in frames])


@pytest.fixture(scope="module")
def sharp(tmp_path_factory):
    """A lossless clip of a scene that moves evenly."""
    return written(tmp_path_factory.mktemp("sharp") / "sharp.mkv", lights("camera"))


@pytest.fixture(scope="module")
def case(sharp, tmp_path_factory):
    folder = tmp_path_factory.mktemp("made") / "case"
    words = ["--from-clip", sharp, "-o", folder, *SHUTTER, "--speed", 1.5, "--first", 1, "--frames", 4, "--noise", 0.001, "--seed", 5]
    done = call("simulate", *words)
    assert (done.returncode, done.stdout) == (0, ""), done.stderr
    assert done.stderr == f"rsvideo: filmed 4 frames of 160 x 96, 2.2 px of blur: {folder}\n"
    return folder


def made(source, output, *words):
    VERB(["--from-clip", str(source), "-o", str(output), *SHUTTER, *map(str, words)], standalone_mode=False)
    return output


def test_a_folder_holds_the_clip_its_truth_and_its_facts(case):
    assert sorted(path.name for path in case.iterdir()) == ["case.json", "clip.mp4", "truth.mp4"]
    facts = json.loads((case / "case.json").read_text())
    assert facts["blur_px"] == pytest.approx([STEP * 1.5 * 24 / 50] * 4, rel=0.05)
    assert facts["blur_extent_px"] == pytest.approx(np.median(facts["blur_px"]), abs=1e-3)
    del facts["blur_px"], facts["blur_extent_px"], facts["rsvideo"]
    assert facts == {
        "kind": "clip",
        "source": "sharp.mkv",
        "exposure_s": 0.02,
        "row_time_s": pytest.approx(0.02 / 96),
        "readout_s": pytest.approx(0.02),
        "direction": "top-to-bottom",
        "rows": 96,
        "cols": 160,
        "fps": 24.0,
        "frames": 4,
        "focal_px": None,
        "transfer": "bt709",
        "noise_sigma_linear": 0.001,
        "first": 1,
        "speed": 1.5,
        "seed": 5,
    }


def test_automatic_exposure_leads_evenly_to_the_last_frames(sharp, tmp_path):
    folder = made(sharp, tmp_path / "a", "--last-exposure", "5ms", "--frames", 5)
    facts = json.loads((folder / "case.json").read_text())
    assert facts["exposures_s"] == pytest.approx(np.geomspace(0.02, 0.005, 5))
    assert facts["blur_px"] == pytest.approx(STEP * 24 * np.geomspace(0.02, 0.005, 5), rel=0.05)


def test_a_last_exposure_longer_than_a_frames_period_is_refused(sharp, tmp_path):
    line = refused(2, "--from-clip", sharp, "-o", tmp_path / "a", *SHUTTER, "--last-exposure", "50ms")
    assert line == "last-exposure must lie in (0, 41.67] ms, a frame's period, got 50 ms"


def test_inspect_reads_what_was_made(case):
    done = call("inspect", case / "clip.mp4", "--json")
    assert done.returncode == 0, done.stderr
    stated = json.loads(done.stdout)
    assert (stated["rows"], stated["cols"], stated["frames"], stated["frame_rate"]) == (96, 160, 4, 24)
    assert stated["colour"]["transfer"] == "bt709"
    assert stated["colour"]["assumed"] == []


def test_the_truth_is_the_scene_at_the_middle_of_each_interval(case):
    photograph = planes(lights("camera", frames=1, cols=400)[0])[0].astype(np.float32)
    x, y = np.meshgrid(np.arange(160, dtype=np.float32), np.arange(96, dtype=np.float32))
    for k, shown in enumerate(luma(case / "truth.mp4")):
        at = STEP * (1 + 1.5 * (k + 24 * 0.02))  # the interval lasts exposure + readout
        inner = (slice(8, -8), slice(12, -12))
        errors = [np.abs(cv2.remap(photograph, x + at + off, y, cv2.INTER_CUBIC) - shown)[inner].mean() for off in (0, -1.5, 1.5)]
        assert errors[0] < 1.5
        assert min(errors[1:]) > 2 * errors[0]


def test_a_seed_repeats_the_clip_and_another_draws_other_noise(case, sharp, tmp_path):
    rest = ["--speed", 1.5, "--first", 1, "--frames", 4, "--noise", 0.001]
    same, other = (made(sharp, tmp_path / str(seed), *rest, "--seed", seed) for seed in (5, 6))
    assert (same / "clip.mp4").read_bytes() == (case / "clip.mp4").read_bytes()
    assert (other / "clip.mp4").read_bytes() != (case / "clip.mp4").read_bytes()


def test_a_still_clip_comes_back_as_it_is(tmp_path):
    source = written(tmp_path / "still.mkv", lights("camera", step=0, frames=6))
    folder = made(source, tmp_path / "case", "--noise", 0)
    before = luma(source)[0].astype(int)
    for name, most in (("clip.mp4", 1.5), ("truth.mp4", 0.75)):
        shown = luma(folder / name)
        assert len(shown) == 5
        assert all(np.abs(frame - before).mean() < most for frame in shown)


def test_a_larger_source_is_averaged_down_in_light(tmp_path):
    checks = (np.indices((192, 320)).sum(axis=0) % 2).astype(np.float32)[..., None]
    source = encode(tmp_path / "checks.mkv", [planes(checks)] * 4)
    folder = made(source, tmp_path / "case", "--largest-side", 161, "--noise", 0)
    stream = decode.probe(folder / "truth.mp4")
    assert (stream.rows, stream.cols) == (96, 160)  # 97 x 161 is odd
    light, _ = colour.light(next(iter(decode.pictures(stream))), stream.colour)
    white = colour.light(next(iter(decode.pictures(decode.probe(source)))), stream.colour)[0].max()
    assert light.mean() == pytest.approx(0.5 * white, rel=0.03)


def test_a_clip_ends_at_a_cut(tmp_path, capsys):
    source = written(tmp_path / "cut.mkv", lights("camera", frames=7) + lights("coins", frames=7))
    folder = made(source, tmp_path / "case")
    assert "note: the source cuts to another scene at its frame 7" in capsys.readouterr().err
    assert json.loads((folder / "case.json").read_text())["frames"] == 6
    line = refused(2, "--from-clip", source, "-o", tmp_path / "other", *SHUTTER, "--frames", 8)
    assert "9 of the source's, from 0 on there are 7" in line
    assert "--first 7" in line
    assert made(source, tmp_path / "other", "--first", 7, "--frames", 6)


def test_poor_interpolation_is_noted_in_one_line(tmp_path, capsys):
    rng = np.random.default_rng(0)
    source = encode(tmp_path / "noise.mkv", [planes(rng.uniform(0, 1, (96, 160, 1)).astype(np.float32)) for _ in range(5)])
    made(source, tmp_path / "case", "--frames", 3)
    first, last = capsys.readouterr().err.splitlines()
    assert first.startswith("rsvideo: note: the scene between the source's frames is poor in 3 of 3 frames")
    assert "filmed 3 frames" in last


def test_another_rate_takes_the_source_as_its_own_slow_motion(sharp, tmp_path):
    folder = made(sharp, tmp_path / "case", "--rate", "30000/1001", "--frames", 3, "--speed", 2, "--direction", "right-to-left")
    facts = json.loads((folder / "case.json").read_text())
    assert decode.probe(folder / "clip.mp4").rate * 1001 == 30000
    assert facts["fps"] == pytest.approx(29.97, abs=1e-3)
    assert (facts["direction"], facts["row_time_s"]) == ("right-to-left", pytest.approx(0.02 / 160))
    assert facts["blur_extent_px"] == pytest.approx(STEP * 2 * 0.02 * 29.97, rel=0.05)


@pytest.mark.parametrize(
    ("words", "slip"),
    [
        (["--frames", "12"], "12 frames at a speed of 1 must have 13 of the source's, from 0 on there are 12"),
        (["--frames", "0"], "frames must be at least 1"),
        (["--first", "12"], "0 to 11"),
        (["--first", "11"], "1 frame at a speed of 1 must have 2"),
        (["--first", "-1"], "at least 0"),
        (["--speed", "0"], "speed must lie in"),
        (["--speed", "nan"], "speed must lie in"),
        (["--speed", "20"], "a lower --speed"),
        (["--rate", "0"], "frames a second"),
        (["--largest-side", "8"], "largest-side must be at least 16"),
        (["--largest-side", "20"], "it would be 20 x 12"),
        (["--noise", "3"], "8-bit"),
        (["--exposure", "50ms"], "at most one frame's period"),
        (["--exposure", "20"], "milliseconds"),
        (["--exposure", "soon"], "1/50"),
        (["--readout", "50ms"], "at most one frame's period"),
        (["--row-time", "30us"], "only one"),
        (["--shake"], "--shake must not be given with --from-clip"),
        (["--gyro-axes", "YXZ"], "--gyro-axes must not be given with --from-clip"),
        (["photo.png"], "got both"),
    ],
)
def test_a_contradiction_is_refused_in_one_line(sharp, tmp_path, words, slip):
    assert slip in refused(2, "--from-clip", sharp, "-o", tmp_path / "case", *SHUTTER, *words)
    assert not list(tmp_path.iterdir())


def test_options_of_clips_are_refused_for_photographs_and_a_source_is_needed(tmp_path):
    assert "--speed must be given with --from-clip" in refused(2, "p.png", "-o", tmp_path / "b.png", *SHUTTER, "--shake", "--speed", 2)
    assert "got neither" in refused(2, "-o", tmp_path / "b.png", *SHUTTER, "--shake")
    assert "--readout or --row-time, got neither" in refused(2, "--from-clip", "a.mp4", "-o", tmp_path / "b", *SHUTTER[:2])


def test_a_source_that_is_no_clip_is_unreadable(tmp_path, samples):
    for source, slip in ((tmp_path / "none.mp4", "does not exist"), (samples / "coffee" / "truth.png", "must be an MP4, MOV or MKV clip")):
        line = refused(3, "--from-clip", source, "-o", tmp_path / "case", *SHUTTER)
        assert slip in line
        assert source.name in line
    assert not list(tmp_path.iterdir())


def test_names_are_checked_before_the_work(sharp, tmp_path):
    assert "nowhere must exist" in refused(2, "--from-clip", sharp, "-o", tmp_path / "nowhere" / "case", *SHUTTER)
    (tmp_path / "file").write_bytes(b"mine")
    assert "name of a folder" in refused(2, "--from-clip", sharp, "-o", tmp_path / "file", *SHUTTER)
    folder = tmp_path / "case"
    folder.mkdir()
    (folder / "notes.txt").write_bytes(b"mine")
    for name in ("clip.mp4", "truth.mp4", "case.json"):
        (folder / name).write_bytes(b"mine")
        assert name in refused(4, "--from-clip", sharp, "-o", folder, *SHUTTER)
        assert (folder / name).read_bytes() == b"mine"
        (folder / name).unlink()
    (folder / "case.json").write_bytes(b"mine")
    made(sharp, folder, "--frames", 2, "--overwrite")
    assert sorted(path.name for path in folder.iterdir()) == ["case.json", "clip.mp4", "notes.txt", "truth.mp4"]
    assert (folder / "case.json").read_bytes() != b"mine"


def test_the_source_is_never_overwritten(sharp, tmp_path):
    folder = tmp_path / "case"
    folder.mkdir()
    source = folder / "clip.mp4"
    source.write_bytes(sharp.read_bytes())
    assert "would be lost" in refused(2, "--from-clip", source, "-o", folder, *SHUTTER, "--overwrite")
    assert source.read_bytes() == sharp.read_bytes()
