"""Tracing strip kernels gives back the path that made them."""

import numpy as np
import pytest

from rsvideo.paper.tracing import trace, traced_curve
from rsvideo.physics.blur import BlurOperator
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial
from rsvideo.restoration.psf_fit import Strip

ROWS = 240
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
PATHS = {
    "arc": [[0, 0], [9, 2], [-3, 5], [0, 0], [0, 0]],
    "bend": [[0, 0], [4, -8], [5, 2], [1, 1], [0, 0]],
    "quartic": [[0, 0], [10, 5], [-3, 4], [1.5, -1], [0.4, 0.3]],
}


def path(name):
    return Polynomial(t0=0.0, t1=TIMING.interval[1], coefficients=np.array(PATHS[name], float))


def strips_of(trajectory, count=6):
    """The true PSFs of the strips' middle scanlines."""
    camera = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=1000.0, rows=ROWS, cols=80))
    K = BlurOperator.covering(trajectory, camera=camera, samples=60)
    height = ROWS // (count - 1)
    firsts = np.linspace(0, ROWS - height, count).astype(int)
    return [Strip(first=int(f), last=int(f) + height, middle=40.0, kernel=K.psf(int(f) + height // 2, 40)) for f in firsts]


def error(found, true):
    """px RMS, the mean removed."""
    t = np.linspace(*TIMING.interval, 101)
    apart = found.at(t) - true.at(t)
    return float(np.sqrt(((apart - apart.mean(axis=0)) ** 2).sum(axis=1).mean()))


@pytest.mark.parametrize("name", PATHS)
def test_the_path_comes_back_in_the_right_sense_of_time(name):
    true = path(name)
    found = trace(strips_of(true), TIMING, degree=4)
    backwards = true.with_coefficients(-true.coefficients)
    assert error(found, true) < 2
    assert error(found, backwards) > 5


def test_the_middle_of_the_frame_is_the_origin():
    found = trace(strips_of(path("arc")), TIMING, degree=3)
    np.testing.assert_allclose(found.at(np.array([TIMING.middle])), 0, atol=1e-12)
    assert found.coefficients.shape == (4, 2)


def test_strips_may_sit_anywhere():
    strips = strips_of(path("quartic"))
    moved = [
        Strip(first=s.first, last=s.last, middle=s.middle, kernel=np.pad(s.kernel, ((0, 2 * n), (2 * n, 0)))) for n, s in enumerate(strips)
    ]
    one, two = (trace(s, TIMING, degree=4) for s in (strips, moved))
    np.testing.assert_allclose(one.coefficients, two.coefficients, atol=1e-6)


def test_a_line_is_traced_from_end_to_end_and_evenly():
    kernel = np.zeros((21, 21))
    kernel[10, 3:18] = 1 / 15
    points, intensity = traced_curve(kernel)
    columns = points[:, 1] if points[0, 1] < points[-1, 1] else points[::-1, 1]
    np.testing.assert_array_equal(np.diff(columns), 1)
    np.testing.assert_allclose(points[:, 0], 10)
    assert columns[0] <= 5
    assert columns[-1] >= 15
    np.testing.assert_allclose(intensity[2:-2], intensity[len(intensity) // 2], rtol=1e-6)


def test_a_spur_is_left_out():
    kernel = np.zeros((25, 25))
    kernel[12, 2:23] = 1
    kernel[8:12, 12] = 1
    points, _ = traced_curve(kernel / kernel.sum())
    assert np.abs(points[:, 0] - 12).max() <= 1
    assert np.ptp(points[:, 1]) >= 16


def test_the_slow_end_takes_the_longer_time():
    kernel = np.zeros((21, 21))
    kernel[10, 3:10], kernel[10, 10:18] = 3, 1
    points, intensity = traced_curve(kernel / kernel.sum())
    left = intensity[points[:, 1] < 10].sum() / intensity.sum()
    assert left == pytest.approx(21 / 29, abs=0.06)


def test_a_point_is_a_path_that_does_not_move():
    kernel = np.zeros((9, 9))
    kernel[4, 4] = 1
    strips = [Strip(first=f, last=f + 60, middle=40.0, kernel=kernel) for f in (0, 60, 120, 180)]
    found = trace(strips, TIMING, degree=3)
    assert np.abs(found.coefficients).max() < 1.5


def test_no_strips_are_refused():
    with pytest.raises(ValueError, match="at least 1 strip"):
        trace([], TIMING, degree=4)
