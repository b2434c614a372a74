"""A path is followed only where all that was measured speaks for it."""

from dataclasses import replace

import pytest

from rsvideo.restoration.evidence import Evidence
from rsvideo.restoration.verdict import FOCUS, MIRROR, REST, WOBBLE, convincing

GOOD = Evidence(rest=2 * REST, mirror=2 * MIRROR, wobble=2 * WOBBLE, focus=2 * FOCUS)


def test_a_path_for_which_all_speaks_is_followed() -> None:
    assert convincing(GOOD)


@pytest.mark.parametrize("lacking", [{"rest": 0.9 * REST}, {"mirror": 0.9 * MIRROR}, {"focus": 0.9 * FOCUS}])
def test_a_path_that_one_measure_does_not_bear_out_is_not(lacking: dict[str, float]) -> None:
    assert not convincing(replace(GOOD, **lacking))


def test_where_the_scanlines_do_not_sway_the_direction_does_not_matter() -> None:
    assert convincing(replace(GOOD, mirror=0.0, wobble=0.9 * WOBBLE))
