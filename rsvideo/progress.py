"""How far a piece of work has come, reported while it goes on."""

import time
from collections.abc import Callable
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class Progress:
    """A stage of the work, and how much of it is done."""

    stage: str
    fraction: float  # 0 to 1: of that frame's work where a frame is named, else of the whole work
    frame: int | None = None  # the index of the frame that is worked on, in a clip


SELDOM = 0.1  # seconds between two reports that go to another process

Observer = Callable[[Progress], None]


def ignore(_: Progress) -> None:
    """Watch nothing."""


def within(observe: Observer, begin: float, end: float, prefix: str = "") -> Observer:
    """An observer of a part of the work, which goes from one fraction of the whole to another."""

    def part(at: Progress) -> None:
        observe(Progress(stage=prefix + at.stage, fraction=begin + (end - begin) * at.fraction, frame=at.frame))

    return part


def seldom(observe: Observer) -> Observer:
    """An observer that passes on what concerns another frame than before, and else a few times a second."""
    last = (None, -SELDOM)

    def now_and_then(at: Progress) -> None:
        nonlocal last
        now = time.monotonic()
        if at.frame != last[0] or now - last[1] >= SELDOM:
            last = at.frame, now
            observe(at)

    return now_and_then
