"""Clips from a file or arrays to arrays: the command's pixels, in chunks, and nothing written."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import imageio.v3 as imageio
import numpy as np
import pytest

import rsvideo
from rsvideo.api import footage
from rsvideo.api.treatment import Stated
from rsvideo.config.request import Measured, Request
from rsvideo.physics import tone
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline import chunk, measuring
from rsvideo.pipeline import track as tracking
from rsvideo.pipeline.deblur import carry_out
from rsvideo.pipeline.prepare import prepare
from rsvideo.progress import ignore
from rsvideo.restoration import clip_motion
from rsvideo.video import colour, decode
from tests.pipeline.moving import RATE, Moving

SHUTTER = rsvideo.Shutter(exposure=0.02, readout=0.02)
CAMERA = rsvideo.Camera(focal_px=1.2 * 160)
FRAMES = 6
CHUNK = 4  # frames at most
QUICK = rsvideo.Settings(prior="tv", quality="draft")  # the denoiser is tested with photographs


class Again:
    """Frames of which nobody knows how many there are before they are gone through; `taken` of each pass."""

    def __init__(self, frames: list[np.ndarray]) -> None:
        self.frames = frames
        self.taken: list[int] = []

    def __iter__(self) -> Iterator[np.ndarray]:
        self.taken.append(0)
        for frame in self.frames:
            self.taken[-1] += 1
            yield frame


def command(folder: Path, words: dict[str, float], output: Path) -> Request:
    """What `rsvideo deblur` is asked for a folder of pictures."""
    how = {"encoding": {"codec": "png"}, "deblur": {"prior": "tv", "quality": "draft"}}
    return Request.model_validate({"source": folder, "output": output, "input": {"rate": RATE}, "camera": words, **how})


def arguments(words: dict[str, float]) -> dict[str, Any]:
    """The same as arguments."""
    shutter = rsvideo.Shutter(exposure=words.get("exposure"), readout=words.get("readout"))
    return {"shutter": shutter, "camera": rsvideo.Camera(focal_px=words.get("focal_px")), "force": bool(words.get("force"))}


@pytest.fixture(scope="module")
def moving() -> Moving:
    return Moving(frames=FRAMES)


@pytest.fixture(scope="module")
def codes(moving: Moving) -> list[np.ndarray]:
    """The frames as 8-bit codes, in colour."""
    stored = (np.rint(255 * tone.encode(Transfer.SRGB, r.blurred)) for r in moving.renderings)
    return [np.repeat(codes.astype(np.uint8), 3, axis=2) for codes in stored]


@pytest.fixture(scope="module")
def folder(codes: list[np.ndarray], tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same without loss, as a folder of pictures."""
    place = tmp_path_factory.mktemp("frames")
    for k, frame in enumerate(codes):
        imageio.imwrite(place / f"{k:03}.png", frame)
    return place


