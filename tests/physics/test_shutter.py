"""When each row of a frame collects light."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsvideo.physics.shutter import Direction, ShutterTiming

directions = pytest.mark.parametrize("direction", list(Direction), ids=[d.value for d in Direction])
# the pixel (row, col) of a 3 x 4 image that is read first, and the one after it on the next scanline
FIRST = {
    Direction.TOP_TO_BOTTOM: ((0, 0), (1, 0)),
    Direction.BOTTOM_TO_TOP: ((2, 0), (1, 0)),
    Direction.LEFT_TO_RIGHT: ((0, 0), (0, 1)),
    Direction.RIGHT_TO_LEFT: ((0, 3), (0, 2)),
}


@directions
def test_scanlines_come_in_the_order_they_are_read(direction):
    image = np.arange(12).reshape(3, 4)
    lines = direction.scanlines(image)
    assert (lines[0, 0], lines[1, 0]) == tuple(image[at] for at in FIRST[direction])


@pytest.mark.parametrize("direction", Direction)
def test_the_opposite_direction_reads_the_last_scanline_first(direction):
    image = np.arange(12).reshape(3, 4)
    np.testing.assert_array_equal(direction.opposite.scanlines(image), direction.scanlines(image)[::-1])


@directions
def test_image_is_the_inverse_of_scanlines(direction):
    image = np.arange(24).reshape(3, 4, 2)
    np.testing.assert_array_equal(direction.image(direction.scanlines(image)), image)
    assert direction.scanlines(image).shape[2] == 2


@directions
def test_a_pose_along_the_scanlines_is_turned_as_their_axes_are(direction):
    rows, cols = np.meshgrid(np.arange(3.0), np.arange(4.0), indexing="ij")
    along, across = direction.scanlines(cols), direction.scanlines(rows)
    x_axis = np.array([along[0, 1] - along[0, 0], across[0, 1] - across[0, 0]])  # the image's (x, y) of a step along a scanline
    y_axis = np.array([along[1, 0] - along[0, 0], across[1, 0] - across[0, 0]])
    P = direction.pose_from_scanlines
    np.testing.assert_array_equal(P[:2, :2], np.stack([x_axis, y_axis], axis=1))
    assert P[2, 2] == np.linalg.det(P[:2, :2])  # a reflection turns the sense of rotation
    assert not P[2, :2].any()
    assert not P[:2, 2].any()


def test_a_scanline_opens_one_row_time_after_the_one_before():
    timing = ShutterTiming(exposure=0.02, row_time=50e-6, rows=400)
    np.testing.assert_allclose(np.diff(timing.row_start()), 50e-6)
    assert timing.row_start()[0] == 0
    assert timing.readout == pytest.approx(0.02)


def test_the_middle_is_half_of_readout_and_exposure():
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.03, rows=300)
    assert timing.interval == pytest.approx((0, 0.04))
    assert timing.middle == pytest.approx(0.02)
    assert timing.row_time == pytest.approx(1e-4)


def test_a_global_shutter_opens_all_scanlines_at_once():
    timing = ShutterTiming.from_readout(exposure=0.01, readout=0.0, rows=300)
    assert not timing.row_start().any()
    assert timing.interval == (0, 0.01)


@given(samples=st.integers(1, 64), slope=st.floats(-10, 10))
def test_sample_times_integrate_linear_motion_exactly(samples, slope):
    timing = ShutterTiming(exposure=0.02, row_time=1e-4, rows=5)
    times = timing.sample_times(samples)
    assert times.shape == (5, samples)
    np.testing.assert_allclose((slope * times).mean(axis=1), slope * (timing.row_start() + 0.01), atol=1e-12)
    assert (times > timing.row_start()[:, None]).all()
    assert (times < timing.row_start()[:, None] + timing.exposure).all()


@pytest.mark.parametrize(
    ("exposure", "row_time", "rows", "slip"),
    [
        (20.0, 1e-4, 100, "exposure .* milliseconds"),
        (0.0, 1e-4, 100, "exposure"),
        (-0.02, 1e-4, 100, "exposure"),
        (float("nan"), 1e-4, 100, "exposure"),
        (float("inf"), 1e-4, 100, "exposure"),
        (0.02, 0.2, 100, "readout .* milliseconds"),
        (0.02, -1e-4, 100, "readout"),
        (0.02, float("nan"), 100, "readout"),
        (0.02, 1e-4, 0, "rows"),
    ],
)
def test_an_absurd_timing_names_the_slip(exposure, row_time, rows, slip):
    with pytest.raises(ValueError, match=slip):
        ShutterTiming(exposure=exposure, row_time=row_time, rows=rows)


@pytest.mark.parametrize(("seconds", "lasts"), [(0.05, 0.05), (0.03, 0.03), (0.004, 0.025)])
def test_a_longer_readout_makes_an_interval_last_and_a_long_one_stays(seconds: float, lasts: float) -> None:
    timing = ShutterTiming.from_readout(exposure=0.005, readout=0.02, rows=40)
    longer = timing.lasting(seconds)
    assert longer.interval[1] == pytest.approx(lasts)
    assert (longer.exposure, longer.rows) == (timing.exposure, timing.rows)
