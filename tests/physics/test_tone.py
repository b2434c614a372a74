import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsvideo.physics.tone import Transfer, decode, encode

every_transfer = pytest.mark.parametrize("transfer", Transfer)


@every_transfer
@pytest.mark.parametrize("top", [255, 65535])
def test_every_code_comes_back_exactly(transfer: Transfer, top: int) -> None:
    codes = np.arange(top + 1, dtype=np.float32) / top
    back = np.rint(encode(transfer, decode(transfer, codes)) * top)
    np.testing.assert_array_equal(back, np.arange(top + 1))


@every_transfer
def test_black_stays_black_and_white_white(transfer: Transfer) -> None:
    ends = np.array([0, 1], np.float32)
    np.testing.assert_allclose(encode(transfer, ends), ends, atol=1e-6)
    np.testing.assert_allclose(decode(transfer, ends), ends, atol=1e-6)


@every_transfer
def test_more_light_is_never_a_smaller_code(transfer: Transfer) -> None:
    light = np.linspace(0, 1, 200_001, dtype=np.float32)
    assert np.all(np.diff(encode(transfer, light)) >= -1e-7)


@every_transfer
@given(light=st.floats(-10, 10, width=32))
def test_light_outside_the_range_is_clipped(transfer: Transfer, light: float) -> None:
    code = float(encode(transfer, np.array([light], np.float32))[0])
    assert 0 <= code <= 1 + 1e-6


@pytest.mark.parametrize(
    ("transfer", "code", "light"),
    [
        (Transfer.SRGB, 0.5, 0.2140411),  # IEC 61966-2-1: ((0.5 + 0.055) / 1.055) ^ 2.4
        (Transfer.SRGB, 0.04, 0.0030960),  # the straight piece, 0.04 / 12.92
        (Transfer.BT709, 0.5, 0.259589),  # ((0.5 + 0.099) / 1.099) ^ (1 / 0.45), with the digits of BT.709 itself
        (Transfer.BT709, 0.045, 0.01),  # the straight piece, 0.045 / 4.5
        (Transfer.LINEAR, 0.3, 0.3),
    ],
)
def test_codes_stand_for_the_light_that_the_standard_says(transfer: Transfer, code: float, light: float) -> None:
    np.testing.assert_allclose(decode(transfer, np.array([code], np.float32)), light, rtol=6e-4)


@every_transfer
def test_single_precision_stays_single(transfer: Transfer) -> None:
    grey = np.full((2, 3), 0.5, np.float32)
    assert encode(transfer, grey).dtype == decode(transfer, grey).dtype == np.float32
