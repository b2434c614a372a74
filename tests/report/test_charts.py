import math
from xml.etree import ElementTree

import pytest

from rsvideo.report import charts
from tests.report.test_plots import sidecar


@pytest.mark.parametrize(("low", "high"), [(0, 1), (20.1, 39.7), (-3, 12), (5, 5), (0, 0), (1e-4, 3e-4)])
def test_ticks_enclose_what_is_drawn_and_are_round(low: float, high: float) -> None:
    ticks = charts.ticks(low, high, 5)
    assert ticks[0] <= low
    assert ticks[-1] >= high
    assert 2 <= len(ticks) <= 9
    step = ticks[1] - ticks[0]
    assert min(abs(step / 10 ** math.floor(math.log10(step)) - m) for m in (1, 2, 5, 10)) < 1e-6


def test_a_gap_in_a_line_stays_a_gap() -> None:
    series = charts.Series(name="a", style="c0", pattern=0, x=[0, 1, 2, 3], y=[1, math.nan, 3, 4])
    drawn = ElementTree.fromstring(charts.lines([series], x_label="frame", y_label="dB", width=400, height=200, title="<&>"))
    path = next(each for each in drawn.iter("path") if each.get("class") == "line c0")
    assert path.get("d", "").count("M") == 2
    assert sum("dot" in (each.get("class") or "") for each in drawn.iter("path")) == 3
    assert drawn.get("aria-label") == "<&>"


def test_lines_are_told_apart_without_colour() -> None:
    assert len({(dash, marker) for dash, marker in zip(charts.DASHES, charts.MARKERS, strict=True)}) == len(charts.MARKERS)


@pytest.mark.parametrize(("source", "degrees"), [("explicit", True), ("assumed", False)])
def test_a_path_has_degrees_where_the_lens_is_known(source: str, degrees: bool) -> None:
    said = sidecar(source=source)
    assert ("°" in charts.trajectory(said, said.frames[0])) == degrees


def test_roll_is_drawn_where_there_is_any() -> None:
    still, turning = sidecar(), sidecar(roll=0.02)
    assert ">roll<" not in charts.trajectory(still, still.frames[0])
    assert ">roll<" in charts.trajectory(turning, turning.frames[0])
