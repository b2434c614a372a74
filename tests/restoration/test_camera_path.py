"""One path through a run of frames, from the points that move between them."""

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from rsvideo.physics.camera import Camera
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory
from rsvideo.restoration import camera_path
from rsvideo.restoration.camera_path import (
    CameraPath,
    blur_certainties,
    certainties,
    doubts,
    follow,
    unexplained,
    windows,
    within,
)
from rsvideo.restoration.tracks import Tracks
from rsvideo.restoration.trust import blur_share
from tests.restoration.swaying import BEGINS, CAMERA, END, TIMING, exact, sights, spline, sway

TAKEN = Camera(timing=TIMING, intrinsics=CAMERA)
NOTHING = Tracks(before=np.zeros((0, 2)), after=np.zeros((0, 2)))


def apart(found: Trajectory, true: Trajectory) -> float:
    """px RMS at the corners, where the path begins left out; frames' own times only."""
    t = (BEGINS[:, None] + np.linspace(*TIMING.interval, 9)).ravel()
    difference = found.at(t) - true.at(t)
    difference -= difference.mean(axis=0)
    return float(np.sqrt(((difference * [1, 1, 100][: difference.shape[1]]) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("axes", [2, 3])
def test_exact_tracks_give_back_the_path(axes: int) -> None:
    true = sway(axes)
    found = follow(exact(true), BEGINS, TAKEN, axes).spline
    assert apart(found, true) < (0.05 if axes == 2 else 0.3)
    assert apart(found, true.with_coefficients(-true.coefficients)) > 10


def test_a_camera_that_moves_right_moves_the_image_left() -> None:
    t = np.linspace(0, END, 50)
    tracks = exact(spline(t, np.outer(t, [100.0, 0.0]), 8))
    assert all((pair.after[:, 0] < pair.before[:, 0] - 3).all() for pair in tracks)
    found = follow(tracks, BEGINS, TAKEN, 2).spline
    speed = np.diff(found.at(BEGINS + TIMING.middle), axis=0) * 24
    np.testing.assert_allclose(speed, [[100.0, 0.0]] * 7, atol=2)


def test_rows_observed_at_another_time_give_a_worse_path() -> None:
    true = sway(2)
    tracks = exact(true)
    right = apart(follow(tracks, BEGINS, TAKEN, 2).spline, true)
    for wrong in (replace(TIMING, row_time=0.0), replace(TIMING, row_time=0.5 * TIMING.row_time)):
        spread = replace(wrong, exposure=TIMING.interval[1] - wrong.readout)  # the same interval
        assert apart(follow(tracks, BEGINS, replace(TAKEN, timing=spread), 2).spline, true) > 20 * right


def test_two_views_of_one_moment_read_in_opposite_ways_tell_the_path_within_it() -> None:
    true = sway(2)
    x, y = np.meshgrid(np.linspace(5, 155, 12), np.linspace(-15, 135, 12))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    down = sights(true, 0.0, points, TIMING)
    backwards = replace(TIMING, direction=Direction.BOTTOM_TO_TOP)
    up = sights(true, 0.0, points, backwards)
    pair = Tracks(before=down, after=up)
    t = np.linspace(0.15, 0.85, 20) * TIMING.interval[1]

    def off(found: Trajectory) -> float:
        difference = found.at(t) - true.at(t)
        return float(np.abs(difference - difference.mean(axis=0)).max())

    found = follow([pair], np.zeros(2), TAKEN, 2, backwards=(1,)).spline
    assert off(found) < 0.2
    assert off(follow([pair], np.zeros(2), TAKEN, 2).spline) > 0.5


def test_a_few_points_that_lie_do_not_bend_the_path() -> None:
    true = sway(3)
    tracks = exact(true)
    rng = np.random.default_rng(0)
    liars = [t.after + np.where(rng.random((len(t.after), 1)) < 0.1, rng.uniform(-6, 6, t.after.shape), 0) for t in tracks]
    lied = [Tracks(before=t.before, after=after) for t, after in zip(tracks, liars, strict=True)]
    assert apart(follow(lied, BEGINS, TAKEN, 3).spline, true) < 0.7


def test_a_jerk_bends_the_path_where_it_is_and_nowhere_else(monkeypatch: pytest.MonkeyPatch) -> None:
    t = np.linspace(0, END, 4000)
    jerked = sway(2).at(t)
    starts = float(BEGINS[4]) + 0.6 * TIMING.interval[1]
    jerked[:, 0] += 400 * np.clip(t - starts, 0, None)  # px/s, of a camera that is pushed within a frame
    true = spline(t, jerked, terms=300)
    tracks = exact(true)

    def apart_within(frame: int) -> float:
        cut, local = within(follow(tracks, BEGINS, TAKEN, 2).spline, float(BEGINS[frame]), TIMING), np.linspace(*TIMING.interval, 30)
        return float(np.abs(cut.at(local) - within(true, float(BEGINS[frame]), TIMING).at(local)).max())

    followed = [apart_within(k) for k in (1, 4)]
    monkeypatch.setattr(camera_path, "JERK", np.inf)
    alike = [apart_within(k) for k in (1, 4)]
    assert followed[1] < 0.6 * alike[1]
    assert followed[0] < max(0.1, 1.1 * alike[0])


def test_windows_give_the_polynomial_nearest_to_the_path() -> None:
    t = np.linspace(0, END, 200)
    cubic = spline(t, np.stack([50 * t**3 - 9 * t, 30 * t * t], axis=1), 12)
    for begin in BEGINS:
        inside = Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=windows(cubic, float(begin), TIMING) @ cubic.coefficients)
        local = np.linspace(*TIMING.interval, 30)
        np.testing.assert_allclose(inside.at(local), cubic.at(local + begin), atol=1e-9)


def test_a_frame_takes_its_part_of_the_path_with_the_middle_as_origin() -> None:
    path = sway(3)
    local = np.linspace(*TIMING.interval, 30)
    for begin in BEGINS:
        part = within(path, float(begin), TIMING)
        whole = path.at(local + begin) - path.at(np.array([TIMING.middle + begin]))
        np.testing.assert_allclose(part.at(local), whole, atol=1e-3)
        np.testing.assert_allclose(part.at(np.array([TIMING.middle])), 0, atol=1e-12)


def test_a_point_that_moves_by_itself_leaves_that_motion_and_the_others_nothing() -> None:
    path, speed, walker = sway(3), np.array([30.0, -12.0]), 5  # px/s
    still, lines = exact(path), np.arange(TIMING.rows)
    walked = [Tracks(before=t.before, after=t.after.copy()) for t in still]
    for k, (first, second) in enumerate(zip(still, walked, strict=True)):
        opens = np.interp([first.before[walker, 1], first.after[walker, 1]], lines, TIMING.row_start())
        second.after[walker] += speed * (BEGINS[k + 1] - BEGINS[k] + opens[1] - opens[0])
    for moved, elapsed in unexplained(path, walked, BEGINS, TAKEN):
        others = np.delete(moved, walker, axis=0)
        assert np.abs(others).max() < 0.12  # of the linear model, over steps of up to 15 px
        np.testing.assert_allclose(moved[walker], speed * elapsed[walker], atol=0.12)
        assert np.linalg.norm(moved[walker]) > 0.8


def test_depth_that_lasts_is_no_wobble_of_the_path() -> None:
    true = sway(3)

    def nearer_below(points: np.ndarray) -> np.ndarray:  # what moves sideways past the camera moves more, the nearer it is
        return np.stack([3.0 * (points[:, 1] / CAMERA.rows) ** 2, np.zeros(len(points))], axis=1)

    tracks = [replace(pair, after=pair.after + nearer_below(pair.after)) for pair in exact(true)]
    found = follow(tracks, BEGINS, TAKEN, 3).spline
    inside = np.linspace(*TIMING.interval, 9)
    for begin in BEGINS[[0, -1]]:
        difference = (found.at(begin + inside) - true.at(begin + inside))[:, :2]
        assert np.ptp(difference, axis=0).max() < 2.0


def test_no_part_of_a_path_is_without_a_prior() -> None:
    rng = np.random.default_rng(0)
    x, y = np.meshgrid(np.linspace(5, 155, 14), np.linspace(5, 115, 12))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    tracks = [Tracks(before=points, after=points + rng.normal(0, 0.2, points.shape)) for _ in BEGINS[:-1]]
    found = follow(tracks, BEGINS, TAKEN, 3).spline
    reach = [np.ptp(within(found, float(t), TIMING).at(np.linspace(*TIMING.interval, 17))[:, :2], axis=0).max() for t in BEGINS]
    assert max(reach) < 1.0


@pytest.mark.parametrize(("exposure", "readout"), [(2e-3, 8e-3), (2e-3, 1e-3), (5e-4, 1e-4), (5e-4, 0.0)])
def test_the_path_of_short_exposures_is_right_and_its_equations_no_larger_and_no_worse_than_of_half_a_period(
    exposure: float, readout: float
) -> None:
    true = sway(2)

    def followed(readout: float) -> tuple[CameraPath, np.ndarray]:
        timing = ShutterTiming.from_readout(exposure=exposure, readout=readout, rows=120)
        path = follow(exact(true, timing), BEGINS, replace(TAKEN, timing=timing), 2)
        return path, path.spline.at(BEGINS + timing.middle) - true.at(BEGINS + timing.middle)

    (found, off), (longer, _) = followed(readout), followed(1 / 48 - exposure)
    assert np.ptp(off, axis=0).max() < 0.1
    assert len(found.precision) <= len(longer.precision)
    assert np.linalg.cond(found.precision) < 1.5 * np.linalg.cond(longer.precision)


def test_frames_that_follow_each_other_fast_have_a_path_no_finer_than_a_hand_moves() -> None:
    begins, timing, true = np.arange(8) / 240, ShutterTiming.from_readout(exposure=3e-3, readout=1e-3, rows=120), sway(2)
    x, y = np.meshgrid(np.linspace(20, 140, 12), np.linspace(20, 100, 12))
    seen = [sights(true, float(t), np.stack([x.ravel(), y.ravel()], axis=1), timing) for t in begins]
    tracks = [Tracks(before=before, after=after) for before, after in pairwise(seen)]
    found = follow(tracks, begins, replace(TAKEN, timing=timing), 2)
    off = found.spline.at(begins + timing.middle) - true.at(begins + timing.middle)
    assert np.ptp(off, axis=0).max() < 0.1
    assert len(found.precision) <= 2 * (4 + (begins[-1] + timing.interval[1]) / camera_path.FINEST)
    np.linalg.cholesky(found.precision)


def test_displacements_are_certain_where_points_show_them_and_uncertain_where_none_do() -> None:
    half_seen = follow(exact(sway(3))[:4] + [NOTHING] * 3, BEGINS, TAKEN, 3)
    shares = certainties(half_seen, BEGINS, [True] * 4 + [False] * 4, TIMING)
    assert shares[1:4].min() > 0.9
    assert shares[5:].max() < 0.1
    assert max(shares[0], shares[4]) < shares[1:4].min()  # at the ends points show one side alone


def test_blur_is_certain_where_points_show_it_and_uncertain_where_none_do() -> None:
    half_seen = follow(exact(sway(3))[:4] + [NOTHING] * 3, BEGINS, TAKEN, 3)
    shares = blur_certainties(half_seen, BEGINS, TIMING)
    assert shares[1:4].min() > 0.85
    assert shares[5:].max() < 0.1
    np.testing.assert_array_equal(blur_share(shares)[[1, 2, 3, 5, 6, 7]], [1, 1, 1, 0, 0, 0])


@pytest.mark.parametrize(
    "sure", [lambda path: certainties(path, BEGINS, [True] * 8, TIMING), lambda path: blur_certainties(path, BEGINS, TIMING)]
)
def test_a_motion_twice_as_large_is_as_certain_as_its_power_says(sure: Callable[[CameraPath], np.ndarray]) -> None:
    path = follow(exact(sway(2)), BEGINS, TAKEN, 2)
    twice = replace(path, spline=path.spline.with_coefficients(2 * path.spline.coefficients))
    once, more = sure(path), sure(twice)
    np.testing.assert_allclose(more / (1 - more), 4 * once / (1 - once))


@pytest.mark.parametrize("axes", [2, 3])
def test_what_is_in_doubt_of_a_path_spreads_as_its_covariance_says(axes: int) -> None:
    path, begins = follow(exact(sway(axes)), BEGINS, TAKEN, axes), float(BEGINS[3])
    loose = replace(path, precision=path.precision / 100)
    found = doubts(loose, begins, TIMING)
    lengths = np.linalg.norm(found.moves, axis=(1, 2))
    assert (np.diff(lengths) <= 0).all()
    assert not found.moves[:, 0].any()  # neither where the frame begins,
    assert not found.moves[..., 2:].any()  # nor roll
    move = windows(loose.spline, begins, TIMING)
    draws = np.linalg.solve(np.linalg.cholesky(loose.precision).T, np.random.default_rng(0).normal(size=(len(loose.precision), 4000))).T
    drawn = np.einsum("tc,nca->nta", move, draws.reshape(len(draws), -1, axes))[:, 1:, :2]
    assert (lengths**2).sum() == pytest.approx((drawn**2).sum(axis=(1, 2)).mean(), rel=0.1)  # the shortest are left out
    counts = draws @ found.of_path.T
    np.testing.assert_allclose(np.cov(counts.T), np.eye(len(counts.T)), atol=0.1)
    left = drawn - np.einsum("nd,dta->nta", counts, found.moves[:, 1:, :2])
    assert (left**2).sum() < 0.05 * (drawn**2).sum()


def test_a_shear_is_made_of_the_doubts_that_displace_the_last_scanline_by_it() -> None:
    path = follow(exact(sway(2)), BEGINS, TAKEN, 2)
    found = doubts(replace(path, precision=path.precision / 100), float(BEGINS[3]), TIMING)
    every = np.einsum("da,dtb->atb", found.shear, found.moves)
    for axis, coefficients in enumerate(every):
        bent = Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=coefficients)
        first, last = bent.at(TIMING.sample_times(16)[[0, -1]]).mean(axis=1)
        np.testing.assert_allclose(last - first, np.eye(2)[axis], atol=0.1)


def test_a_sure_path_and_one_read_at_once_are_in_doubt_as_they_should_be() -> None:
    path, begins = follow(exact(sway(3)), BEGINS, TAKEN, 3), float(BEGINS[3])
    assert len(doubts(replace(path, precision=path.precision * 1e9), begins, TIMING).moves) == 0
    at_once = ShutterTiming(exposure=TIMING.exposure, row_time=0.0, rows=TIMING.rows)  # no scanline is displaced against another
    found = doubts(replace(path, precision=path.precision / 100), begins, at_once)
    assert len(found.moves)
    assert np.isfinite(found.moves).all()
    np.testing.assert_array_equal(found.shear, 0)
