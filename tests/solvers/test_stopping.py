"""One driver stops all methods and says why."""

import math
from dataclasses import dataclass

import pytest

from rsvideo.solvers.stopping import Status, solve


@dataclass(frozen=True)
class At:
    """A state."""

    x: float
    change: float


def halving():
    x, change = 1.0, math.inf
    while True:
        yield At(x, change)
        x, change = x / 2, x / 2


def test_a_method_stops_where_its_change_falls_below_the_tolerance():
    found = solve(halving(), steps=100, tolerance=0.1)
    assert (found.state.x, found.steps, found.status) == (0.0625, 4, Status.CONVERGED)


def test_a_method_stops_after_its_steps():
    found = solve(halving(), steps=3)
    assert (found.state.x, found.steps, found.status) == (0.125, 3, Status.LIMIT)


def test_no_steps_hand_the_start_back():
    assert solve(halving(), steps=0).state.x == 1.0


def test_a_method_that_ends_has_stalled():
    found = solve(iter([At(2.0, math.inf), At(1.0, 0.5)]), steps=9)
    assert (found.state.x, found.steps, found.status) == (1.0, 1, Status.STALLED)


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_of_a_method_that_diverges_the_last_finite_state_comes_back(value):
    found = solve(iter([At(2.0, math.inf), At(1.0, 0.5), At(math.nan, value)]), steps=9)
    assert (found.state.x, found.steps, found.status) == (1.0, 1, Status.DIVERGED)


def test_every_status_is_a_sentence():
    assert all(" " in status and not status.endswith(".") for status in Status)


def test_a_method_without_a_start_is_refused():
    with pytest.raises(ValueError, match="yields at least its start"):
        solve(iter([]), steps=1)
