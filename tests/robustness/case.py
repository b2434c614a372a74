"""One attack: the files that it lays out, the command it gives, and which answers are right."""

from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path

import numpy as np

Build = Callable[[Path], None]
"""Lays something at a path that bytes cannot state: a link, a folder, a pipe."""


class Fault(Enum):
    """What a case attacks: the rule, once, of which exit codes are right for a refusal.

    0 is right for all of them, where the result is whole and the case need not be refused; 1 (failed while working) for none.
    """

    SOURCE = "a clip, a picture or a sidecar, damaged or of another kind", frozenset({3})
    TIMES = "a clip's times: 3 where they cannot be, 2 where OUTPUT cannot hold them", frozenset({2, 3})
    MOTION = "a motion or a log: 3 damaged, 2 where it is sound and contradicts the request", frozenset({2, 3})
    SETTINGS = "a job or a profile: 2 where what it states cannot be meant, 3 where it cannot be read", frozenset({2, 3})
    OPTION = "an option, or several that contradict each other", frozenset({2})
    NAME = "a file's name: 2 where it cannot be one, 3 where nothing can be read under it", frozenset({2, 3})
    PRESENT = "something stands where the result goes, and --overwrite is not given", frozenset({4})
    NONE = "nothing: it is odd, but it can be done, so it must be", frozenset[int]()

    @property
    def codes(self) -> frozenset[int]:
        """The exit codes of a refusal."""
        return self.value[1]


@dataclass(frozen=True, kw_only=True)
class Case:
    """An attack in a folder of its own, in which the command runs."""

    name: str  # room/number, which makes it anew
    family: str  # the row of the table
    words: tuple[str, ...]  # of the command
    fault: Fault
    files: Mapping[str, bytes | Build] = field(default_factory=dict)
    source: str | None = None  # what is restored, for the reader that checks the result
    output: str | None = None  # what success must have written
    frames: int | None = None  # that a result must have; None: as many as an independent reader finds in the source
    replaced: Collection[str] = ()  # files that success may replace
    required: bool = False  # success is an error: the command must refuse


def rng(room: str, number: int) -> np.random.Generator:
    """The chance of one case, the same every time."""
    return np.random.default_rng([number, *room.encode()])
