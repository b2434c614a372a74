"""One path through a run of frames: what tracks say of it, what blur adds, and how its pieces join."""

from dataclasses import replace

import numpy as np
import pytest

from rsvideo.physics.camera import Intrinsics, turned
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Spline, Trajectory, fit
from rsvideo.restoration.blind import Settings
from rsvideo.restoration.clip import follow, joined, movement, windows, within
from rsvideo.restoration.tracks import Tracks
from tests.pipeline.moving import RATE, Moving

CAMERA = Intrinsics.centred(focal=300.0, rows=120, cols=160)
TIMING = ShutterTiming.from_readout(exposure=0.01, readout=0.03, rows=120)
BEGINS = np.arange(8) / 24
END = float(BEGINS[-1]) + TIMING.interval[1]


def spline(t: np.ndarray, poses: np.ndarray, terms: int = 40) -> Spline:
    found = fit(Spline(t0=0.0, t1=END, coefficients=np.zeros((terms, poses.shape[1]))), t, poses)
    assert isinstance(found, Spline)
    return found


def sway(axes: int) -> Spline:
    """Some 4 Hz, as a hand does, on top of a pan to the right."""
    t = np.linspace(0, END, 400)
    x = 60 * t + 6 * np.sin(2 * np.pi * 4 * t)
    y = 8 * np.cos(2 * np.pi * 3 * t)
    roll = 0.02 * np.sin(2 * np.pi * 2.5 * t)
    return spline(t, np.stack([x, y, roll], axis=1)[:, :axes])


def sights(path: Trajectory, begin: float, points: np.ndarray, timing: ShutterTiming) -> np.ndarray:
    """Where a frame shows points of the latent image: each moved by the mean over its own row's exposure."""
    at = points.copy()
    for _ in range(30):
        lines = at[:, 1:] if timing.direction is Direction.TOP_TO_BOTTOM else timing.rows - 1 - at[:, 1:]
        poses = path.at(lines * timing.row_time + timing.sample_times(16)[0] + begin)
        moves = turned(CAMERA, np.repeat(at[:, :1], 16, 1), np.repeat(at[:, 1:], 16, 1), poses)
        at = points - moves.mean(axis=1)
    return at


def exact(path: Trajectory, timing: ShutterTiming = TIMING) -> list[Tracks]:
    """Tracks without an error: between neighbours, of points that both show."""
    x, y = np.meshgrid(np.linspace(-40, 220, 16), np.linspace(-40, 160, 14))
    points = np.stack([x.ravel(), y.ravel()], axis=1)
    seen = [sights(path, float(t), points, timing) for t in BEGINS]
    inside = [((s > 2) & (s < [CAMERA.cols - 3, CAMERA.rows - 3])).all(axis=1) for s in seen]
    return [Tracks(before=seen[k][both], after=seen[k + 1][both]) for k in range(7) for both in [inside[k] & inside[k + 1]]]


