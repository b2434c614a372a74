import numpy as np
import pytest

from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, still
from rsvideo.restoration import search
from rsvideo.restoration.evidence import Evidence
from rsvideo.restoration.scene import WINDOW_COLS, Scene
from rsvideo.restoration.spectral_paths import SpectralBelief
from rsvideo.restoration.spectrum import SIDE, Spectrum, patches

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


def unused_belief() -> SpectralBelief:
    """What the spectra of some frame say."""
    grey = np.random.default_rng(0).random((2 * SIDE, 3 * SIDE), np.float32)
    timing = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=2 * SIDE)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=200, rows=2 * SIDE, cols=3 * SIDE))
    scene = Scene(frame=grey, valid=np.ones_like(grey), camera=camera, samples=4, tiles=1, noise=0.01)
    found = patches(scene)
    assert found is not None
    return SpectralBelief(spectrum=Spectrum(scene=scene, patches=found, curve=still(timing.interval, degree=2, axes=2)))


@pytest.mark.parametrize(
    ("exact", "led", "right", "mirror"),
    [
        (20.0, -9.0, 5.0, 20.0),  # plain: the mirror image has no second chance
        (5.0, 2.5, 5.0, 2.5),  # the less that speaks counts
        (2.5, 5.0, 5.0, 2.5),
        (5.0, -3.0, -4.0, 3.0),  # led as closely, the mirror image is the sparser
        (-5.0, 4.0, -5.0, 4.0),  # and here it was so from the start
    ],
)
def test_a_mirror_image_that_is_led_as_closely_may_win(
    exact: float, led: float, right: float, mirror: float, scene: Scene, monkeypatch: pytest.MonkeyPatch
) -> None:
    def taken(path: Polynomial, *_: object) -> search._Led:
        """The winner leads 5 px to the right, its mirror image 4 px to the left."""
        return search._Led(trajectory=straight(5.0 if path.coefficients[1, 0] > 0 else -4.0), rest=0.2, values=())

    def found(_part: Scene, _whole: Scene, path: Polynomial, rest: float) -> Evidence:
        speaks = {5.0: exact, -5.0: -exact, -4.0: 9.0}
        return Evidence(rest=rest, mirror=speaks[float(path.coefficients[1, 0])], wobble=1.0, focus=4.0)

    monkeypatch.setattr(search, "_led", taken)
    monkeypatch.setattr(search, "evidence", found)
    monkeypatch.setattr(search, "sparser", lambda *_: led)
    everywhere = search._Resolutions(part=scene, trial=scene, coarse=scene, fine=scene, whole=scene)
    answer = search._answer(straight(5.0), everywhere, unused_belief())
    assert answer.trajectory.coefficients[1, 0] == right
    assert answer.evidence is not None
    assert answer.evidence.mirror == mirror


@pytest.mark.parametrize(
    ("length", "part", "whole"),
    [
        (8.0, (WINDOW_COLS, 300, 1.0), (1920, 300, 1.0)),  # halved, it would be too short
        (20.0, (WINDOW_COLS, 150, 0.5), (1920, 300, 1.0)),
        (60.0, (WINDOW_COLS, 150, 0.5), (960, 150, 0.5)),  # longer blurs are searched at half the resolution anyway
    ],
)
def test_the_direction_is_looked_for_in_all_columns_of_twice_the_resolution(
    length: float, part: tuple[int, int, float], whole: tuple[int, int, float]
) -> None:
    timing = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=300)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=1600, rows=300, cols=1920))
    grey = np.random.default_rng(0).random((300, 1920), np.float32)
    wide = Scene(frame=grey, valid=np.ones_like(grey), camera=camera, samples=24, tiles=6, noise=0.01)
    at = search._Resolutions.of(wide, length)
    for scene, (cols, rows, scale) in ((at.part, part), (at.whole, whole)):
        assert scene.frame.shape[0] == rows
        assert scene.scale == scale
        assert scene.counted / rows == pytest.approx(cols, rel=0.1)  # of whole tiles
    times = at.whole.counted / at.part.counted
    assert at.plain == pytest.approx(search.PLAIN * times**0.5)  # as standard errors fall with the number of blocks
