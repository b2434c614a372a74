"""How far a piece of work has come, reported while it goes on."""

from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Progress:
    """A stage of the work, and how much of it is done."""

    stage: str
    fraction: float  # 0 to 1: of that frame's work where a frame is named, else of the whole work
    frame: int | None = None  # the index of the frame that is worked on, in a clip


Observer = Callable[[Progress], None]


def ignore(_: Progress) -> None:
    """Watch nothing."""


def within(observe: Observer, begin: float, end: float, prefix: str = "") -> Observer:
    """An observer of a part of the work, which goes from one fraction of the whole to another."""

    def part(at: Progress) -> None:
        observe(Progress(stage=prefix + at.stage, fraction=begin + (end - begin) * at.fraction, frame=at.frame))

    return part
