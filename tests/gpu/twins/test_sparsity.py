"""The objective of a path and its derivative are the processor's, of one tile and of several."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
import skimage.data

from rsvideo.gpu import arrays, sparsity
from rsvideo.gpu.arrays import to_host, xp
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory
from rsvideo.restoration import sparsity as twin
from rsvideo.restoration.focus import focus_map
from rsvideo.restoration.scene import Scene

LARGE = not arrays.SIMULATED
ROWS, COLS, SAMPLES = (144, 200, 16) if LARGE else (6, 10, 2)
SHIFT = np.array([[0.0, 0.0], [2.0, -1.0], [0.7, 0.5]])
TURN = np.hstack([SHIFT, [[0.0], [0.02], [-0.01]]])


@pytest.fixture
def scene(monkeypatch: pytest.MonkeyPatch) -> Scene:
    """A photograph, its brightest pixels clipped; so small that nearly all of it is measured."""
    if not LARGE:
        monkeypatch.setattr(twin, "BORDER", (1, 1))
    camera = Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS)
    timing = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
    frame = ((skimage.data.astronaut()[60 : 60 + ROWS, 160 : 160 + COLS].mean(axis=2) / 255) ** 2.2).astype(np.float32)
    valid = (frame < np.quantile(frame, 0.95)).astype(np.float32)
    return Scene(frame=frame, valid=valid, camera=Camera(timing=timing, intrinsics=camera), samples=SAMPLES, tiles=2, noise=2e-3)


def path(scene: Scene, coefficients: np.ndarray) -> Trajectory:
    return Polynomial(t0=0.0, t1=scene.camera.timing.interval[1], coefficients=coefficients)


@pytest.mark.parametrize(("coefficients", "error"), [(SHIFT, 1e-5), (TURN, 2e-3)], ids=["one tile", "two tiles on one grid"])
def test_the_objective_and_its_derivative_are_the_processors(scene: Scene, coefficients: np.ndarray, error: float) -> None:
    moved, ridge = path(scene, coefficients), scene.ridge
    value, gradient = twin.objective(scene, moved, ridge)
    there, slope = twin.objective(replace(scene, device="cuda"), moved, ridge)
    assert there == pytest.approx(value, rel=error)
    np.testing.assert_allclose(slope, gradient, atol=5 * error * np.abs(gradient).max())


def test_what_each_pixel_adds_is_the_processors(scene: Scene) -> None:
    moved, ridge = path(scene, SHIFT), scene.search_ridge
    for one, other in zip(twin.density(replace(scene, device="cuda"), moved, ridge), twin.density(scene, moved, ridge), strict=True):
        np.testing.assert_allclose(one, other, atol=1e-4)


def test_the_focus_about_each_pixel_is_the_processors(scene: Scene) -> None:
    there, here = (focus_map(replace(scene, device=device), path(scene, SHIFT), 5) for device in ("cuda", "cpu"))
    np.testing.assert_allclose(there.about, here.about, atol=1e-4 * np.abs(here.about).max())
    assert there.whole == pytest.approx(here.whole, rel=1e-3, abs=1e-6)


def test_the_mean_over_a_window_is_opencvs() -> None:
    image = np.random.default_rng(0).random((60, 70)).astype(np.float32)
    expected = cv2.boxFilter(image, -1, (49, 49), borderType=cv2.BORDER_CONSTANT)
    np.testing.assert_allclose(to_host(sparsity.box(xp.asarray(image), 49)), expected, rtol=1e-5)
