"""`rsvideo track`, and `rsvideo deblur --trajectory` along what it found, through the installed command and with the real core."""

import json
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import rsvideo
from rsvideo.config.request import Measured, Request
from rsvideo.pipeline import given_movement, measuring
from rsvideo.pipeline.prepare import prepare
from rsvideo.pipeline.track import carry_out
from rsvideo.progress import ignore
from rsvideo.restoration import exposure
from rsvideo.video import decode
from tests.cli.conftest import Run
from tests.cli.forked import call
from tests.cli.test_bad_input import one_line
from tests.pipeline.moving import Moving, encode
from tests.pipeline.moving import planes as coded
from tests.video.clips import make

CLIP = Moving(frames=4)
GOOD = ("--exposure", "1/50", "--readout", "20ms", "--focal-px", str(CLIP.lens.fx), "--force")
LOSSLESS = ("--codec", "ffv1", "--prior", "tv")


def command(*words: object) -> subprocess.CompletedProcess[str]:
    """The installed command, which ended well."""
    done = call(*words, timeout=400)
    assert done.returncode == 0, done.stderr
    return done


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Four frames of a moving camera, and one without texture behind a cut."""
    pictures = [coded(rendering.blurred) for rendering in CLIP.renderings]
    grey = tuple(np.full_like(plane, 128) for plane in pictures[0])
    return encode(tmp_path_factory.mktemp("clip") / "clip.mkv", [*pictures, grey])


@pytest.fixture(scope="module")
def motion(source: Path) -> Path:
    """What the command found."""
    found = source.with_name("a.rsvideo.json")
    done = command("track", source, "-o", found, *GOOD)
    assert "exposure 20 ms (explicit), readout 20 ms (explicit)" in done.stderr
    assert "1 restored by themselves" in done.stderr
    return found


@pytest.fixture(scope="module")
def plain(source: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The clip restored without a motion that is given."""
    output = tmp_path_factory.mktemp("plain") / "plain.mkv"
    command("deblur", source, "-o", output, *GOOD, *LOSSLESS)
    return output


def planes(path: Path) -> list[tuple[np.ndarray, ...]]:
    return [picture.planes for picture in decode.pictures(decode.probe(path))]


@pytest.mark.slow
def test_restored_along_its_track_a_clip_is_the_same_as_restored_at_once(source: Path, motion: Path, plain: Path, tmp_path: Path) -> None:
    command("deblur", source, "-o", tmp_path / "along.mkv", *LOSSLESS, "--trajectory", motion)
    wanted, found = planes(plain), planes(tmp_path / "along.mkv")
    assert len(wanted) == len(found) == 5
    assert any((a[0] != b[0]).any() for a, b in zip(found, planes(source), strict=True))
    for a, b in zip(wanted, found, strict=True):
        for one, other in zip(a, b, strict=True):
            np.testing.assert_array_equal(one, other)


@pytest.mark.slow
def test_a_track_foretells_the_verdicts(motion: Path, plain: Path) -> None:
    foretold, met = (
        [frame["verdict"] for frame in json.loads(path.read_text())["frames"]] for path in (motion, plain.with_suffix(".rsvideo.json"))
    )
    assert foretold[:4] == met[:4]
    assert "restored" in foretold
    assert "restored by itself" in foretold[4]


def test_python_restores_along_the_commands_track(source: Path, motion: Path) -> None:
    frames = rsvideo.deblur_clip(source, trajectory=motion, settings=rsvideo.Settings(prior="tv", frames="alone"))
    first = json.loads(motion.read_text())["frames"][0]
    result = next(frames)
    assert result.verdict.value == first["verdict"] == "restored"
    np.testing.assert_allclose(result.trajectory.curve.coefficients, first["found"]["path"], rtol=1e-9, atol=1e-12)
    assert (result.timing.exposure, result.timing.readout) == pytest.approx((0.02, 0.02))


