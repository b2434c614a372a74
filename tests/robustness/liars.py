"""Programs that do wrong, each in one way, and what the harness must find: `judged(name)`."""

import os
import time
from collections.abc import Callable
from pathlib import Path

from tests.robustness import harness
from tests.robustness.case import Case, Fault

_HELD: list[bytearray] = []


def _raises(_: tuple[str, ...]) -> int:
    raise AttributeError("height")


def _hangs(_: tuple[str, ...]) -> int:
    time.sleep(60)
    return 3


def _fails(_: tuple[str, ...]) -> int:
    print("rsvideo: failed while working: AttributeError: height")
    return 1


def _writes_nothing(_: tuple[str, ...]) -> int:
    return 0


def _writes_half(_: tuple[str, ...]) -> int:
    Path("out.png").write_bytes(Path("in.png").read_bytes()[:-200])
    return 0


def _holds_much(_: tuple[str, ...]) -> int:
    _HELD.append(bytearray(os.urandom(1)) * (harness.MEMORY + (100 << 20)))
    return _refuses(())


def _replaces(_: tuple[str, ...]) -> int:
    Path("in.png").write_bytes(b"")
    return _refuses(())


def _leaves(_: tuple[str, ...]) -> int:
    Path("out.png.part").touch()
    return _refuses(())


def _orphans(_: tuple[str, ...]) -> int:
    if not os.fork():
        time.sleep(60)
    return _refuses(())


def _explains_twice(_: tuple[str, ...]) -> int:
    print("rsvideo: in.png is damaged")
    return _refuses(())


def _colours(_: tuple[str, ...]) -> int:
    print("rsvideo: \x1b[31min.png is damaged")
    return 3


def _refuses(_: tuple[str, ...]) -> int:
    print("rsvideo: in.png is damaged")
    return 3


def _restores(_: tuple[str, ...]) -> int:
    Path("out.png").write_bytes(Path("in.png").read_bytes())
    return 0


LIARS: dict[str, tuple[Callable[[tuple[str, ...]], int], str]] = {
    "raises": (_raises, "traceback"),
    "hangs": (_hangs, "hang"),
    "fails": (_fails, "wrong code"),
    "writes nothing": (_writes_nothing, "false success"),
    "writes half": (_writes_half, "false success"),
    "holds much": (_holds_much, "memory"),
    "replaces": (_replaces, "loss"),
    "leaves": (_leaves, "left behind"),
    "orphans": (_orphans, "left behind"),
    "explains twice": (_explains_twice, "unclear"),
    "colours": (_colours, "unclear"),
    "refuses": (_refuses, "refused"),
    "restores": (_restores, "restored"),
}


def judged(name: str, picture: bytes) -> str:
    """The verdict on one of them, under small limits; in a process of its own, since it forks."""
    harness.SECONDS, harness.MEMORY, harness.GRACE = 3, 600 << 20, 0.2
    case = Case(
        name=f"liars/{name}", family="liars", words=(), fault=Fault.SOURCE, files={"in.png": picture}, source="in.png", output="out.png"
    )
    return harness.answer(case, program=LIARS[name][0]).verdict