@pytest.fixture(scope="module")
def motion(moving: Moving, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The true motion as CSV: what concerns the frames' way, and not the motion, need not find it."""
    return moving.motion(tmp_path_factory.mktemp("motion") / "motion.csv")


@pytest.fixture
def short_chunks(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chunks of 3 of the clip's 6 frames."""
    monkeypatch.setattr(chunk, "MOST_BYTES", 0)
    monkeypatch.setattr(chunk, "SHORTEST", CHUNK)
    monkeypatch.setattr(chunk, "LONGEST", CHUNK)


@pytest.fixture(scope="module")
def restored(codes: list[np.ndarray]) -> list[rsvideo.Result]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunk, "SHORTEST", CHUNK)
        patch.setattr(chunk, "LONGEST", CHUNK)
        return list(rsvideo.deblur_clip(codes, shutter=SHUTTER, camera=CAMERA, settings=QUICK, rate=RATE))


def test_the_frames_come_in_order_and_sharper(moving: Moving, restored: list[rsvideo.Result]) -> None:
    before = [np.abs(r.blurred - r.truth)[8:-8, 24:-24].mean() for r in moving.renderings]
    after = [np.abs(result.light - r.truth)[8:-8, 24:-24].mean() for result, r in zip(restored, moving.renderings, strict=True)]
    assert np.mean(after) < 0.7 * np.mean(before)
    assert [result.index for result in restored] == list(range(FRAMES))
    assert [result.time for result in restored] == pytest.approx(moving.begins.tolist())
    assert all(result.to_next is not None and result.to_next.shape == (3,) for result in restored[:-1])
    assert restored[-1].to_next is None


@pytest.mark.slow
@pytest.mark.usefixtures("short_chunks")
@pytest.mark.parametrize(
    "words",
    [
        {"exposure": 0.02, "readout": 0.02, "focal_px": CAMERA.focal_px},
        {},
        {"exposure": 0.01, "readout": 0.02, "focal_px": CAMERA.focal_px},
        {"exposure": 0.01, "readout": 0.02, "focal_px": CAMERA.focal_px, "force": True},
    ],
    ids=["stated", "measured", "contradicted", "forced"],
)
def test_arrays_become_the_pixels_that_the_command_writes(
    words: dict[str, float], codes: list[np.ndarray], folder: Path, tmp_path: Path
) -> None:
    task = prepare(command(folder, words, tmp_path / "out"))
    assert len(chunk.chunks(task)) == 2
    carry_out(task, ignore)
    written = [imageio.imread(path) for path in sorted((tmp_path / "out").glob("*.png"))]
    restored = list(rsvideo.deblur_clip(codes, settings=QUICK, rate=RATE, **arguments(words)))
    assert any((result.latent != given).any() for result, given in zip(restored, codes, strict=True))
    assert restored[0].notes == task.notes
    np.testing.assert_array_equal([result.latent for result in restored], written)


@pytest.mark.parametrize(("words", "again"), [({}, True), ({"exposure": 0.01}, False)])
def test_arrays_show_what_the_command_measures(
    words: dict[str, float], again: bool, codes: list[np.ndarray], folder: Path, tmp_path: Path
) -> None:
    wanted = prepare(command(folder, words, tmp_path / "out"))
    stated = Stated.of(rsvideo.Shutter(exposure=words.get("exposure")), None, QUICK, rate=RATE)
    shot = footage.of_arrays(codes if again else iter(codes), stated)
    for name in ("camera", "timing_source", "exposure_shown", "readout_guessed", "exposure_spread"):
        assert getattr(shot.treatment, name) == getattr(wanted.treatment, name)
    assert shot.treatment.exposure_shown
    assert shot.notes == wanted.notes
    assert len(list(shot.pictures())) == FRAMES


@pytest.mark.parametrize("sized", [True, False])
def test_the_frames_in_the_middle_are_measured(sized: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    taken: list[int] = []
    monkeypatch.setattr(measuring, "measured", lambda frames, *_: taken.extend(frame.index for frame in frames) or Measured())
    frames = [np.full((48, 64), k / 60) for k in range(measuring.FRAMES + 12)]
    rsvideo.deblur_clip(frames if sized else Again(frames), rate=RATE)
    assert taken == list(range(6, 6 + measuring.FRAMES))


@pytest.mark.parametrize(
    "words",
    [{"force": True}, {"settings": rsvideo.Settings(frames="cold")}, {"trajectory": "motion.csv"}],
)
def test_nothing_is_measured_where_it_would_not_be_used(words: dict, codes: list[np.ndarray], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measuring, "measured", lambda *_: pytest.fail("all is stated"))
    rsvideo.deblur_clip(codes, shutter=SHUTTER, camera=CAMERA, rate=RATE, **words)


def test_what_frames_do_not_show_is_assumed_as_of_a_file() -> None:
    (result, *_) = rsvideo.deblur_clip([np.full((48, 64), 0.5)] * 3, rate=RATE, settings=QUICK)
    assert (result.timing.exposure, result.timing.readout) == pytest.approx((0.25 / RATE, 0.25 / RATE))
    assert any("no points could be followed" in note and "exposure 10.4 ms, readout 10.4 ms is assumed" in note for note in result.notes)


def test_an_exposure_that_the_blur_contradicts_is_not_taken_unless_it_is_forced() -> None:
    short = [rendering.blurred for rendering in Moving(frames=FRAMES, exposure=0.008).renderings]
    how = {"shutter": rsvideo.Shutter(exposure=0.04, readout=0.02), "camera": CAMERA, "rate": RATE}
    path = rsvideo.track(short, **how)
    assert path.timing.exposure == pytest.approx(0.008, rel=0.2)
    assert "times shorter than an exposure of 1/25 s" in path.notes[0]
    assert all(one.exposure_shown for one in path.evidence)
    forced = rsvideo.track(short, force=True, **how)
    assert forced.timing.exposure == 0.04
    assert forced.notes == ()
    assert not any(one.exposure_shown for one in forced.evidence)


@pytest.mark.slow
def test_a_path_an_iterator_and_a_clip_give_what_arrays_give(codes: list[np.ndarray], motion: Path, tmp_path: Path) -> None:
    for k, frame in enumerate(codes[:3]):
        imageio.imwrite(tmp_path / f"{k:03}.png", frame)
    how = {"shutter": SHUTTER, "camera": CAMERA, "settings": QUICK, "trajectory": motion}
    wanted = list(rsvideo.deblur_clip(codes[:3], rate=RATE, **how))
    clip = rsvideo.read_clip(tmp_path, rate=RATE)
    for source, rate in ((tmp_path, RATE), (clip, None), (iter(codes[:3]), RATE)):
        found = list(rsvideo.deblur_clip(source, rate=rate, **how))
        np.testing.assert_array_equal([result.light for result in found], [result.light for result in wanted])
        assert [result.verdict for result in found] == [result.verdict for result in wanted]


@pytest.mark.slow
@pytest.mark.usefixtures("short_chunks")
def test_a_clip_restored_along_its_track_is_the_same(codes: list[np.ndarray], restored: list[rsvideo.Result]) -> None:
    how = {"settings": QUICK, "rate": RATE}
    path = rsvideo.track(codes, shutter=SHUTTER, camera=CAMERA, **how)
    assert len(path.trajectories) == FRAMES
    assert path.tied.tolist() == [True] * (FRAMES - 1) + [False]
    again = list(rsvideo.deblur_clip(codes, trajectory=path, **how))
    np.testing.assert_array_equal([result.latent for result in again], [result.latent for result in restored])
    with pytest.raises(ValueError, match="a track of the same clip"):
        list(rsvideo.deblur_clip([*codes, *codes], trajectory=path, **how))


@pytest.mark.slow
@pytest.mark.usefixtures("short_chunks")
def test_arrays_restored_along_a_track_in_a_file_are_the_same(
    codes: list[np.ndarray], folder: Path, restored: list[rsvideo.Result], tmp_path: Path
) -> None:
    words = {"exposure": 0.02, "readout": 0.02, "focal_px": CAMERA.focal_px}
    wanted = command(folder, words, tmp_path / "a.json").replaced(motion_only=True, encoding={"codec": "same"})
    tracking.carry_out(prepare(wanted), ignore)
    again = list(rsvideo.deblur_clip(codes, trajectory=tmp_path / "a.json", rate=RATE, settings=QUICK))
    assert again[0].timing == restored[0].timing
    np.testing.assert_array_equal([result.latent for result in again], [result.latent for result in restored])


def test_along_a_track_shutter_and_lens_are_those_with_which_it_was_found(
    codes: list[np.ndarray], folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = rsvideo.track(codes, rate=RATE, settings=rsvideo.Settings(motion="shift"))
    monkeypatch.setattr(measuring, "measured", lambda *_: pytest.fail("the track states it"))
    how = {"rate": RATE, "trajectory": path, "settings": QUICK, "shutter": rsvideo.Shutter(readout=0.01)}
    for source in (codes, folder):
        result = next(rsvideo.deblur_clip(source, **how))
        assert result.timing.exposure == path.exposures[0]
        assert result.timing.readout == path.timing.readout
        assert result.camera == path.camera
        assert "the motion in the given Track was found with" in result.notes[0]


def test_a_motion_in_a_file_is_followed(moving: Moving, codes: list[np.ndarray], motion: Path) -> None:
    results = list(rsvideo.deblur_clip(codes[:3], shutter=SHUTTER, camera=CAMERA, settings=QUICK, rate=RATE, trajectory=motion))
    t = np.linspace(*results[1].timing.interval, 9)
    way = moving.way(1)
    np.testing.assert_allclose(results[1].trajectory.at(t), way.at(t) - way.at(np.array([results[1].timing.middle])), atol=0.05)


def test_light_comes_back_as_light_and_grey_as_grey(moving: Moving, motion: Path) -> None:
    frames = [r.blurred[..., 0] for r in moving.renderings[:3]]
    for result in rsvideo.deblur_clip(frames, shutter=SHUTTER, camera=CAMERA, settings=QUICK, rate=RATE, trajectory=motion):
        assert result.latent.shape == (96, 160)
        assert result.latent.dtype == np.float32


def test_only_a_chunk_is_held(codes: list[np.ndarray], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(chunk, "SHORTEST", CHUNK)
    monkeypatch.setattr(chunk, "LONGEST", CHUNK)
    frames = Again(codes * 3)
    results = rsvideo.deblur_clip(
        frames, shutter=SHUTTER, camera=CAMERA, rate=RATE, settings=rsvideo.Settings(frames="alone", prior="tv", quality="draft")
    )
    next(results)
    assert frames.taken[-1] <= CHUNK + chunk.AHEAD
    results.close()  # pyright: ignore[reportAttributeAccessIssue]


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ({"rate": None}, "rate must be given, arrays do not say"),
        ({"rate": "fast"}, "rate must be a number of frames a second"),
        ({"rate": 100}, "exposure must be at most one frame's period, 10 ms at 100 fps"),
        ({"shutter": rsvideo.Shutter(readout=0.1)}, "readout must be at most one frame's period, 41.67 ms at 24 fps"),
        ({"shutter": None, "settings": rsvideo.Settings(frames="cold")}, "exposure must be given, the clip does not say it"),
        ({"shutter": None, "trajectory": "motion.csv"}, "exposure must be given, the clip does not say it"),
        ({"frames": []}, "frames must hold at least one picture"),
        ({"frames": np.zeros((96, 160, 3), np.uint8)}, "frame 0 must"),
        ({"frames": [np.full((96, 160), np.nan)]}, "frame 0 must be finite"),
    ],
)
def test_what_cannot_be_is_refused_before_the_first_result(
    codes: list[np.ndarray], words: dict, line: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(clip_motion, "gather", lambda *_: pytest.fail("before any work"))
    words = {"frames": codes, "shutter": SHUTTER, "camera": CAMERA, "rate": RATE, **words}
    with pytest.raises(ValueError, match=line):
        rsvideo.deblur_clip(words.pop("frames"), **words)


def test_a_frame_of_another_shape_is_refused_when_it_is_reached(codes: list[np.ndarray]) -> None:
    with pytest.raises(ValueError, match=r"frame 1 must be as the first, \(96, 160, 3\) of uint8, it is \(96, 159, 3\) of uint8"):
        list(rsvideo.deblur_clip([codes[0], codes[1][:, 1:]], shutter=SHUTTER, camera=CAMERA, rate=RATE))


def test_a_clip_that_is_read_shows_its_frames_again_and_again(samples: Path) -> None:
    clip = rsvideo.read_clip(samples / "clip" / "blurred.mp4")
    stream = decode.probe(samples / "clip" / "blurred.mp4")
    wanted = [colour.light(picture, stream.colour)[0] for picture in decode.pictures(stream)]
    for _ in range(2):
        np.testing.assert_array_equal(list(clip), wanted)
    np.testing.assert_allclose(clip.times, np.arange(12) / 24)
