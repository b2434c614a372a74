import numpy as np
import pytest

from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, still
from rsvideo.restoration import search
from rsvideo.restoration.scene import Scene

ROWS, COLS = 40, 60
TIMING = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)


def straight(length: float) -> Polynomial:
    """A path to the right."""
    path = still(TIMING.interval, degree=2, axes=2)
    return path.with_coefficients(np.array([[0, 0], [length, 0], [0, 0]], float))


@pytest.fixture
def scene() -> Scene:
    camera = Camera(timing=TIMING, intrinsics=Intrinsics.centred(focal=60, rows=ROWS, cols=COLS))
    grey = np.full((ROWS, COLS), 0.5, np.float32)
    return Scene(frame=grey, valid=np.ones_like(grey), camera=camera, samples=4, tiles=1, noise=0.01)


def test_the_least_values_go_on_and_the_best_focus_whatever_its_value(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    runners = [search._Runner(trajectory=straight(length), value=length) for length in (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)]
    depth = {1.0: 0.1, 2.0: 0.0, 3.0: 0.2, 4.0: 0.0, 5.0: 0.9, 6.0: 0.1}
    monkeypatch.setattr(search, "focus_value", lambda _, path: depth[round(float(path.coefficients[1, 0]), 6)])
    going = search._going_on(runners, scene, 3)
    assert [runner.value for runner in going] == [1.0, 2.0, 3.0, 5.0]  # 5 and 3 are in best focus, and 3 goes on by its value too
    assert search._going_on(runners, scene, 6) == runners
