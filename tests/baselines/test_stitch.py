"""Blocks restored apart and put together again: no seam, no shift, no hole."""

from dataclasses import replace
from itertools import pairwise

import cv2
import numpy as np
import pytest
import skimage.data

from rsvideo.baselines import stitch, uniform
from rsvideo.baselines.stitch import Block
from rsvideo.frame import Frame, Verdict
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.report.metrics import psnr
from rsvideo.restoration.settings import Settings
from tests.baselines.scenes import cards, view

ROWS, COLS = 144, 112
SETTINGS = Settings(prior="tv")
pytestmark = pytest.mark.usefixtures("small_kernels")


def scene(rows=ROWS, cols=COLS):
    return cards(rows, cols).astype(np.float32)


def streak(dx, dy, size=15):
    kernel = np.zeros((size, size), np.float32)
    middle = size // 2
    cv2.line(kernel, (middle - dx, middle - dy), (middle + dx, middle + dy), 1.0)
    return kernel / kernel.sum()


def taken(kernel, image=None):
    image = scene() if image is None else image
    blurred = cv2.filter2D(image, -1, kernel[::-1, ::-1].copy(), borderType=cv2.BORDER_REFLECT).reshape(image.shape)
    return (blurred + 0.002 * np.random.default_rng(0).standard_normal(image.shape)).astype(np.float32)


def frame(pixels) -> Frame:
    return Frame(pixels=pixels, clipped=np.zeros(pixels.shape, bool))


def shutter(rows=ROWS, direction=Direction.TOP_TO_BOTTOM):
    return ShutterTiming.from_readout(exposure=0.02, readout=0.02, rows=rows, direction=direction)


@pytest.mark.slow
def test_one_block_is_the_uniform_method():
    pixels = taken(streak(4, 2))
    whole, one = (
        uniform.restored(view(frame(pixels), shutter()), SETTINGS),
        stitch.restored(view(frame(pixels), shutter()), SETTINGS, block_rows=1000),
    )
    np.testing.assert_allclose(one.latent, whole.latent, atol=1e-6)
    assert one.psfs is not None
    assert whole.psfs is not None
    np.testing.assert_array_equal(one.psfs, whole.psfs)


@pytest.mark.parametrize("block_rows", [None, 64])
def test_under_the_same_kernel_everywhere_nobody_sees_the_blocks(block_rows):
    kernel = streak(4, 2)
    pixels = taken(kernel)
    whole = uniform.deconvolved(pixels, np.zeros(pixels.shape, bool), kernel, SETTINGS, 0.002)
    drifting = [np.roll(kernel, (i % 3 - 1, i % 2), (0, 1)) for i in range(20)]  # the place of a kernel is free
    blocks = [Block(first=a, last=b, kernel=k) for (a, b), k in zip(stitch.split(ROWS, block_rows), drifting, strict=False)]
    latent = stitch.stitched(view(frame(pixels), shutter()), blocks, SETTINGS)
    assert psnr(latent, whole) > 38
    assert psnr(latent, scene()) > psnr(pixels, scene()) + 5


@pytest.mark.slow
def test_where_the_blur_turns_over_the_frame_blocks_gain_more_than_one_kernel():
    truth = scene(240, 128)
    upper, lower = taken(streak(4, 0), truth), taken(streak(0, 4), truth)
    pixels = np.vstack([upper[:120], lower[120:]])
    one, many = (method(view(frame(pixels), shutter(240)), SETTINGS) for method in (uniform.restored, stitch.restored))
    assert psnr(many.latent, truth) > psnr(pixels, truth) + 1
    assert psnr(many.latent, truth) > psnr(one.latent, truth) + 1
    assert many.psfs is not None
    assert many.psfs.shape[:2] == (5, 1)


@pytest.mark.slow
def test_a_block_without_texture_takes_its_neighbours_kernel():
    image = scene()
    image[:60] = 0.5
    pixels = taken(streak(4, 2), image)
    result = stitch.restored(view(frame(pixels), shutter()), SETTINGS)
    assert result.verdict is Verdict.RESTORED
    assert result.psfs is not None
    np.testing.assert_array_equal(result.psfs[0], result.psfs[1])
    assert not np.array_equal(result.psfs[-1], result.psfs[1])


@pytest.mark.slow
def test_a_frame_read_sideways_is_cut_across_its_columns():
    pixels = taken(streak(4, 2))
    upright = stitch.restored(view(frame(pixels), shutter()), SETTINGS)
    turned = np.ascontiguousarray(pixels.transpose(1, 0, 2))
    sideways = stitch.restored(view(frame(turned), replace(shutter(), direction=Direction.LEFT_TO_RIGHT)), SETTINGS)
    np.testing.assert_allclose(sideways.latent, upright.latent.transpose(1, 0, 2), atol=1e-5)
    assert upright.psfs is not None
    assert sideways.psfs is not None
    np.testing.assert_allclose(sideways.psfs, upright.psfs.transpose(1, 0, 3, 2), atol=1e-6)


@pytest.mark.parametrize(("rows", "block_rows"), [(144, None), (144, 50), (145, 144), (50, 64), (97, 24)])
def test_blocks_cover_the_frame_and_overlap_by_half(rows, block_rows):
    spans = stitch.split(rows, block_rows)
    assert spans[0][0] == 0
    assert spans[-1][1] == rows
    for (_, last), (first, end) in pairwise(spans):
        assert last - first >= (end - first) // 2 - 1


@pytest.mark.parametrize("shift", [(0.0, 0.0), (0.4, -0.7), (3.3, 1.6)])
def test_a_displacement_is_found_to_a_tenth_of_a_pixel(shift):
    image = cv2.GaussianBlur((skimage.data.camera()[100:180, 100:260] / 255).astype(np.float32), (0, 0), 0.8)
    other = stitch.moved(image, np.array(shift))
    np.testing.assert_allclose(stitch.displacement(image, other, 8), shift, atol=0.1)


def test_blocks_too_short_are_refused():
    with pytest.raises(ValueError, match="block_rows must be at least 24 scanlines, got 8"):
        stitch.restored(view(frame(scene()), shutter()), SETTINGS, block_rows=8)
