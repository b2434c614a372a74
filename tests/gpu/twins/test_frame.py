"""A frame on the device comes to the processor's latent image, in one tile or several, all at once or one after the other."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import skimage.data

from rsvideo.gpu import arrays, frame
from rsvideo.gpu.arrays import to_host, xp
from rsvideo.gpu.device import DeviceMemoryError
from rsvideo.gpu.frame import DeviceFrame
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial, Trajectory, centred
from rsvideo.restoration import device_frame, nonblind, settings
from rsvideo.restoration.nonblind import TiledFrame

LARGE = not arrays.SIMULATED
ROWS, COLS = (120, 200) if LARGE else (8, 9)
LENS = Intrinsics.centred(focal=300.0, rows=ROWS, cols=COLS)
CAMERA = Camera(timing=ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS), intrinsics=LENS)
HOW = {"samples": 5, "tolerance": 0.25}
MU = 7e-4


def path() -> Trajectory:
    shift = np.array([[0.0, 0.0], [2.0, -1.0], [0.7, 0.5]]) * (3 if LARGE else 1)
    return centred(Polynomial(t0=0.0, t1=CAMERA.timing.interval[1], coefficients=shift), CAMERA.timing.middle)


def picture(channels: int) -> np.ndarray:
    return ((skimage.data.astronaut()[60 : 60 + ROWS, 160 : 160 + COLS, :channels] / 255) ** 2.2).astype(np.float32)


def pair(channels: int, least: int = 1) -> tuple[TiledFrame, DeviceFrame]:
    """The same frame on both, in `least` tiles, its brightest pixels clipped."""
    pixels = picture(channels)
    clipped = pixels > np.quantile(pixels, 0.95)
    with pytest.MonkeyPatch.context() as patch:
        tiled_for = nonblind.cut_for
        for module in (nonblind, device_frame):
            patch.setattr(module, "cut_for", lambda *words, **named: tiled_for(*words, **{**named, "least": least}))
        here = nonblind.tiled(pixels, clipped, path(), CAMERA, **HOW)
        there = device_frame.tiled(pixels, clipped, path(), CAMERA, **HOW)
    assert isinstance(there, DeviceFrame)
    return here, there


def test_total_variation_and_what_it_leaves_unexplained_are_the_processors() -> None:
    here, there = pair(2)
    one, other = here.total_variation(MU, steps=2), there.total_variation(MU, steps=2)
    np.testing.assert_allclose(there.to_host(there.blended(other)), here.blended(one), atol=5e-6)
    assert there.unexplained(other) == pytest.approx(here.unexplained(one), rel=1e-4)


def test_the_blur_and_what_fusion_solves_are_the_processors() -> None:
    here, there = pair(1)
    pixels = picture(1)
    blurred = to_host(there.blurred(xp.asarray(np.ascontiguousarray(pixels[..., 0]))))
    np.testing.assert_allclose(blurred, here.blurred(pixels[..., 0]), atol=2e-6)
    aim = pixels[::-1].copy()
    np.testing.assert_allclose(there.to_host(there.towards(there.from_host(aim), 0.6)), here.towards(aim, 0.6), atol=5e-6)
    np.testing.assert_allclose(there.covered(), here.covered(), atol=5e-6)
    for one, other in zip(there.observed(), here.observed(), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_whole_restoration_with_the_denoiser_is_the_processors(monkeypatch: pytest.MonkeyPatch) -> None:
    if not LARGE:
        monkeypatch.setattr(settings, "TV_FIRST_STEPS", 1)
        monkeypatch.setitem(settings.EFFORTS, "normal", replace(settings.EFFORTS["normal"], splittings=2))
    here, there = pair(3 if LARGE else 1)
    how = settings.Settings(), 2e-3
    for one, other in zip(nonblind.deblur(here, *how), nonblind.deblur(there, *how), strict=True):
        np.testing.assert_allclose(there.to_host(other), one, atol=1e-3 if LARGE else 1e-5)  # large: patches nearly as near may swap


def test_the_last_step_of_a_frame_that_was_fused_is_the_processors() -> None:
    here, there = pair(3)
    known = picture(3)[::-1].copy()
    found = there.to_host(nonblind.finished(there, there.from_host(known), 2e-3))
    np.testing.assert_allclose(found, nonblind.finished(here, known, 2e-3), atol=1e-3 if LARGE else 1e-5)


def test_tiles_share_a_grid_and_come_close_to_those_with_grids_of_their_own() -> None:
    here, there = pair(1, least=2)
    assert len(there.cut) == len(here.cut) == 2
    one, other = here.total_variation(MU, steps=1), there.total_variation(MU, steps=1)
    np.testing.assert_allclose(there.to_host(there.blended(other)), here.blended(one), atol=5e-3)


def test_a_device_with_little_memory_takes_fewer_tiles_at_a_time_and_comes_to_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    _, there = pair(1, least=2)
    pixels, system_of, tried = xp.asarray(np.ascontiguousarray(picture(1)[..., 0])), frame.System.of, []
    at_once = to_host(there.blurred(pixels))
    there._kept = None

    def narrow(offsets: np.ndarray, *others: Any) -> frame.System:
        tried.append(len(offsets))
        if len(offsets) > 1:
            raise arrays.OutOfMemory(1, 1) if LARGE else MemoryError
        return system_of(offsets, *others)

    monkeypatch.setattr(frame.System, "of", narrow)
    np.testing.assert_array_equal(to_host(there.blurred(pixels)), at_once)
    assert tried == [2, 1, 1]


def test_a_device_that_does_not_hold_one_tile_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    def full(*_: object) -> None:
        raise arrays.OutOfMemory(1, 1) if LARGE else MemoryError

    _, there = pair(1)
    monkeypatch.setattr(frame.System, "of", full)
    with pytest.raises(DeviceMemoryError, match="does not hold one tile"):
        there.total_variation(MU, steps=1)
