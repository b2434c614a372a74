"""When an iteration ends: methods yield states, one driver stops them all and gives the reason."""

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Generic, Protocol, TypeVar, runtime_checkable


@runtime_checkable
class State(Protocol):
    """What a method yields after each step."""

    @property
    def change(self) -> float:
        """How far the last step went, relative to the method's own scale; infinite before the first."""
        ...


S_co = TypeVar("S_co", bound=State, covariant=True)
S = TypeVar("S", bound=State)


class Status(enum.StrEnum):
    """Why an iteration ended, as a person reads it."""

    CONVERGED = "the last step changed less than the tolerance"
    LIMIT = "the allowed number of steps was used up"
    STALLED = "no further step improves the objective"
    DIVERGED = "the values are no longer finite"


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution(Generic[S_co]):
    """The last state of an iteration, the steps it took and why it ended."""

    state: S_co
    steps: int
    status: Status


def solve(states: Iterable[S], *, steps: int, tolerance: float = 0.0) -> Solution[S]:
    """Runs a method, whose first state is its start, until its change falls below `tolerance` or `steps` are done.

    A method that ends by itself has stalled. Of one that diverges the last finite state is handed back.
    """
    if steps < 0:
        raise ValueError(f"steps must be at least 0, got {steps}")
    last: S | None = None
    count = -1
    for state in states:
        if last is not None and not math.isfinite(state.change):
            return Solution(state=last, steps=count, status=Status.DIVERGED)
        last, count = state, count + 1
        if state.change <= tolerance:
            return Solution(state=state, steps=count, status=Status.CONVERGED)
        if count == steps:
            return Solution(state=state, steps=count, status=Status.LIMIT)
    if last is None:
        raise ValueError("a method yields at least its start, this one yielded nothing")
    return Solution(state=last, steps=count, status=Status.STALLED)
