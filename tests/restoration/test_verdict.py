"""A path is followed only where all that was measured speaks for it."""

from dataclasses import replace

import pytest

from rsvideo.frame import Verdict
from rsvideo.restoration.evidence import Evidence
from rsvideo.restoration.verdict import CONFIDENT, FOCUS, MIRROR, PERHAPS, REST, REST_UNDIRECTED, WOBBLE, believed, log_odds

GOOD = Evidence(rest=2 * REST_UNDIRECTED, mirror=2 * MIRROR, wobble=2 * WOBBLE, focus=2 * FOCUS)


def test_a_path_for_which_all_speaks_is_followed() -> None:
    assert believed(GOOD) is Verdict.RESTORED


@pytest.mark.parametrize("lacking", [{"rest": 0.9 * REST, "mirror": 100.0}, {"focus": 0.9 * FOCUS}])
def test_a_path_that_one_measure_does_not_bear_out_is_not(lacking: dict[str, float]) -> None:
    assert believed(replace(GOOD, **lacking)) is Verdict.UNEXPLAINED


def test_a_path_that_is_less_likely_is_followed_in_part_and_an_unlikely_one_is_not() -> None:
    less = replace(GOOD, rest=2.6 * REST, mirror=1.9 * MIRROR, focus=1.1 * FOCUS)
    assert PERHAPS < log_odds(less) < CONFIDENT
    assert believed(less) is Verdict.DOUBTFUL
    least = replace(less, rest=1.1 * REST)
    assert log_odds(least) < PERHAPS
    assert believed(least) is Verdict.UNEXPLAINED


def test_where_the_mirror_image_may_be_as_true_the_direction_is_open() -> None:
    assert believed(replace(GOOD, mirror=0.9 * MIRROR)) is Verdict.UNDIRECTED


def test_what_the_mirror_image_does_not_say_the_spectra_must_say_more_surely() -> None:
    weak = replace(GOOD, rest=0.9 * REST_UNDIRECTED)
    assert believed(weak) is Verdict.RESTORED
    for wobble in (2 * WOBBLE, 0.0):
        assert believed(replace(weak, mirror=0.9 * MIRROR, wobble=wobble)) is Verdict.UNEXPLAINED


def test_where_the_scanlines_do_not_sway_the_direction_does_not_matter() -> None:
    assert believed(replace(GOOD, mirror=0.0, wobble=0.9 * WOBBLE)) is Verdict.RESTORED


@pytest.mark.parametrize("name", ["rest", "mirror", "focus"])
def test_a_path_is_followed_if_it_is_twice_as_likely_right_as_wrong(name: str) -> None:
    faint = Evidence(rest=0.12, mirror=3.5, wobble=2 * WOBBLE, focus=5.0)
    assert log_odds(faint) < CONFIDENT
    assert believed(faint) is Verdict.DOUBTFUL
    plain = replace(faint, **{name: 2 * getattr(faint, name)})
    assert log_odds(plain) > CONFIDENT
    assert believed(plain) is Verdict.RESTORED
