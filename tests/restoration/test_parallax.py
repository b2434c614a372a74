"""What points do beyond the camera's path becomes a smooth field of velocities, or none."""

from dataclasses import replace

import numpy as np

from rsvideo.physics import tiles
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.restoration.parallax import Flow, Points, concatenated, flows

ROWS, COLS, PERIOD = 120, 200, 1 / 24
CLEAR = 0.08  # px, of tracking
GRID = np.stack(np.meshgrid(np.linspace(20, 180, 9), np.linspace(20, 100, 5)), axis=-1).reshape(-1, 2)


def near(at: np.ndarray) -> np.ndarray:
    """px/s over a scene whose right side is nearer than its left."""
    return np.stack([60 / (1 + np.exp((100 - at[:, 0]) / 12)), -0.1 * at[:, 1]], axis=1)


def sighted(seed: int, *, count: int = 250, moving: bool = True) -> Points:
    """Points as tracking sees them."""
    rng = np.random.default_rng(seed)
    at = rng.uniform([0, 0], [COLS, ROWS], (count, 2))
    elapsed = PERIOD + rng.uniform(-0.01, 0.01, count)
    moved = near(at) * elapsed[:, None] if moving else np.zeros_like(at)
    return Points(at=at, moved=moved + rng.normal(0, CLEAR, (count, 2)), elapsed=elapsed)


def sure(found: Flow | None) -> Flow:
    assert found is not None
    return found


def off(found: Flow) -> float:
    """px/s RMS, between the points."""
    return float(np.sqrt(((found.at(GRID) - near(GRID)) ** 2).sum(axis=1).mean()))


def test_points_give_back_the_field_between_them() -> None:
    exact = float(np.sqrt((near(GRID) ** 2).sum(axis=1).mean()))
    for found in flows([sighted(k) for k in range(3)], COLS):
        assert off(sure(found)) < 2 * CLEAR / PERIOD < exact / 8


def test_a_few_points_that_lie_do_not_bend_it() -> None:
    honest = sighted(0)
    rng = np.random.default_rng(1)
    lies = np.where(rng.random((len(honest.at), 1)) < 0.08, rng.uniform(-6, 6, honest.moved.shape), 0)
    assert np.count_nonzero(lies[:, 0]) > 10
    (clear,), (bent,) = flows([honest], COLS), flows([replace(honest, moved=honest.moved + lies)], COLS)
    assert off(sure(bent)) < 1.5 * off(sure(clear)) + 0.5


def test_no_field_where_points_follow_the_path_or_there_are_none() -> None:
    nothing = concatenated([])
    assert len(nothing.at) == 0
    assert flows([sighted(k, moving=False) for k in range(3)], COLS) == [None] * 3
    assert flows([nothing], COLS) == [None]
    assert flows([], COLS) == []
    first, second, third = flows([sighted(0), nothing, sighted(1)], COLS)
    assert (first is None, second is None, third is None) == (False, True, False)


def test_errors_that_are_alike_from_point_to_point_are_no_field_by_themselves() -> None:
    """A blurred point is found aside, and so is its neighbour."""
    rng = np.random.default_rng(2)
    clear = sighted(0, moving=False)
    groups = rng.uniform([0, 0], [COLS, ROWS], (12, 2))
    nearest = np.linalg.norm(clear.at[:, None] - groups, axis=2).argmin(axis=1)
    shared = rng.normal(0, 0.06, (12, 2))[nearest]
    assert flows([replace(clear, moved=clear.moved + shared)], COLS) == [None]


def test_far_from_every_point_nothing_is_said() -> None:
    (found,) = flows([sighted(0)], COLS)
    np.testing.assert_allclose(sure(found).at(np.array([[40.0 * COLS, 0.0]])), 0, atol=1e-3)


def test_the_field_is_the_same_in_a_smaller_picture_and_in_some_of_its_columns() -> None:
    found = sure(flows([sighted(0)], COLS)[0])
    np.testing.assert_allclose(found.scaled(0.5).at((GRID - 0.5) / 2), found.at(GRID) / 2, rtol=1e-6)
    np.testing.assert_allclose(found.from_column(40).at(GRID - (40, 0)), found.at(GRID), rtol=1e-6)


def test_a_field_that_changes_across_the_picture_needs_more_tiles() -> None:
    camera = Camera(
        timing=ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS),
        intrinsics=Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS),
    )
    found = sure(flows([sighted(0)], COLS)[0])
    even = replace(found, points=np.zeros((1, 2)), weights=np.full((1, 2), 100.0), length=1e9)
    assert [one.tiles_needed(camera, 0.25) for one in (even, found)] == [1, COLS // tiles.NARROWEST]
    assert found.tiles_needed(camera, 2.0) < COLS // tiles.NARROWEST


def test_time_counts_not_frames() -> None:
    honest = sighted(0)
    slow = replace(honest, elapsed=2 * honest.elapsed)
    (found,), (halved,) = flows([honest], COLS), flows([slow], COLS)
    np.testing.assert_allclose(sure(halved).at(GRID), 0.5 * sure(found).at(GRID), atol=1e-9)


def test_points_of_the_frame_before_and_of_the_next_count_alike() -> None:
    first, second = sighted(0, count=100), sighted(1, count=60)
    both = concatenated([first, second])
    assert (len(both.at), len(both.moved), len(both.elapsed)) == (160, 160, 160)
    np.testing.assert_array_equal(both.at[100:], second.at)