def test_a_track_is_of_one_clip_with_one_shutter(rsvideo: Run, source: Path, motion: Path, tmp_path: Path) -> None:
    nothing = (source, "-o", tmp_path / "out.mkv", "--trajectory", motion, "--method", "none")
    done = rsvideo("deblur", *nothing, "--exposure", "1/100", "--focal-px", "500")
    assert done.returncode == 0, done.stderr
    assert "was found with exposure 20 ms, readout 20 ms, top-to-bottom; that is taken, and not exposure 10 ms" in done.stderr
    assert "with a focal length of 192 px; that is taken, and not 500 px" in done.stderr
    other = make(tmp_path / "other.mkv", rows=100, cols=160)
    one_line(
        rsvideo("deblur", other, "-o", tmp_path / "o.mkv", "--trajectory", motion), 3, "pictures of 160 x 96 px, those of", "160 x 100"
    )
    late = tmp_path / "late.rsvideo.json"
    late.write_text(motion.read_text().replace('"time_s":0.04', '"time_s":0.05'))
    one_line(rsvideo("deblur", source, "-o", tmp_path / "o.mkv", "--trajectory", late), 3, "frame 1 begins at 0.05", "another clip's?")


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("path", [[0.0, 0.0, 0.0], [1e9, 0.0, 0.0]], "must keep in view"),
        ("path", [[0.0, 0.0, 0.0], [1.0, 0.0]], "equally many axes"),
        ("drift", {"points_px": [[80.0, 48.0]], "weights_px_s": [[1e9, 0.0]], "length_px": 20.0}, "drift by"),
        ("drift", {"points_px": [[80.0, 48.0]], "weights_px_s": [], "length_px": 20.0}, "equally long"),
        ("doubts", [[[0.0, 0.0, 0.0]]], "as many terms and axes as path"),
        ("doubts", [[[0.0, 0.0, 0.0]]] * 100, "at most 64"),
        ("focused", [[0.0, 0.0, 0.0], [1e9, 0.0, 0.0]], "must keep in view"),
        ("focused", [[0.0, 0.0], [1.0, 0.0]], "as many axes as path"),
        ("seeming_s", 20.0, "less than 10"),
        ("share", 2.0, "less than or equal to 1"),
        ("certainty", -1.0, "greater than or equal to 0"),
        ("blur_certainty", 1.5, "less than or equal to 1"),
    ],
)
def test_a_strangers_track_is_bounded(
    rsvideo: Run, source: Path, motion: Path, tmp_path: Path, key: str, value: object, words: str
) -> None:
    held = json.loads(motion.read_text())
    held["frames"][0]["found"] |= {"doubts": [], key: value}
    hostile = tmp_path / "hostile.rsvideo.json"
    hostile.write_text(json.dumps(held))
    one_line(rsvideo("deblur", source, "-o", tmp_path / "out.mkv", "--trajectory", hostile), 3, "hostile.rsvideo.json", words)
    assert [path.name for path in tmp_path.iterdir()] == ["hostile.rsvideo.json"]


@pytest.mark.parametrize(
    ("name", "output", "code", "words"),
    [
        ("in.png", "a.json", 2, "motion is found between the frames of a clip"),
        ("in.mkv", "a.csv", 2, "OUTPUT must end in .json"),
        ("in.mkv", "there.json", 4, "exists already"),
        ("in.mkv", "no/a.json", 2, "the folder"),
        ("none.mkv", "a.json", 3, "does not exist"),
    ],
)
def test_a_track_that_cannot_be_is_refused(
    rsvideo: Run, photograph: Path, tmp_path: Path, name: str, output: str, code: int, words: str
) -> None:
    make(tmp_path / "in.mkv")
    (tmp_path / "there.json").write_text("older")
    one_line(rsvideo("track", photograph.with_name(name), "-o", tmp_path / output), code, words)
    assert (tmp_path / "there.json").read_text() == "older"


def test_the_layout_of_bare_pixels_is_refused_of_a_file(rsvideo: Run, tmp_path: Path) -> None:
    clip = make(tmp_path / "in.mkv")
    one_line(rsvideo("track", clip, "-o", tmp_path / "a.json", "--pixel-format", "yuv420p"), 2, "--pixel-format", "states its own")


def test_what_a_clip_shows_of_its_shutter_goes_into_its_track(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measuring, "measured", lambda *_: Measured(exposure=0.021, readout=0.018))
    grey = coded(np.full((96, 160, 1), 0.5, np.float32))
    source = encode(tmp_path / "grey.mkv", [grey, grey])
    carry_out(prepare(Request(source=source, output=tmp_path / "a.rsvideo.json", motion_only=True)), ignore)
    held = json.loads((tmp_path / "a.rsvideo.json").read_text())["frames"][0]["timing"]
    assert held["exposure_s"] == 0.021
    assert held["row_time_s"] == 0.018 / 96
    assert held["source"] == "exposure: measured from the clip's blur; readout: measured from the clip's motion"


def test_what_each_frame_shows_of_its_exposure_goes_into_the_track_and_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = [0.012, 0.015, 0.019, 0.024]
    monkeypatch.setattr(measuring, "measured", lambda *_: Measured(exposure=0.021, readout=0.018, focal=200.0))
    seeming = [1.2 * seconds for seconds in found]
    monkeypatch.setattr(exposure, "of_each", lambda run, _: replace(run.exposed(np.array(found)), seeming=np.array(seeming)))
    source = encode(tmp_path / "moving.mkv", [coded(rendering.blurred) for rendering in CLIP.renderings])
    output = tmp_path / "a.rsvideo.json"
    carry_out(task := prepare(Request(source=source, output=output, motion_only=True)), ignore)
    assert [frame["timing"]["exposure_s"] for frame in json.loads(output.read_text())["frames"]] == found
    shown = decode.pictures(decode.probe(source))
    moving = given_movement.of_pictures(output, task.treatment.camera.exposed(found[0]), [(p.index, p.time) for p in shown])
    assert moving.exposures == found
    assert all(one.exposure_shown for one in moving.evidence)
    assert [one.seeming for one in moving.evidence] == seeming
    for path, seconds, one in zip(moving.within, found, moving.evidence, strict=True):
        assert path is not None
        assert path.t1 == pytest.approx(seconds + 0.018)
        assert one.focused is not None
        assert one.focused.t1 == pytest.approx(1.2 * seconds + 0.018)
