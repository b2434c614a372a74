"""Every method gives every frame back, and those that should straighten or sharpen do."""

from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from rsvideo.config.method import Method
from rsvideo.config.request import Motion
from rsvideo.frame import Verdict
from rsvideo.pipeline import gyro_alignment, methods, output
from rsvideo.pipeline.methods import Treatment
from rsvideo.report.metrics import psnr
from rsvideo.restoration import clip_motion, stabilised
from rsvideo.restoration.camera_path import CameraPath, follow
from rsvideo.restoration.clip_motion import Followed
from rsvideo.restoration.settings import Settings
from tests.pipeline.moving import Moving, planes

FRAMES = 4


@cache
def moving() -> Moving:
    return Moving(frames=FRAMES)


def treatment(method: Method, log: Path | None = None) -> Treatment:
    clip, settings, gyro = moving(), Settings(), None
    if log is not None:
        stated = Motion(gyro=clip.motion(log))
        gyro = gyro_alignment.placed(stated, gyro_alignment.read(stated, log, clip.timing), clip.recorded, clip.camera, settings)
    return Treatment(
        method=method,
        settings=settings,
        block_rows=None,
        gyro=gyro,
        camera=clip.camera,
        timing_source="EXIF",
    )


def gain(latent: np.ndarray, k: int) -> float:
    """dB of luma codes over the recorded frame."""
    truth = planes(moving().renderings[k].truth)[0][..., None].astype(np.float32) / 255
    before, after = (planes(x)[0][..., None].astype(np.float32) / 255 for x in (moving().recorded[k].pixels, latent))
    return psnr(after, truth) - psnr(before, truth)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "least"),
    [
        (Method.NONE, 0.0),
        pytest.param(Method.UNIFORM, -9.0, marks=pytest.mark.long),
        pytest.param(Method.NONUNIFORM, -9.0, marks=pytest.mark.long),
        pytest.param(Method.STITCH, -9.0, marks=pytest.mark.long),
        (Method.RECTIFY, -0.1),
        pytest.param(Method.RECTIFY_UNIFORM, -6.0, marks=pytest.mark.long),
        pytest.param(Method.RECTIFY_NONUNIFORM, -6.0, marks=pytest.mark.long),
        pytest.param(Method.VIDSTAB_UNIFORM, -9.0, marks=pytest.mark.long),
        (Method.GYRO, 3.0),
        pytest.param(Method.GYRO_REFINE, 3.0, marks=pytest.mark.long),
        (Method.RSVIDEO, 1.0),
    ],
)
def test_each_method_gives_every_frame_back_in_order(method: Method, least: float, tmp_path: Path) -> None:
    asked = treatment(method, tmp_path / "motion.csv" if method.follows_gyro else None)
    begins, seen = moving().begins, []
    ways = methods.movement(asked, iter(moving().recorded), begins)
    results = list(methods.run(asked, iter(moving().recorded), ways, lambda at: seen.append(at.frame)))
    assert [r.frame.index for r in results] == list(range(FRAMES))
    assert {r.timing_source for r in results} == {"EXIF"}
    assert set(seen) == set(range(FRAMES))
    for before, result in zip(moving().recorded, results, strict=True):
        assert result.latent.shape == before.pixels.shape
        if not result.verdict.changed:
            np.testing.assert_array_equal(result.latent, before.pixels)
    assert np.mean([gain(r.latent, k) for k, r in enumerate(results)]) >= least


@pytest.mark.parametrize("method", [Method.RECTIFY, Method.RSVIDEO])
@pytest.mark.parametrize("guessed", [True, False])
def test_no_method_looks_for_tones_with_a_readout_that_is_a_guess(method: Method, guessed: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    toned: list[bool] = []

    def followed(*args: Any, **kwargs: Any) -> CameraPath:
        toned.append(kwargs["toned"])
        return follow(*args, **kwargs)

    monkeypatch.setattr(clip_motion, "follow", followed)
    clip = moving()
    methods.movement(replace(treatment(method), readout_guessed=guessed), iter(clip.recorded), clip.begins)
    assert set(toned) == {not guessed}


@pytest.mark.parametrize("readout", [0.0, 0.02])
def test_only_frames_without_a_readout_may_be_deblurred_along_streaks(readout: float, monkeypatch: pytest.MonkeyPatch) -> None:
    found: list[Followed] = []
    monkeypatch.setattr(stabilised, "movement", lambda run: found.append(run) or clip_motion.movement_along(run))
    clip = Moving(frames=3, readout=readout)
    methods.movement(replace(treatment(Method.RSVIDEO), camera=clip.camera), iter(clip.recorded), clip.begins)
    assert bool(found) == (readout == 0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("times", "doubtful", "taken"), [(0.5, True, 1.0), (0.7, True, 1.0), (0.7, False, 0.7), (1.0, True, 1.0), (2.0, True, 1.0)]
)
def test_an_exposure_gives_way_to_the_one_that_blur_shows_and_frames_are_in_better_focus_with(
    times: float, doubtful: bool, taken: float
) -> None:
    clip = Moving(frames=12)
    believed = times * clip.exposure
    frames = [replace(frame, time=frame.time + (clip.exposure - believed) / 2) for frame in clip.recorded]  # the middles stay
    stated = replace(treatment(Method.RSVIDEO), camera=clip.camera.exposed(believed), exposure_doubtful=doubtful)
    found = methods.movement(stated, iter(frames), clip.begins)
    assert np.median(found.exposures) / clip.exposure == pytest.approx(taken, rel=0.12)
    shares = [each.share for each in found.evidence]
    assert shares.pop(1) < 0.5  # that frame hardly moves
    assert all((share > 0) == (doubtful or times == 1.0) for share in shares)


def test_a_photograph_follows_a_recorded_motion(tmp_path: Path) -> None:
    asked = treatment(Method.GYRO, tmp_path / "motion.csv")
    result = methods.photograph(asked, moving().recorded[0], None)
    assert (result.verdict, result.timing_source) == (Verdict.RESTORED, "EXIF")
    assert gain(result.latent, 0) > 3


def test_the_record_of_a_frame_holds_its_psfs_without_their_empty_rim() -> None:
    frame = moving().recorded[0]
    psfs = np.zeros((1, 2, 9, 9))
    psfs[0, 0, 4, 4], psfs[0, 1, 2, 4] = 1.0, 1.0
    result = replace(methods.untouched(treatment(Method.NONE), frame, Verdict.RESTORED), psfs=psfs, convergence=(0.7, 0.6))
    record = output.frame_record(result)
    assert record.psfs is not None
    assert np.shape(record.psfs) == (1, 2, 5, 5)
    assert np.array(record.psfs)[0, 1, 0, 2] == 1
    assert record.convergence == [0.7, 0.6]
