"""A gyroscope's log becomes a clip's motion, once its clock and its axes are known; both are found where the clip tells them."""

from dataclasses import replace

import numpy as np
import pytest

from rsvideo.baselines.gyro import RIGHT_ANGLES, aligned, first, log_path, movement, refined
from rsvideo.physics import gyro
from rsvideo.physics.gyro import GyroLog, camera_from_gyro
from rsvideo.physics.shutter import Direction
from rsvideo.restoration import clip_motion
from rsvideo.restoration.clip_motion import Run
from rsvideo.restoration.movement import Movement
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import gcsv
from tests.pipeline.moving import Moving

STEP = 0.004  # s


def recorded(moving: Moving, axes: str = "XYZ", *, early: float = 0.0, late: float = 0.0, scale: float = 1.0, bias: float = 0.0) -> GyroLog:
    """What a gyroscope with such axes records of the motion, from `early` s before the clip to `late` s behind it, where it is idle."""
    t = np.arange(-early, moving.path.t1 + late, STEP)
    inside = (t >= 0) & (t <= moving.path.t1)
    fine = np.linspace(0, moving.path.t1, 400)
    angles = gyro.angles_from_poses(moving.path.at(fine), camera=moving.lens)
    rates = 0.02 * np.random.default_rng(0).standard_normal((len(t), 3))
    rates[inside] = gcsv.rates(fine, angles, t[inside]) * scale + bias
    return GyroLog(times=t - t[0], rates=rates @ camera_from_gyro(axes))


def seen(moving: Moving, *, blur: bool = False) -> Run:
    return clip_motion.gather(moving.recorded, moving.camera, Settings(), blur=blur)


def off(found: Movement, moving: Moving) -> float:
    """px, RMS over all frames."""
    t = np.linspace(*moving.timing.interval, 33)
    squares = []
    for k, way in enumerate(found.within):
        assert way is not None
        true = moving.way(k)
        apart = (way.at(t) - (true.at(t) - true.at(np.array([moving.timing.middle]))))[:, :2]
        squares.append((apart**2).sum(axis=1).mean())
    return float(np.sqrt(np.mean(squares)))


@pytest.mark.parametrize("direction", list(Direction))
def test_a_log_tells_the_motion_within_and_between_frames_in_image_axes(direction: Direction) -> None:
    moving = Moving(frames=4, direction=direction)
    log = recorded(moving, "yZx", early=0.5, late=0.1)
    found = movement(log, moving.begins, moving.camera, offset=0.5, axes="yZx")
    assert off(found, moving) < 0.1
    middles = moving.path.at(moving.begins + moving.timing.middle)
    np.testing.assert_allclose(found.steps[:-1], np.diff(middles, axis=0), atol=0.1)
    np.testing.assert_array_equal(found.steps[-1], 0)
    assert found.tied == [True, True, True, False]
    assert off(movement(log, moving.begins, moving.camera, offset=0.5), moving) > 1.5
    assert off(movement(log, moving.begins, moving.camera, offset=0.54, axes="yZx"), moving) > 1.5


def test_no_step_leads_across_a_cut() -> None:
    moving = Moving(frames=3)
    found = movement(recorded(moving), moving.begins, moving.camera, offset=0.0, tied=[False, True, False])
    assert [bool(step.any()) for step in found.steps] == [False, True, False]


def test_there_are_24_ways_for_axes_to_lie() -> None:
    assert len(set(RIGHT_ANGLES)) == 24
    assert "XYZ" in RIGHT_ANGLES
    assert "xYZ" not in RIGHT_ANGLES  # left-handed


@pytest.mark.parametrize(("axes", "direction"), [("XYZ", Direction.TOP_TO_BOTTOM), ("yZx", Direction.RIGHT_TO_LEFT)])
def test_clock_and_axes_are_found_from_how_points_move(axes: str, direction: Direction) -> None:
    moving = Moving(frames=8, direction=direction)
    found = aligned(recorded(moving, axes, early=1.3333, late=2.0), seen(moving))
    assert found.axes == axes
    assert found.offset == pytest.approx(1.3333, abs=2e-3)
    assert found.residual < 0.1 * found.moved
    assert found.another > 2 * found.residual
    assert found.spread < 2e-3


def test_what_is_known_of_clock_and_axes_is_not_sought() -> None:
    moving = Moving(frames=6)
    log, run = recorded(moving, "yZx", early=0.4, late=0.4), seen(moving)
    assert aligned(log, run, offset=0.4).axes == "yZx"
    assert aligned(log, run, offset=0.4).offset == 0.4
    assert aligned(log, run, axes="yZx").offset == pytest.approx(0.4, abs=1e-3)
    with pytest.raises(ValueError, match="explain how the clip moves"):
        aligned(log, run, axes="yZx", between=(0.1, 0.3))
    with pytest.raises(ValueError, match="explain how the clip moves"):
        aligned(log, run, axes="XYZ")


