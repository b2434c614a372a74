"""Frames that were shifted after they were exposed, deblurred by what their own blur shows."""

from dataclasses import replace
from functools import cached_property

import numpy as np
import pytest

from rsvideo.frame import Frame, Verdict
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Spline, fit
from rsvideo.report.metrics import psnr
from rsvideo.restoration import clip_motion, multi_frame, stabilised
from rsvideo.restoration.clip_motion import Followed, gather
from rsvideo.restoration.settings import Settings
from tests.pipeline.moving import Moving

MOVING = Moving(frames=8, rows=200, cols=280, readout=0.0, scene="coffee")
MARGIN = 20  # px


def shifted(images: list[np.ndarray]) -> list[np.ndarray]:
    """What stays of each picture where a stabiliser holds the scene in place."""
    places = np.rint(MOVING.path.at(MOVING.begins + MOVING.timing.middle)[:, :2]).astype(int)
    return [
        image[MARGIN - y : MOVING.rows - MARGIN - y, MARGIN - x : MOVING.cols - MARGIN - x]
        for image, (x, y) in zip(images, places, strict=True)
    ]


def steadied() -> tuple[list[Frame], Camera]:
    frames = MOVING.recorded
    pixels, clipped = (shifted([getattr(frame, name) for frame in frames]) for name in ("pixels", "clipped"))
    rows, cols = pixels[0].shape[:2]
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.0, rows=rows)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=MOVING.lens.fx, rows=rows, cols=cols))
    return [replace(frame, pixels=p, clipped=c) for frame, p, c in zip(frames, pixels, clipped, strict=True)], camera


def test_blur_shows_streaks_that_no_longer_show_between_the_frames() -> None:
    frames, camera = steadied()
    run = replace(gather(frames, camera, Settings()), readout_guessed=True)
    found = stabilised.movement(Followed.of(run))
    instants = np.linspace(0, 1, 25)
    for k, (within, beside) in enumerate(zip(found.within, found.evidence, strict=True)):
        true = np.ptp(MOVING.way(k).at(MOVING.timing.exposure * instants)[:, :2], axis=0)
        assert within is not None
        shown = np.ptp(within.at(camera.timing.exposure * instants)[:, :2], axis=0)
        assert np.abs(shown - true).max() < 1.2
        assert (beside.certainty, beside.exposure_shown) == (1.0, False)
    assert np.abs(found.steps).max() < 1.0
    between = clip_motion.movement(run)
    assert max(np.ptp(way.at(camera.timing.exposure * instants)[:, :2], axis=0).max() for way in between.within if way) < 2.0


@pytest.mark.slow
def test_frames_that_were_shifted_are_deblurred() -> None:
    frames, camera = steadied()
    run = replace(gather(frames, camera, Settings()), readout_guessed=True)
    done = list(multi_frame.restored(frames, stabilised.movement(Followed.of(run)), camera, Settings()))
    truth = shifted([rendering.truth for rendering in MOVING.renderings])
    gains = [psnr(each.latent, true) - psnr(each.frame.pixels, true) for each, true in zip(done, truth, strict=True)]
    assert np.mean(gains) > 2.0
    assert min(gains) > -0.1
    assert sum(each.verdict is Verdict.RESTORED for each in done) > 5


@pytest.mark.parametrize("guessed", [True, False])
def test_streaks_are_believed_where_a_readout_is_not_shown_and_a_path_where_there_is_none(
    guessed: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    frames, camera = steadied()
    followed = Followed.of(replace(gather(frames, camera, Settings()), readout_guessed=guessed))
    monkeypatch.setattr(stabilised, "deviations", lambda _votes: 2.0)  # in focus along either
    found = stabilised.movement(followed)
    terms = {len(way.coefficients) for way in found.within if way}
    assert (terms == {2}) == guessed


def test_an_even_pan_which_blurs_all_frames_alike_keeps_the_path_that_points_show() -> None:
    class Panning(Moving):
        @cached_property
        def path(self) -> Spline:
            times = np.linspace(0, float(self.begins[-1]) + self.timing.interval[1], 200)
            blank = Spline(t0=0.0, t1=float(times[-1]), coefficients=np.zeros((12, 3)))
            found = fit(blank, times, np.stack([250 * times, 0 * times, 0 * times], axis=1))
            assert isinstance(found, Spline)
            return found

    clip = Panning(frames=6, rows=200, cols=280, readout=0.0, scene="coffee")
    run = replace(gather(clip.recorded, clip.camera, Settings()), readout_guessed=True)
    found, along = stabilised.movement(Followed.of(run)), clip_motion.movement(run)
    for one, other in zip(found.within, along.within, strict=True):
        assert one is not None
        assert other is not None
        np.testing.assert_array_equal(one.coefficients, other.coefficients)
        assert np.ptp(one.at(np.array([0, clip.exposure]))[:, 0]) > 4
