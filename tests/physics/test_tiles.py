"""Tiles cut a frame without gaps, and the path at a tile's middle is the camera's."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm

from rsvideo.physics import tiles
from rsvideo.physics.camera import Camera, Intrinsics, lever, turned
from rsvideo.physics.distortion import Distortion
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Polynomial

CAMERA = Intrinsics(fx=310.0, fy=270.0, cx=99.0, cy=81.0, rows=160, cols=210)
POSE = np.array([14.0, -9.0, 0.06])


def homography(pose):
    """C R C^-1 with R = exp([(pitch, yaw, roll)]_x), as the README writes it."""
    pitch, yaw, roll = -pose[1] / CAMERA.fy, pose[0] / CAMERA.fx, pose[2]
    generator = np.array([[0, -roll, yaw], [roll, 0, -pitch], [-yaw, pitch, 0]])
    C = CAMERA.matrix
    return C @ expm(generator) @ np.linalg.inv(C)


def pixels():
    x, y = np.meshgrid([0.0, 70.0, 99.0, 209.0], [0.0, 81.0, 159.0])
    return x, y


def move(pose):
    x, y = pixels()
    return turned(CAMERA, x, y, np.broadcast_to(pose, (*x.shape, len(pose))))


def turning(roll, readout=0.02, cols=960):
    """A camera of `cols` columns, and how it rolls by `roll` rad over its interval."""
    timing = ShutterTiming.from_readout(exposure=0.02, readout=readout, rows=120)
    camera = Camera(timing=timing, intrinsics=Intrinsics.centred(focal=1000.0, rows=120, cols=cols))
    coefficients = np.array([[0.0, 0, 0], [3.0, 1.0, roll / np.sqrt(12)]])
    return Polynomial(t0=0.0, t1=timing.interval[1], coefficients=coefficients), camera


@given(cols=st.integers(1, 400), count=st.integers(1, 8), overlap=st.integers(0, 30))
def test_every_column_belongs_to_one_tile_and_neighbours_see_the_overlap(cols, count, overlap):
    cut = tiles.split(cols, min(count, cols), overlap)
    assert [c for tile in cut for c in range(tile.start, tile.stop)] == list(range(cols))
    assert max(t.stop - t.start for t in cut) - min(t.stop - t.start for t in cut) <= 1
    for tile in cut:
        assert (tile.first, tile.last) == (max(0, tile.start - overlap), min(cols, tile.stop + overlap))
        assert tile.start <= tile.middle <= tile.stop - 1


def test_a_turned_camera_moves_pixels_by_the_homography():
    x, y = pixels()
    u, v, w = np.einsum("ij,jrc->irc", homography(POSE), np.stack([x, y, np.ones_like(x)]))
    np.testing.assert_allclose(move(POSE), np.stack([u / w - x, v / w - y], axis=-1), atol=1e-9)


def test_the_lever_is_the_derivative_at_rest():
    x, y = pixels()
    L = lever(CAMERA, x, y, 3)
    errors = [np.abs(move(h * POSE) - h * np.einsum("rcdp,p->rcd", L, POSE)).max() for h in (1e-1, 1e-2, 1e-3)]
    orders = np.log10(np.array(errors[:-1]) / errors[1:])
    np.testing.assert_allclose(orders, 2, atol=0.15)


def test_two_axes_move_all_pixels_alike():
    x, y = pixels()
    np.testing.assert_array_equal(move(POSE[:2]), np.broadcast_to(POSE[:2], (*x.shape, 2)))
    np.testing.assert_array_equal(lever(CAMERA, x, y, 2), np.broadcast_to(np.eye(2), (*x.shape, 2, 2)))


def test_the_displacement_of_a_tile_is_that_of_its_middle_column_at_its_scanlines_times():
    path, camera = turning(0.05, cols=200)
    timing, lens = camera.timing, camera.intrinsics
    tile = tiles.split(200, 4, 8)[3]
    d = tiles.displacement(tile, path, camera, 6)
    for i, k in ((0, 0), (57, 3), (119, 5)):
        t = i * timing.row_time + (k + 0.5) / 6 * timing.exposure
        pose = path.at(np.array([t]))
        np.testing.assert_allclose(d[i, k], turned(lens, np.array([174.5]), np.array([float(i)]), pose)[0], atol=1e-9)
    np.testing.assert_array_equal(tiles.levers(tile, lens, 120, 3)[57], lever(lens, np.array([174.5]), np.array([57.0]), 3)[0])


def test_a_shift_needs_one_tile_and_more_roll_more_tiles():
    path, camera = turning(0.02)
    shift = path.with_coefficients(path.coefficients[:, :2])
    assert tiles.tiles_needed(shift, camera, 0.25) == 1
    counts = [tiles.tiles_needed(turning(roll)[0], camera, 0.25) for roll in (0.0, 0.005, 0.01, 1.0)]
    assert counts[0] < counts[1] < counts[2] < counts[3] == 960 // tiles.NARROWEST


LENSES = {
    "pinhole": None,
    "barrel": Distortion(model="brown-conrady", coefficients=(-0.3, 0.1, 0.0, 0.0)),
    "moustache": Distortion(model="brown-conrady", coefficients=(-0.4, 1.0, 0.0, 0.0)),
}


@pytest.mark.parametrize("lens", LENSES.values(), ids=list(LENSES))
@pytest.mark.parametrize("tolerance", [0.5, 0.25])
def test_the_blur_at_a_tiles_edge_is_off_by_the_tolerance_at_most(tolerance, lens):
    path, pinhole = turning(0.01, readout=0.0)
    camera = replace(pinhole, intrinsics=replace(pinhole.intrinsics, distortion=lens))
    cut = tiles.split(960, tiles.tiles_needed(path, camera, tolerance), 0)
    poses = path.at(camera.timing.sample_times(40)[:1])[0]
    for tile in cut:
        columns = tile.middle, tile.start, tile.stop - 1
        at = [turned(camera.intrinsics, np.full(40, float(x)), np.full(40, 60.0), poses) for x in columns]
        for edge in at[1:]:
            off = edge - at[0]
            off -= 0.5 * (off.max(axis=0) + off.min(axis=0))  # a constant shift does not blur
            assert np.linalg.norm(off, axis=1).max() <= 1.1 * tolerance  # measured on a few pixels and times
