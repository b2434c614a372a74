import math
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rsvideo.config import quantity
from rsvideo.config.quantity import frame_rate, hand_held, pixels, seconds


@pytest.mark.parametrize("text", ["1/50", "20ms", "0.02", "20 ms", "20000us", "0.02s", " 1/50 s ", "2e-2", ".02", "20MS", "20000µs"])
def test_one_fiftieth_of_a_second_may_be_written_in_many_ways(text: str) -> None:
    assert math.isclose(seconds("exposure", text), 0.02)


@given(value=st.floats(1e-6, 1))
def test_what_python_prints_is_read_back(value: float) -> None:
    assert seconds("exposure", repr(value)) == value


@pytest.mark.parametrize(
    ("text", "hint"),
    [
        ("", "must be a time"),
        ("fast", "must be a time"),
        ("nan", "units are"),
        ("inf", "units are"),
        ("1/50/2", "must be a time"),
        ("1/0", "divides by zero"),
        ("20mm", "units are s, ms and us"),
        ("0,02", "decimal point"),
        ("-20ms", "must not be negative"),
        ("1e999/2", "must"),
    ],
)
def test_anything_else_is_refused_by_name_with_the_likely_slip(text: str, hint: str) -> None:
    with pytest.raises(ValueError, match="exposure") as caught:
        hand_held("exposure", seconds("exposure", text), zero=False)
    message = str(caught.value)
    assert hint in message or (hint == "units are" and "must be a time" in message)


@pytest.mark.parametrize(("value", "zero"), [(20.0, False), (1.001, True), (0.0, False), (math.nan, True)])
def test_times_that_no_hand_held_camera_has_are_refused(value: float, zero: bool) -> None:
    with pytest.raises(ValueError, match="must lie in"):
        hand_held("readout", value, zero=zero)


def test_a_readout_of_zero_is_a_global_shutter() -> None:
    assert hand_held("readout", 0.0, zero=True) == 0


@pytest.mark.parametrize("text", ["1400", "1400px", " 1.4e3 px "])
def test_pixels_may_carry_their_unit(text: str) -> None:
    assert pixels("focal-px", text) == 1400


@pytest.mark.parametrize("text", ["0", "-1400", "nan", "inf", "28mm", "wide", ""])
def test_lengths_that_are_not_positive_pixels_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match="focal-px must be a positive number of pixels"):
        pixels("focal-px", text)


@pytest.mark.parametrize(("text", "rate"), [("25", Fraction(25)), ("24000/1001", Fraction(24000, 1001)), ("0.01", Fraction(1, 100))])
def test_rates_may_be_fractions(text: str, rate: Fraction) -> None:
    assert frame_rate(text) == rate


@pytest.mark.parametrize("text", ["fast", "", "0", "-25", "25/0", "0.001", "100001", "1" * 50, "1e99999999", "1/1e9", "nan"])
def test_rates_that_no_camera_has_are_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"rate must be a number of frames a second such as 25 or 24000/1001, from 1/100 to 100000, got"):
        frame_rate(text)


@pytest.mark.parametrize("digits", [100, 4000, 200_000])
def test_more_digits_than_any_quantity_has_are_refused_at_once(digits: int) -> None:
    long = "1" * digits
    for read in (frame_rate, quantity.span, lambda text: seconds("exposure", text), lambda text: pixels("focal-px", text)):
        for text in (long, f"{long}/{long}", f"1e{long}"):
            with pytest.raises(ValueError, match="must be written in at most 60 characters"):
                read(text)
