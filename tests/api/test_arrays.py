"""Arrays that are no pictures are refused in one line; pictures come back as they came."""

import re

import numpy as np
import pytest

import rsvideo
from rsvideo.api import arrays
from rsvideo.physics.tone import Transfer

SHUTTER = rsvideo.Shutter(exposure="1/50", readout="20ms")
CAMERA = rsvideo.Camera(focal_px=100)
LIGHT = np.full((40, 48, 3), 0.5, np.float32)


def with_a(value: float) -> np.ndarray:
    image = LIGHT.copy()
    image[7, 9, 1] = value
    return image


REFUSED = [
    (LIGHT[..., 0].ravel(), "image must have the shape (rows, cols) or (rows, cols, 3), got (1920,)"),
    (np.zeros((40, 48, 4), np.uint8), "is the fourth channel alpha"),
    (np.zeros((3, 40, 48), np.float32), "are the channels first"),
    (np.zeros((5, 40, 48, 3), np.uint8), "is it a clip"),
    (np.zeros((31, 48), np.uint8), "image must be at least 32 x 32 px, it is 48 x 31"),
    (LIGHT * 255, "image must hold linear light in [0, 1], got 128 to 128; are they codes?"),
    (LIGHT - 1, "is the mean taken off?"),
    (with_a(np.nan), "image must be finite, 1 values are NaN or infinite, the first at row 7, column 9"),
    (with_a(np.inf), "image must be finite"),
]


@pytest.mark.parametrize(("image", "line"), REFUSED, ids=[line[:40] for _, line in REFUSED])
def test_what_is_no_picture_is_refused_in_one_line(image: np.ndarray, line: str) -> None:
    with pytest.raises(ValueError, match=re.escape(line)) as raised:
        rsvideo.deblur(image, shutter=SHUTTER, camera=CAMERA)
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("dtype", [np.int64, bool, np.complex64, object])
def test_what_holds_neither_codes_nor_light_is_a_type_error(dtype: type) -> None:
    with pytest.raises(TypeError, match="must hold uint8 or uint16 codes, or light as floating point"):
        rsvideo.deblur(np.zeros((40, 48), dtype), shutter=SHUTTER, camera=CAMERA)


def test_what_is_no_array_is_a_type_error() -> None:
    with pytest.raises(TypeError, match=r"image must be a NumPy array, got list; rsvideo\.read"):
        arrays.checked("image", [[0.0]])


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("transfer", [Transfer.SRGB, Transfer.BT709, Transfer.LINEAR])
def test_codes_to_light_and_back_are_the_codes(dtype: type, transfer: Transfer) -> None:
    codes = np.random.default_rng(0).integers(0, np.iinfo(dtype).max + 1, (40, 48, 3)).astype(dtype)
    light = arrays.light("image", codes, transfer)
    np.testing.assert_array_equal(light.like_source(light.pixels), codes)


def test_full_codes_and_full_light_are_clipped() -> None:
    assert arrays.light("image", np.full((40, 48), 254, np.uint8), Transfer.SRGB).clipped.all()
    assert not arrays.light("image", np.full((40, 48), 253, np.uint8), Transfer.SRGB).clipped.any()
    assert arrays.light("image", np.ones((40, 48)), Transfer.SRGB).clipped.all()
