import warnings
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsvideo.physics.tone import Curve, Transfer, decode, encode

every_transfer = pytest.mark.parametrize("transfer", Transfer)


@every_transfer
@pytest.mark.parametrize("top", [255, 65535])
def test_every_code_comes_back_exactly(transfer: Transfer, top: int) -> None:
    codes = np.arange(top + 1, dtype=np.float32) / top
    back = np.rint(encode(transfer, decode(transfer, codes)) * top)
    np.testing.assert_array_equal(back, np.arange(top + 1))


def test_a_measured_curve_that_samples_a_standards_one_is_that_curve() -> None:
    codes = np.linspace(0, 1, 65)
    curve = Curve(light=tuple(decode(Transfer.BT709, codes.astype(np.float32)).astype(float).tolist()))
    ramp = np.linspace(0, 1, 1001, dtype=np.float32)
    np.testing.assert_allclose(decode(curve, ramp), decode(Transfer.BT709, ramp), atol=1e-4)
    np.testing.assert_allclose(encode(curve, decode(curve, ramp)), ramp, atol=1e-5)


def test_a_measured_curve_goes_straight_on_above_white_and_its_foot_is_black() -> None:
    curve = Curve(light=(0.0, 0.0, 0.5, 1.0))
    np.testing.assert_allclose(decode(curve, np.array([1.1], np.float32)), 1.15, atol=1e-6)
    np.testing.assert_allclose(encode(curve, np.zeros(1, np.float32)), 1 / 3, atol=1e-6)


@every_transfer
def test_the_top_code_is_light_1(transfer: Transfer) -> None:
    np.testing.assert_allclose(encode(transfer, np.ones(1, np.float32)), 1, atol=1e-6)
    np.testing.assert_allclose(decode(transfer, np.ones(1, np.float32)), 1, atol=1e-6)


@pytest.mark.parametrize("transfer", [transfer for transfer in Transfer if not transfer.logarithmic])
def test_code_0_is_black(transfer: Transfer) -> None:
    assert abs(float(encode(transfer, np.zeros(1, np.float32))[0])) < 1e-6
    assert abs(float(decode(transfer, np.zeros(1, np.float32))[0])) < 1e-6


@pytest.mark.parametrize(
    ("transfer", "grey"),
    [  # the code, of 1023, that the maker gives for 18 % grey
        (Transfer.SLOG3, 420),
        (Transfer.CLOG, 351),
        (Transfer.CLOG3, 351),
        (Transfer.VLOG, 433),
        (Transfer.LOGC3, 400),
    ],
)
def test_a_grey_card_has_the_code_that_the_maker_says(transfer: Transfer, grey: int) -> None:
    light = twin(transfer)(np.array([grey / 1023]))
    assert abs(float(light[0]) - 0.18) < 0.002
    np.testing.assert_allclose(encode(transfer, (light / twin(transfer)(np.ones(1))).astype(np.float32)) * 1023, grey, atol=0.01)


TWINS = {
    Transfer.SRGB: "eotf_sRGB",
    Transfer.PQ: "eotf_ST2084",
    Transfer.HLG: "oetf_inverse_BT2100_HLG",
    Transfer.SLOG3: "log_decoding_SLog3",
    Transfer.CLOG: "log_decoding_CanonLog",
    Transfer.CLOG3: "log_decoding_CanonLog3",
    Transfer.VLOG: "log_decoding_VLog",
    Transfer.LOGC3: "log_decoding_ARRILogC3",
}


def twin(transfer: Transfer) -> Callable[[np.ndarray], np.ndarray]:
    """The same curve in colour-science, slower to import."""
    with warnings.catch_warnings(action="ignore"):  # it remarks on what it would draw with
        import colour
    return getattr(colour.models, TWINS[transfer])


@pytest.mark.parametrize("transfer", TWINS)
def test_curves_match_those_of_colour_science(transfer: Transfer) -> None:
    codes = np.linspace(0, 1, 1025)
    theirs = twin(transfer)(codes)
    np.testing.assert_allclose(decode(transfer, codes.astype(np.float32)), theirs / theirs[-1], atol=5e-7)


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
