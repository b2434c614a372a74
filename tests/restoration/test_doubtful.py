"""A frame for whose path little speaks is restored in part, and straightened wholly."""

import numpy as np
import pytest

from rsvideo.frame import Frame, Verdict
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory, centred
from rsvideo.restoration import doubtful, single_frame
from rsvideo.restoration.estimate import Estimate
from rsvideo.restoration.evidence import Evidence
from rsvideo.restoration.extent import longest
from rsvideo.restoration.rectification import rectified
from rsvideo.restoration.scanlines import View, to_scanlines
from rsvideo.restoration.settings import Settings

ROWS, COLS, SWAY = 80, 120, 6.0


def _view() -> View:
    timing = ShutterTiming(exposure=5e-3, row_time=2e-4, rows=ROWS)
    pixels = np.repeat((np.arange(COLS) // 12 % 2 * 0.8 + 0.1).astype(np.float32)[None, :, None], ROWS, axis=0)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=150, rows=ROWS, cols=COLS))
    return to_scanlines(Frame(pixels=pixels, clipped=np.zeros(pixels.shape, bool)), camera)


def _path(view: View) -> Trajectory:
    timing = view.camera.timing
    coefficients = np.array([[0.0, 0.0], [SWAY, 0.0]])
    return centred(Polynomial(t0=0.0, t1=timing.interval[1], coefficients=coefficients), timing.middle)


def test_it_lies_between_the_straightened_frame_and_the_restored_one() -> None:
    view = _view()
    latent = np.full_like(view.pixels, 0.5)
    straight, mixed = rectified(view, _path(view)).pixels, doubtful.restored(view, _path(view), latent, 0.6)
    np.testing.assert_allclose(mixed - straight, 0.6 * (latent - straight), atol=1e-6)


def test_edges_stay_single_where_the_restored_frame_is_the_straightened_one() -> None:
    view = _view()
    straight = rectified(view, _path(view)).pixels
    assert np.abs(straight - view.pixels).max() > 0.5  # the shutter displaced them
    np.testing.assert_allclose(doubtful.restored(view, _path(view), straight, 0.6), straight, atol=1e-6)


def test_what_exceeds_white_in_the_restored_frame_does_not_count() -> None:
    view = _view()
    mixed = doubtful.restored(view, _path(view), np.full_like(view.pixels, 5.0), 0.6)
    assert mixed.max() <= 1.1  # of Lanczos beside edges


def test_short_blurs_and_doubtful_ones_are_restored_in_part() -> None:
    shares = [doubtful.share(Verdict.RESTORED, blur) for blur in (0.5, 3.0, 4.0, 5.0, 30.0)]
    assert shares == pytest.approx([0.5, 0.6, 0.8, 1.0, 1.0])
    assert doubtful.share(Verdict.DOUBTFUL, 30.0) == doubtful.PART
    assert doubtful.share(Verdict.DOUBTFUL, 4.0) == pytest.approx(0.8 * doubtful.PART)


@pytest.mark.parametrize("verdict", [Verdict.RESTORED, Verdict.DOUBTFUL])
@pytest.mark.parametrize("times", [1.0, 0.4])
def test_a_frame_shows_the_part_of_its_restoration_that_is_due(verdict: Verdict, times: float, monkeypatch: pytest.MonkeyPatch) -> None:
    view = _view()
    path = _path(view).with_coefficients(times * 4 * _path(view).coefficients)  # 5.7 px within an exposure, or 2.3
    speaks = Evidence(rest=0.3, mirror=4.0, wobble=2.0, focus=4.0)
    found = Estimate(stage="path", fraction=1.0, trajectory=path, evidence=speaks)
    monkeypatch.setattr(single_frame, "judge", lambda *_: verdict)
    shown = single_frame.restored(view, Settings(prior="tv"), estimate=lambda *_: iter([found]))
    whole = single_frame.restored(view, Settings(prior="tv"), path=path).latent
    part = doubtful.share(verdict, longest(view.camera, path))
    assert shown.verdict is verdict
    np.testing.assert_allclose(shown.latent, doubtful.restored(view, path, whole, part) if part < 1 else whole, atol=1e-5)
    assert (np.abs(shown.latent - whole).max() > 0.05) == (part < 1)
