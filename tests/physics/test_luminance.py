"""Luminance weighs the channels as BT.709 does."""

import numpy as np
import pytest

from rsvideo.physics.luminance import luminance


@pytest.mark.parametrize(("channel", "share"), [(0, 0.2126), (1, 0.7152), (2, 0.0722)])
def test_each_channel_counts_by_its_weight(channel: int, share: float) -> None:
    pixels = np.zeros((2, 3, 3), np.float32)
    pixels[..., channel] = 0.5
    np.testing.assert_allclose(luminance(pixels), 0.5 * share, rtol=1e-6)


def test_white_has_the_luminance_of_its_channels() -> None:
    np.testing.assert_allclose(luminance(np.full((4, 5, 3), 0.25, np.float32)), 0.25, rtol=1e-6)


def test_a_grey_picture_is_its_own_luminance() -> None:
    pixels = np.random.default_rng(0).random((4, 5, 1)).astype(np.float32)
    np.testing.assert_array_equal(luminance(pixels), pixels[..., 0])
