"""Reports of how far a piece of work has come."""

import pytest

from rsvideo import progress
from rsvideo.progress import Progress, seldom, within


def test_a_part_of_the_work_counts_from_where_it_begins() -> None:
    seen = list[Progress]()
    within(seen.append, 0.25, 0.75, "half size: ")(Progress(stage="motion", fraction=0.5, frame=3))
    assert seen == [Progress(stage="half size: motion", fraction=0.5, frame=3)]


def test_of_one_frame_little_is_passed_on_and_of_another_at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = [0.0]
    monkeypatch.setattr(progress, "SELDOM", 1.0)
    monkeypatch.setattr(progress.time, "monotonic", lambda: clock[0])
    seen = list[tuple[float, int | None]]()
    observe = seldom(lambda at: seen.append((clock[0], at.frame)))
    for tick in range(100):
        clock[0] = tick / 8
        observe(Progress(stage="restoring", fraction=0.5, frame=tick // 52))
    assert seen == [*((float(second), 0) for second in range(7)), *((6.5 + second, 1) for second in range(6))]
