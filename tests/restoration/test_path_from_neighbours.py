"""All frames of a run together correct its path where points leave it in doubt."""

from dataclasses import replace

import numpy as np
import pytest

from rsvideo.physics.trajectory import fit
from rsvideo.restoration import path_from_neighbours
from rsvideo.restoration.camera_path import CameraPath, trusted, within
from rsvideo.restoration.path_from_neighbours import Taken, corrected, small
from rsvideo.restoration.scanlines import to_scanlines
from tests.pipeline.moving import RATE, Moving

MOVING = Moving(frames=5, reach=20.0)


def taken(path: CameraPath, groups: tuple[int, ...] = (0,) * 5) -> list[Taken]:
    """The frames along a path."""
    every = zip(MOVING.recorded, groups, strict=True)
    return [Taken.of(small(to_scanlines(frame, MOVING.camera)), MOVING.camera, frame.time, path, group, None) for frame, group in every]


def wrong() -> CameraPath:
    """A path with a wobble that repeats from frame to frame, so that no point shows it; by as much it may be wrong."""
    spline = MOVING.path
    t = np.linspace(spline.t0, spline.t1, 400)
    poses = spline.at(t)
    poses[:, 0] += 0.7 * np.sin(2 * np.pi * RATE * (t - MOVING.timing.middle))
    found = fit(spline, t, poses)
    return trusted(spline.with_coefficients(found.coefficients), MOVING.camera, drift=1.5, share=0.0)


def errors(path: CameraPath) -> np.ndarray:
    """Px RMS, of the displacement of each frame's scanlines against its middle."""
    timing, found = MOVING.timing, []
    times = timing.sample_times(16)
    for begins in MOVING.begins:
        cut, middle = within(path.spline, float(begins), timing), MOVING.path.at(np.array([begins + timing.middle]))
        apart = cut.at(times).mean(axis=1) - (MOVING.path.at(times + begins).mean(axis=1) - middle)
        found.append(np.sqrt((apart[:, :2] ** 2).sum(axis=1).mean()))
    return np.array(found)


@pytest.fixture(scope="module")
def together() -> CameraPath:
    return corrected(wrong(), taken(wrong()), 3)


@pytest.mark.slow
def test_a_wobble_that_no_point_shows_is_taken_away(together: CameraPath) -> None:
    before, after = errors(wrong()), errors(together)
    assert before.min() > 0.3
    assert after.mean() < 0.5 * before.mean()


@pytest.mark.slow
def test_a_right_path_stays() -> None:
    right = replace(wrong(), spline=MOVING.path)
    assert errors(corrected(right, taken(right), 3)).max() < 0.15


@pytest.mark.slow
def test_a_path_that_is_sure_stays() -> None:
    sure = replace(wrong(), precision=1e4 * wrong().precision)
    np.testing.assert_allclose(corrected(sure, taken(sure), 3).spline.coefficients, sure.spline.coefficients, atol=0.05)


def test_frames_without_neighbours_correct_nothing() -> None:
    path = wrong()
    np.testing.assert_array_equal(corrected(path, taken(path, (0, 1, 2, 3, 4)), 3).spline.coefficients, path.spline.coefficients)


@pytest.mark.parametrize("limits", [{"SHORT": 100.0}, {"WEAKER": 2.0, "STRONG": 3.0}, {"LEAST_SHOWN": 1.1}])
def test_blur_too_short_or_weak_and_too_small_a_part_correct_nothing(monkeypatch: pytest.MonkeyPatch, limits: dict[str, float]) -> None:
    for number, limit in limits.items():
        monkeypatch.setattr(path_from_neighbours, number, limit)
    path = wrong()
    np.testing.assert_array_equal(corrected(path, taken(path), 3).spline.coefficients, path.spline.coefficients)


@pytest.mark.slow
def test_large_frames_are_compared_at_half_their_size(monkeypatch: pytest.MonkeyPatch, together: CameraPath) -> None:
    whole = taken(together)[2]
    monkeypatch.setattr(path_from_neighbours, "LARGEST", MOVING.cols // 2)
    halves = taken(wrong())
    assert halves[2].view.pixels.shape == (MOVING.rows // 2, MOVING.cols // 2, 1)
    assert halves[2].length == pytest.approx(whole.length / 2, rel=0.3)
    assert errors(corrected(wrong(), halves, 3)).mean() < 0.75 * errors(wrong()).mean()
