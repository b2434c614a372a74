"""Kernels of strips, rendered from a known path, give the path back."""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from rsvideo.physics.camera import Camera, Intrinsics, turned
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory
from rsvideo.restoration.psf_fit import Strip, fit, length, reach

ROWS, COLS, SIZE = 200, 320, 41
CAMERA = Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS)
ROLLING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
GLOBAL = ShutterTiming.from_readout(exposure=0.02, readout=0.0, rows=ROWS)
SHIFT = np.array([[0.0, 0.0], [8.0, 3.0], [1.5, -3.0], [-0.6, 0.9]])
COARSE = 8e-3


def path(timing=ROLLING, coefficients=SHIFT):
    return Polynomial(t0=0.0, t1=timing.interval[1], coefficients=coefficients)


def rendered(curve: Trajectory, timing, first, last, middle):
    """The mean PSF of a strip's scanlines, each about its own centroid: a pixel that moves by p leaves its light at -p."""
    kernel = np.zeros((SIZE, SIZE), np.float32)
    for row in range(first, last, 4):
        t = row * timing.row_time + (np.arange(100) + 0.5) / 100 * timing.exposure
        at = -turned(CAMERA, np.full(100, middle), np.full(100, float(row)), curve.at(t))
        at += SIZE // 2 - at.mean(axis=0)
        for x, y in at:
            c, r = int(np.floor(x)), int(np.floor(y))
            a, b = x - c, y - r
            kernel[r : r + 2, c : c + 2] += np.outer([1 - b, b], [1 - a, a])
    return Strip(first=first, last=last, middle=middle, kernel=kernel / kernel.sum())


def strips(curve, timing=ROLLING, middles=((COLS - 1) / 2,)):
    return [rendered(curve, timing, first, first + 72, m) for first in (0, 32, 64, 96, 128) for m in middles]


def apart(one: Trajectory, other: Trajectory):
    """RMS distance over the interval, px, constants apart: of a strip's kernel nothing tells the pose."""
    t = np.linspace(one.t0, one.t1, 101)
    d = (one.at(t) - other.at(t))[:, :2]
    return float(np.sqrt(((d - d.mean(axis=0)) ** 2).sum(axis=1).mean()))


def backwards(curve: Polynomial):
    """The same path, run through from its end."""
    return curve.with_coefficients(curve.coefficients * np.array([1, -1, 1, -1])[:, None])


@pytest.mark.slow
def test_the_path_is_found_back_and_overlapping_exposures_tell_its_sense_of_time():
    true = path()
    found = fit(strips(true), Camera(timing=ROLLING, intrinsics=CAMERA), degree=3, stiffness=COARSE)
    assert apart(found[0].trajectory, true) < 0.5
    assert apart(backwards(path()), true) > 5
    assert found[0].energy < 0.02
    wrong = [c.energy for c in found if apart(c.trajectory, true) > 2]
    assert all(e > 2 * found[0].energy for e in wrong)


@pytest.mark.slow
def test_candidates_are_distinct_and_come_best_first():
    found = fit(strips(path()), Camera(timing=ROLLING, intrinsics=CAMERA), degree=3, stiffness=COARSE, keep=4)
    assert [c.energy for c in found] == sorted(c.energy for c in found)
    assert len(found) > 1
    for i, c in enumerate(found):
        assert all(np.abs(c.trajectory.coefficients - other.trajectory.coefficients).max() > 0.3 for other in found[:i])


def test_a_global_shutter_does_not_tell_the_sense_of_time():
    true = path(GLOBAL)
    whole = [rendered(true, GLOBAL, 0, ROWS, (COLS - 1) / 2)]
    forth = fit(whole, Camera(timing=GLOBAL, intrinsics=CAMERA), degree=3, stiffness=1e-4, start=true)[0]
    back = fit(whole, Camera(timing=GLOBAL, intrinsics=CAMERA), degree=3, stiffness=1e-4, start=backwards(true))[0]
    assert back.energy == pytest.approx(forth.energy, rel=1e-3)
    assert apart(forth.trajectory, true) < 0.5
    assert apart(back.trajectory, backwards(true)) < 0.5


def test_roll_is_told_from_the_left_and_right_halves():
    true = path(coefficients=np.hstack([SHIFT, [[0.0], [0.03], [-0.008], [0.0]]]))
    flat = path(coefficients=np.hstack([SHIFT, np.zeros((4, 1))]))
    halves = strips(true, middles=(79.5, 239.5))
    found = fit(halves, Camera(timing=ROLLING, intrinsics=CAMERA), degree=3, stiffness=1e-3, keep=1, start=flat)[0]
    np.testing.assert_allclose(found.trajectory.coefficients[1:, 2], [0.03, -0.008, 0.0], atol=0.004)
    assert found.energy < 0.05


def test_a_strip_whose_kernel_failed_is_ignored():
    true = path()
    good = strips(true)
    bad = np.zeros((SIZE, SIZE), np.float32)
    bad[np.arange(12, 29), np.arange(28, 11, -1)] = 1 / 17  # as long as the others, and across them
    found = fit(
        [*good[:2], Strip(first=64, last=136, middle=good[2].middle, kernel=bad), *good[3:]],
        Camera(timing=ROLLING, intrinsics=CAMERA),
        degree=3,
        stiffness=COARSE,
    )
    assert apart(found[0].trajectory, true) < 0.5


@pytest.mark.slow
def test_a_kernel_that_is_too_short_misleads_and_the_others_without_it_do_not():
    true = path()
    good = strips(true)
    short = cv2.resize(good[0].kernel, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
    short = np.pad(short, (SIZE - len(short)) // 2)
    first = replace(good[0], kernel=short / short.sum())
    with_it, without = (
        fit([first, *good[1:]], Camera(timing=ROLLING, intrinsics=CAMERA), degree=3, stiffness=2e-3, without=w)[0].trajectory
        for w in (None, 0)
    )
    assert apart(without, true) < 0.6
    assert apart(with_it, true) > 2 * apart(without, true)


def test_the_curvature_is_that_of_the_energy_and_grows_with_the_stiffness():
    c = fit(strips(path()), Camera(timing=ROLLING, intrinsics=CAMERA), degree=3, stiffness=COARSE)[0].curvature
    assert c.shape == (6, 6)
    np.testing.assert_allclose(c, c.T, rtol=1e-9)
    assert np.linalg.eigvalsh(c).min() > 0
    stiffer = fit(strips(path()), Camera(timing=ROLLING, intrinsics=CAMERA), degree=3, stiffness=10 * COARSE)[0].curvature
    assert np.trace(stiffer) > np.trace(c)


@pytest.mark.parametrize("angle", [0.0, 0.7, 2.2])
def test_the_length_of_a_straight_kernel_is_the_paths(angle):
    direction = np.array([np.cos(angle), np.sin(angle)]) * 15 / np.sqrt(12)
    strip = rendered(path(GLOBAL, np.array([[0, 0], direction])), GLOBAL, 0, 72, 100.0)
    assert length(strip.kernel) == pytest.approx(15, abs=0.3)
    assert reach([strip, strip]) == pytest.approx(15, abs=0.3)
