"""How sharply a path is in focus, and how far a restoration along it is followed."""

from dataclasses import replace

import numpy as np
import pytest

from rsvideo.physics.trajectory import Trajectory, centred
from rsvideo.restoration.camera_path import within
from rsvideo.restoration.extent import longest
from rsvideo.restoration.focus import Focus, focus, focus_map, focus_value
from rsvideo.restoration.scanlines import to_scanlines
from rsvideo.restoration.scene import Scene, reduced, scene_of
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.trust import FULL_VOTE, LONG, SHORT, UNSEEN, agreement, run_share, trust
from rsvideo.restoration.verdict import across
from tests.pipeline.moving import Moving

MOVING = Moving(frames=8, rows=128, cols=192)


@pytest.fixture(scope="module")
def blurred() -> tuple[Scene, Trajectory]:
    """A frame, and its true path as a polynomial."""
    k = 3
    scene = scene_of(to_scanlines(MOVING.recorded[k], MOVING.camera), Settings())
    return scene, centred(within(MOVING.path, float(MOVING.begins[k]), MOVING.timing), MOVING.timing.middle)


def test_the_true_path_is_in_focus_and_others_are_not(blurred: tuple[Scene, Trajectory]) -> None:
    scene, true = blurred
    sharp = focus(scene, true)[0]
    assert sharp > 0.005
    for other in (0.6 * true.coefficients, 1.6 * true.coefficients, across(true).coefficients):
        assert focus(scene, true.with_coefficients(other))[0] < 0.5 * sharp


def test_the_derivative_is_that_of_the_value(blurred: tuple[Scene, Trajectory]) -> None:
    scene, true = blurred
    start = true.with_coefficients(0.9 * true.coefficients)
    start.coefficients[0] = 0
    gradient = focus(scene, start)[1]
    for term, axis in ((1, 0), (1, 1), (2, 0)):
        step = np.zeros_like(start.coefficients)
        step[term, axis] = 0.1
        rise = focus(scene, start.with_coefficients(start.coefficients + step))[0]
        rise -= focus(scene, start.with_coefficients(start.coefficients - step))[0]
        assert gradient[term, axis] == pytest.approx(rise / 0.2, rel=0.3)


def test_a_restoration_is_followed_where_its_path_is_in_focus(blurred: tuple[Scene, Trajectory]) -> None:
    scene, true = blurred
    length = longest(scene.camera, true)
    assert length > LONG
    assert trust(scene, true, length, 1.0).mean() > 0.8
    assert trust(scene, across(true), length, 1.0).mean() < 0.4
    assert not trust(scene, true, SHORT, 1.0).any()


def test_a_frame_that_is_out_of_focus_as_a_whole_is_restored_nowhere(blurred: tuple[Scene, Trajectory]) -> None:
    scene, true = blurred
    wrong = true.with_coefficients(1.6 * true.coefficients)
    seen = focus_map(scene, wrong, 32)
    assert seen.about.shape == scene.frame.shape
    assert seen.whole == pytest.approx(focus_value(scene, wrong), abs=1e-3)
    assert seen.whole < 0 < seen.about.max()
    assert seen.surely < 0
    assert not trust(scene, wrong, longest(scene.camera, wrong), 1.0).any()


