"""What is shown of a latent image beside the rectified frame."""

import numpy as np
import pytest

from rsvideo.restoration.rectification import held


@pytest.mark.parametrize("channels", [1, 3])
@pytest.mark.parametrize("reach", [0, 1, 4, 30])  # the last is longer than half the frame
def test_near_borders_and_lamps_a_latent_image_is_no_darker_than_all_that_the_frame_has_nearby(reach: int, channels: int) -> None:
    rows, cols, lamp, chance = 23, 31, 0.48, np.random.default_rng(0)
    latent = chance.random((rows, cols, channels), np.float32)
    straight = 0.2 + 0.3 * chance.random((rows, cols, channels), np.float32)
    expected = latent.copy()
    for row, col in np.ndindex(rows, cols):
        if min(row, col, rows - 1 - row, cols - 1 - col) < reach:
            near = straight[max(0, row - reach) : row + reach + 1, max(0, col - reach) : col + reach + 1]
            lit = near.max(axis=(0, 1)) >= lamp
            expected[row, col] = np.where(lit, np.maximum(latent[row, col], near.min(axis=(0, 1))), latent[row, col])
    before = latent.copy()
    np.testing.assert_array_equal(held(latent, straight, reach, lamp), expected)
    np.testing.assert_array_equal(latent, before)