def apart(found: Trajectory, true: Trajectory) -> float:
    """px RMS at the corners, where the path begins left out; frames' own times only."""
    t = (BEGINS[:, None] + np.linspace(*TIMING.interval, 9)).ravel()
    difference = found.at(t) - true.at(t)
    difference -= difference.mean(axis=0)
    return float(np.sqrt(((difference * [1, 1, 100][: difference.shape[1]]) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("axes", [2, 3])
def test_exact_tracks_give_back_the_path(axes: int) -> None:
    true = sway(axes)
    found = follow(exact(true), BEGINS, TIMING, CAMERA, axes).spline
    assert apart(found, true) < (0.05 if axes == 2 else 0.3)
    assert apart(found, true.with_coefficients(-true.coefficients)) > 10


def test_a_camera_that_moves_right_moves_the_image_left() -> None:
    t = np.linspace(0, END, 50)
    tracks = exact(spline(t, np.outer(t, [100.0, 0.0]), 8))
    assert all((pair.after[:, 0] < pair.before[:, 0] - 3).all() for pair in tracks)
    found = follow(tracks, BEGINS, TIMING, CAMERA, 2).spline
    speed = np.diff(found.at(BEGINS + TIMING.middle), axis=0) * 24
    np.testing.assert_allclose(speed, [[100.0, 0.0]] * 7, atol=2)


def test_rows_observed_at_another_time_give_a_worse_path() -> None:
    true = sway(2)
    tracks = exact(true)
    right = apart(follow(tracks, BEGINS, TIMING, CAMERA, 2).spline, true)
    for wrong in (replace(TIMING, row_time=0.0), replace(TIMING, row_time=0.5 * TIMING.row_time)):
        spread = replace(wrong, exposure=TIMING.interval[1] - wrong.readout)  # the same interval
        assert apart(follow(tracks, BEGINS, spread, CAMERA, 2).spline, true) > 20 * right


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

    found = follow([pair], np.zeros(2), TIMING, CAMERA, 2, backwards=(1,)).spline
    assert off(found) < 0.2
    assert off(follow([pair], np.zeros(2), TIMING, CAMERA, 2).spline) > 0.5


def test_a_few_points_that_lie_do_not_bend_the_path() -> None:
    true = sway(3)
    tracks = exact(true)
    rng = np.random.default_rng(0)
    liars = [t.after + np.where(rng.random((len(t.after), 1)) < 0.1, rng.uniform(-6, 6, t.after.shape), 0) for t in tracks]
    lied = [Tracks(before=t.before, after=after) for t, after in zip(tracks, liars, strict=True)]
    assert apart(follow(lied, BEGINS, TIMING, CAMERA, 3).spline, true) < 0.7


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


def pieces(path: Trajectory, timing: ShutterTiming) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """The motion within each frame and from each to the next."""
    local = np.linspace(*timing.interval, 60)
    middles = path.at(BEGINS + timing.middle)
    each = [(local, path.at(local + t) - middle) for t, middle in zip(BEGINS, middles, strict=True)]
    return each, np.vstack([np.diff(middles, axis=0), np.zeros((1, middles.shape[1]))])


def test_pieces_of_a_path_join_to_the_path() -> None:
    path = sway(3)
    t, poses = joined(BEGINS, *pieces(path, TIMING), TIMING)
    assert t[0] == 0
    assert t[-1] == pytest.approx(END, abs=1.1e-3)
    difference = (poses - path.at(t))[:, :2]
    assert np.abs(difference - difference.mean(axis=0)).max() < 1.0  # of a sway of 14 px
    at_middles = np.stack([np.interp(BEGINS + TIMING.middle, t, column) for column in poses.T], axis=1)
    np.testing.assert_allclose(at_middles - at_middles[0], path.at(BEGINS + TIMING.middle) - path.at(np.array([TIMING.middle])), atol=0.02)


def test_pieces_that_disagree_fade_into_each_other() -> None:
    each, steps = pieces(sway(2), TIMING)
    bent = [(t, poses * (1.5 if k % 2 else 0.7)) for k, (t, poses) in enumerate(each)]
    t, poses = joined(BEGINS, bent, steps, TIMING)
    speed = np.abs(np.diff(poses, axis=0)).max() / np.diff(t).max()
    assert speed < 3 * np.abs(np.diff(sway(2).at(t), axis=0)).max() / np.diff(t).max()


@pytest.mark.parametrize("direction", list(Direction))
def test_motion_comes_back_in_image_axes_whichever_way_the_rows_are_read(direction: Direction) -> None:
    moving = Moving(frames=5, direction=direction, reach=9.0)
    told: list[int] = []
    found = movement(moving.recorded, moving.timing, moving.camera, Settings(), told.append)
    assert told == [0, 1, 2, 3, 4]
    middles = moving.path.at(moving.begins + moving.timing.middle)
    np.testing.assert_allclose(found.steps[:-1, :2], np.diff(middles, axis=0)[:, :2], atol=0.6)
    np.testing.assert_array_equal(found.steps[-1], 0)
    t = np.linspace(*moving.timing.interval, 33)
    for k, way in enumerate(found.within):
        assert way is not None
        true, wrong = (moving.way(k).at(t) - middles[k])[:, :2], way.at(t)[:, :2]
        outermost = k in (0, 4)  # which nothing before, or behind, holds in place
        assert np.sqrt(((wrong - true) ** 2).sum(axis=1).mean()) < (1.2 if outermost else 0.6)
        if np.linalg.norm(np.ptp(true, axis=0)) > 3:
            assert np.sqrt(((wrong + true) ** 2).sum(axis=1).mean()) > 2


def test_a_cut_ends_one_path_and_frames_without_a_neighbour_stand_alone() -> None:
    first, second = Moving(frames=3, reach=6.0), Moving(frames=3, reach=6.0, scene="coins")
    frames = first.recorded[:2] + [replace(f, time=(k + 2) / RATE, index=k + 2) for k, f in enumerate(second.recorded[:1])]
    found = movement(frames, first.timing, first.camera, Settings(), lambda _: None)
    assert [way is None for way in found.within] == [False, False, True]
    np.testing.assert_array_equal(found.steps[1:], 0)
    assert np.abs(found.steps[0]).max() > 1
    alone = movement(frames[2:], first.timing, first.camera, Settings(), lambda _: None)
    assert alone.within == [None]
    np.testing.assert_array_equal(alone.steps, np.zeros((1, 3)))