@pytest.mark.parametrize(("surely", "shares"), [(8.0, [1.0, 1.0, 1.0]), (2.5, [0.0, 1.0, 1.0]), (1.5, [0.0, 0.5, 1.0]), (-3.0, [0.0] * 3)])
def test_a_path_that_nothing_makes_certain_must_be_in_focus_for_sure(
    surely: float, shares: list[float], blurred: tuple[Scene, Trajectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, path = blurred
    seen = Focus(about=np.full(scene.frame.shape, 0.01, np.float32), whole=0.01, surely=surely)
    monkeypatch.setattr("rsvideo.restoration.trust.focus_map", lambda *_: seen)
    found = [trust(scene, path, longest(scene.camera, path), certain).mean() for certain in (0.0, 0.5, 1.0)]
    np.testing.assert_allclose(found, shares, atol=1e-6)


@pytest.mark.parametrize(
    ("about", "length", "certainty", "shares"),
    [
        (-0.001, 9.0, 1.0, [0.2, 0.9]),
        (0.01, 1.8, 1.0, [0.2, 0.8 / 1.5]),
        (0.01, 1.8, 0.1, [0.2, 0.35 / 1.5]),  # as at a run's end: blur so short may be the path's error
        (-0.01, 9.0, 1.0, [0.0, 0.0]),
    ],
)
def test_regions_have_to_show_less_where_the_clips_blur_has_shown_its_exposure(
    about: float, length: float, certainty: float, shares: list[float], blurred: tuple[Scene, Trajectory], monkeypatch: pytest.MonkeyPatch
) -> None:
    scene, path = blurred
    seen = Focus(about=np.full(scene.frame.shape, about, np.float32), whole=0.01, surely=8.0)
    monkeypatch.setattr("rsvideo.restoration.trust.focus_map", lambda *_: seen)
    found = [trust(scene, path, length, certainty, exposure_shown).mean() for exposure_shown in (False, True)]
    np.testing.assert_allclose(found, shares, atol=1e-6)


def test_where_no_neighbour_shows_the_place_the_path_must_be_certain() -> None:
    shown = np.arange(60)[None] < np.full((40, 1), 30)
    explained = np.where(shown, np.float32(0.8), np.float32(0))
    astray = np.zeros(shown.shape, bool)
    shares = [agreement(explained, shown, astray, certainty)[20, [5, 55]].tolist() for certainty in (0.05, 0.3, 0.9)]
    np.testing.assert_allclose(shares, [[1, 0], [1, 0.5 * UNSEEN], [1, UNSEEN]], atol=1e-6)
    assert not agreement(explained, shown, ~astray, 0.9).any()


def test_a_run_is_restored_where_its_frames_agree_that_it_is_in_focus() -> None:
    assert run_share([0.004] * 4) == run_share([0.01] * 20 + [-0.02]) == 1.0
    assert run_share([0.004, -0.01, 0.02, -0.013]) == 0.0
    assert 0.0 < run_share([0.004, 0.004, 0.0]) < 0.5
    assert run_share([0.004]) == run_share([0.0]) == run_share([]) == 0.0


def test_a_single_blurred_frame_is_restored_where_it_is_plainly_in_focus() -> None:
    assert run_share([0.02]) == 1.0
    assert 0.0 < run_share([0.01]) < 1.0


def test_a_frame_votes_for_its_own_path_and_against_others(blurred: tuple[Scene, Trajectory]) -> None:
    scene, true = blurred
    assert focus_value(scene, true) > FULL_VOTE
    for other in (across(true), true.with_coefficients(2 * true.coefficients)):
        assert focus_value(scene, other) < 0


def test_a_scene_of_long_blur_is_made_smaller_and_its_path_sampled_at_every_pixel(blurred: tuple[Scene, Trajectory]) -> None:
    scene = blurred[0]
    large = replace(scene, frame=np.tile(scene.frame, (4, 3)), valid=np.tile(scene.valid, (4, 3)))
    assert reduced(large, 20.0).scale == 1.0
    assert reduced(large, 40.0).scale == 0.5
    assert reduced(large, 40.0).samples >= 20
    assert reduced(scene, 40.0).samples >= 40  # too small to be halved


def test_half_a_frame_that_does_not_move_along_is_told_apart(blurred: tuple[Scene, Trajectory]) -> None:
    scene, true = blurred
    still = MOVING.truth[3].astype(np.float32) / 255
    cols = scene.frame.shape[1] // 2
    frame = scene.frame.copy()
    frame[:, :cols] = (still[:, :cols] ** 2.2) / max(float((still**2.2).max()), 1e-6)
    share = trust(replace(scene, frame=frame), true, longest(scene.camera, true), 1.0)
    assert share[:, : cols - 30].mean() < 0.5 * share[:, cols + 30 :].mean()
