"""Which columns of a frame a path is sought in."""

from dataclasses import replace

import numpy as np
import pytest

from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.noise_level import noise_level
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import still
from rsvideo.restoration.scene import FEWEST_TILES, SMALLEST, TRIAL_COLS, WINDOW_COLS, Scene, halved_until_textured, spread
from rsvideo.restoration.sparsity import density, objective

ROWS = 64


def grey(cols: int, texture: np.ndarray | None = None) -> Scene:
    """A frame of noise, times `texture` in each column."""
    timing = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=ROWS)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=cols, rows=ROWS, cols=cols))
    frame = np.random.default_rng(0).random((ROWS, cols), np.float32)
    frame = frame if texture is None else frame * texture.astype(np.float32)
    return Scene(frame=frame, valid=np.ones_like(frame), camera=camera, samples=4, tiles=1, noise=0.01)


@pytest.mark.parametrize("cols", [480, 800, 1280, 1920])
def test_the_tiles_that_count_come_from_everywhere_and_are_as_wide_as_was_asked_for(cols: int) -> None:
    for wanted in (TRIAL_COLS, WINDOW_COLS):
        cut = spread(grey(cols), wanted).cut()
        together = sum(tile.stop - tile.start for tile in cut)
        assert 0.7 * min(wanted, cols) < together < 1.35 * wanted
        assert cut[0].start < cols / 3
        assert cut[-1].stop > 2 * cols / 3


def test_of_each_part_of_the_frame_the_tile_with_most_texture_counts() -> None:
    rich = np.full(1920, 0.1)
    rich[int(3.2 * 1920 / 11) : int(3.8 * 1920 / 11)] = 1
    assert 3 in (spread(grey(1920, rich), TRIAL_COLS).chosen or ())
    assert 3 not in (spread(grey(1920, 1.1 - rich), TRIAL_COLS).chosen or ())


def test_what_is_measured_of_a_path_is_measured_on_the_tiles_that_count_alone() -> None:
    scene = spread(grey(1280), TRIAL_COLS)
    path = still(scene.camera.timing.interval, degree=2, axes=3)
    path = path.with_coefficients(np.array([[0, 0, 0], [3, 1, 0.002], [0, 0, 0]], float))
    _, weight = density(scene, path, 0.01)
    counted = np.zeros(1280, bool)
    for tile in scene.cut():
        counted[tile.start : tile.stop] = True
    assert not weight[:, ~counted].any()
    assert weight[:, counted].any(axis=0).mean() > 0.8
    elsewhere = scene.frame.copy()
    elsewhere[:, ~counted] = 0
    assert objective(replace(scene, frame=elsewhere), path, 0.01)[0] == objective(scene, path, 0.01)[0]


def test_a_narrow_frame_keeps_all_its_columns() -> None:
    scene = spread(grey(300), TRIAL_COLS)
    assert scene.tiles == FEWEST_TILES
    assert [(tile.start, tile.stop) for tile in scene.cut()] == [(0, 150), (150, 300)]


@pytest.mark.parametrize(("noise", "halvings"), [(0.0, 0), (0.02, 1), (0.04, 2)])
def test_a_frame_is_halved_until_its_texture_exceeds_the_noise(noise: float, halvings: int) -> None:
    rows, cols = 5 * SMALLEST, 6 * SMALLEST
    timing = ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=rows)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=cols, rows=rows, cols=cols))
    y, x = np.mgrid[:rows, :cols]
    waves = 0.5 + 0.2 * np.sin(x / 8) * np.sin(y / 8)  # 50 px long, as a long blur leaves them
    frame = (waves + noise * np.random.default_rng(0).standard_normal((rows, cols))).astype(np.float32)
    scene = Scene(frame=frame, valid=np.ones_like(frame), camera=camera, samples=4, tiles=2, noise=noise_level(frame))
    shown = halved_until_textured(scene)
    assert shown is not None
    assert shown.frame.shape == (rows >> halvings, cols >> halvings)
    assert shown.scale == 0.5**halvings
    flat = np.full_like(frame, 0.5) + (frame - waves).astype(np.float32)
    if noise:
        assert halved_until_textured(replace(scene, frame=flat, noise=noise_level(flat))) is None
