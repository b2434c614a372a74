"""What workers find in clips before these are planned."""

from collections.abc import Iterator
from pathlib import Path

from rsvideo.batch.plan import Found
from rsvideo.batch.workers import Answer, Failed, Look, Order, found
from rsvideo.config.request import Request, Sections
from rsvideo.progress import Observer, Progress, ignore

NOTHING = Found(measured=None, gyro_offset=None, gyro_axes=None)


class Stub:
    """Hands that take two orders at a time, and answer as their clips' names say."""

    tries = 1

    def __init__(self) -> None:
        self.given: list[str] = []
        self.held: list[Order] = []
        self.most = 0

    @property
    def busy(self) -> bool:
        return bool(self.held)

    def free(self, kind: type[Order]) -> bool:
        assert kind is Look
        return len(self.held) < 2

    def give(self, order: Order) -> None:
        self.held.append(order)
        self.given.append(order.request.source.stem)
        self.most = max(self.most, len(self.held))

    def answers(self) -> Iterator[tuple[Order, Answer]]:
        order = self.held.pop(0)
        failed = Failed(words="no", unreadable=order.request.source.stem == "damaged", again=order.request.source.stem == "killed")
        yield order, NOTHING if order.request.source.stem in "abcd" else failed


def looked_at(*stems: str, observe: Observer = ignore) -> tuple[list[str], Stub]:
    """The outputs of whose clips something was found."""
    hands = Stub()
    requests = [Request.of(Path(f"{stem}.mp4"), Path(f"{stem}_out.mp4"), Sections()) for stem in stems]
    return [*found(requests, hands, observe)], hands


def test_as_many_clips_are_looked_at_as_hands_are_free() -> None:
    outputs, hands = looked_at("a", "b", "c")
    assert (outputs, hands.most) == (["a_out.mp4", "b_out.mp4", "c_out.mp4"], 2)


def test_of_a_damaged_clip_and_of_one_whose_worker_died_nothing_is_found() -> None:
    assert looked_at("a", "damaged", "b", "killed", "c")[0] == ["a_out.mp4", "b_out.mp4", "c_out.mp4"]


def test_after_a_wrong_request_no_more_are_looked_at() -> None:
    outputs, hands = looked_at("wrong", "a", "b", "c")
    assert (outputs, hands.given) == (["a_out.mp4"], ["wrong", "a"])


def test_how_many_clips_are_looked_into_is_told() -> None:
    told = list[Progress]()
    looked_at("a", "damaged", "b", "c", observe=told.append)
    assert [(each.stage.split()[-1], each.fraction) for each in told] == [
        ("a.mp4", 0.25),
        ("damaged.mp4", 0.5),
        ("b.mp4", 0.75),
        ("c.mp4", 1.0),
    ]