def test_a_clip_that_hardly_moves_tells_nothing() -> None:
    moving = Moving(frames=3, reach=0.2)
    moving.path.coefficients[:, 2] = 0
    with pytest.raises(ValueError, match=r"the clip must move for a gyro log to be aligned with it, points move by 0\.\d+ px"):
        aligned(recorded(moving), seen(moving))
    with pytest.raises(ValueError, match="no point could be followed"):
        aligned(recorded(moving), seen(Moving(frames=1)))


def test_two_answers_that_fit_alike_are_told() -> None:
    moving = Moving(frames=5)
    once = recorded(moving)
    rates = np.vstack([once.rates, once.rates])
    twice = GyroLog(times=STEP * np.arange(len(rates)), rates=rates)
    with pytest.raises(ValueError, match=r"place cannot be told: offset .* leaves .* px, offset .* give one of them"):
        aligned(twice, seen(moving))


def test_another_clips_log_does_not_fit() -> None:
    moving = Moving(frames=6)
    other = Moving(frames=12, reach=10.0)
    t = np.linspace(other.path.t0, other.path.t1, len(other.path.coefficients))
    strange = np.stack([np.sin(31 * t), np.cos(17 * t + 1), 0.02 * np.sin(23 * t)], axis=1) * [9, 7, 1]
    other.path.coefficients[:] = strange
    with pytest.raises(ValueError, match="is it another clip's, or was the clip stabilised"):
        aligned(recorded(other), seen(moving))


@pytest.mark.parametrize("offset", [-0.5, 0.4])
def test_a_log_that_does_not_cover_the_clip_is_refused_with_the_times(offset: float) -> None:
    moving = Moving(frames=4)
    log = recorded(moving)
    with pytest.raises(ValueError, match=r"must cover the clip from 0 to 0\.165 s, with an offset of .* s it covers .* to .* s"):
        movement(log, moving.begins, moving.camera, offset=offset)
    with pytest.raises(ValueError, match="must cover the clip"):
        aligned(log, seen(moving), offset=offset)
    short = replace(log, times=log.times[:20], rates=log.rates[:20])
    with pytest.raises(ValueError, match=r"must cover the 0\.165 s of the clip that are looked at, it lasts 0\.076 s"):
        aligned(short, seen(moving))


def test_a_log_that_is_too_slow_is_refused() -> None:
    moving = Moving(frames=3)
    log = GyroLog(times=np.arange(20) * 0.05, rates=np.zeros((20, 3)))
    for asked in (lambda: movement(log, moving.begins, moving.camera, offset=0.0), lambda: aligned(log, seen(moving))):
        with pytest.raises(ValueError, match="at least 40 samples a second to tell motion within a frame, got 20"):
            asked()


@pytest.mark.parametrize("direction", [Direction.TOP_TO_BOTTOM, Direction.LEFT_TO_RIGHT])
def test_points_and_blur_correct_a_log_that_is_wrong_by_a_little(direction: Direction) -> None:
    moving = Moving(frames=5, direction=direction)
    run = seen(moving, blur=True)
    wrong = recorded(moving, late=0.02, scale=1.2, bias=0.05)
    plain = movement(wrong, moving.begins, moving.camera, offset=0.003)
    better = refined(wrong, run, offset=0.003)
    assert off(plain, moving) > 0.5
    assert off(better, moving) < 0.6 * off(plain, moving)
    middles = moving.path.at(moving.begins + moving.timing.middle)
    left = [np.abs((found.steps[:-1] - np.diff(middles, axis=0))[:, :2]).max() for found in (plain, better)]
    assert left[1] < 0.5 * left[0]


def test_a_logs_path_is_known_along_the_scanlines_to_a_fraction_of_a_pixel() -> None:
    moving = Moving(frames=3, direction=Direction.RIGHT_TO_LEFT)
    path = log_path(recorded(moving, late=0.02), seen(moving), offset=0.0)
    t = np.linspace(0, moving.path.t1, 50)
    along = (moving.path.at(t) - moving.path.at(t).mean(axis=0)) @ moving.timing.direction.pose_from_scanlines
    assert np.abs((path.spline.at(t) - path.spline.at(t).mean(axis=0) - along)[:, :2]).max() < 0.5
    spread = np.sqrt(np.diag(np.linalg.inv(path.precision)))[::3]
    assert np.isfinite(spread).all()
    start = first(moving.way(0))
    assert start.drift < 1
    assert start.share < 0.2
