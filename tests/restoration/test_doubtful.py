"""A frame for whose path little speaks is restored in part, and straightened wholly."""

import numpy as np
import pytest

from rsvideo.frame import Frame, Verdict
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory, centred
from rsvideo.restoration import doubtful, single_frame
from rsvideo.restoration.estimate import Estimate
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
    straight, mixed = rectified(view, _path(view)).pixels, doubtful.restored(view, _path(view), latent)
    np.testing.assert_allclose(mixed - straight, doubtful.PART * (latent - straight), atol=1e-6)


def test_edges_stay_single_where_the_restored_frame_is_the_straightened_one() -> None:
    view = _view()
    straight = rectified(view, _path(view)).pixels
    assert np.abs(straight - view.pixels).max() > 0.5  # the shutter displaced them
    np.testing.assert_allclose(doubtful.restored(view, _path(view), straight), straight, atol=1e-6)


def test_what_exceeds_white_in_the_restored_frame_does_not_count() -> None:
    view = _view()
    mixed = doubtful.restored(view, _path(view), np.full_like(view.pixels, 5.0))
    assert mixed.max() <= 1.1  # of Lanczos beside edges


def test_a_frame_in_doubt_is_shown_so(monkeypatch: pytest.MonkeyPatch) -> None:
    view = _view()
    found = Estimate(stage="path", fraction=1.0, trajectory=_path(view))
    shown = {}
    for verdict in (Verdict.RESTORED, Verdict.DOUBTFUL):
        monkeypatch.setattr(single_frame, "judge", lambda *_, verdict=verdict: verdict)
        shown[verdict] = single_frame.restored(view, Settings(prior="tv"), estimate=lambda *_: iter([found]))
        assert shown[verdict].verdict is verdict
    whole, part = (shown[verdict].latent for verdict in (Verdict.RESTORED, Verdict.DOUBTFUL))
    np.testing.assert_allclose(part, doubtful.restored(view, _path(view), whole), atol=1e-5)
    assert np.abs(part - whole).max() > 0.05
