"""A job cut into numbered chunks: machines restore them in any order, at any time, without knowing of each other; one of them finishes.

The layout, a file in the folder that the job works in, says what each number stands for and what was found in the sources, so that
nobody measures it again. Restored chunks wait in the store.
"""

import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.metadata import version
from itertools import groupby
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ConfigDict, ValidationError

from rsvideo.batch import plan
from rsvideo.batch.plan import Batch, Found, Item, Planned, Unreadable
from rsvideo.batch.workers import Answer, Crew, Cut, Failed, Finish, Order, Restore, answers_to, failed
from rsvideo.config.files import UnreadableError
from rsvideo.config.sidecar import Mark
from rsvideo.config.yaml import ConfigError, shown
from rsvideo.pipeline.pieces import Chunk
from rsvideo.progress import Progress

MOST_CHUNKS = 1_000_000
_MOST_BYTES = 1_000_000_000  # of a layout
_LAYOUT = "layout.json"


class Part(BaseModel):
    """A photograph or clip of a job, and its chunks."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    output: str  # its name
    mark: Mark
    found: Found
    chunks: tuple[Chunk, ...]


class Layout(BaseModel):
    """All chunks of a job, counted from 0 through its photographs and clips."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    rsvideo: str  # the version that cut it
    parts: tuple[Part, ...]

    @property
    def chunks(self) -> tuple[tuple[Part, Chunk], ...]:
        """Each chunk, and what it is of, under its number."""
        return tuple((part, chunk) for part in self.parts for chunk in part.chunks)

    def part(self, output: str) -> Part | None:
        """Of a result, by its name."""
        return next((part for part in self.parts if part.output == output), None)


def laid_out(batch: Batch, plans: Iterable[Planned | Unreadable]) -> Layout:
    """Cut all that can be read, and keep the layout for those who restore and finish."""
    parts = []
    for each in plans:
        if isinstance(each, Planned):
            parts.append(Part(output=each.request.output.name, mark=each.mark, found=Found.of(each.request), chunks=plan.chunks(each)))
            each.store.make()
    layout = Layout(rsvideo=version("rsvideo"), parts=tuple(parts))
    batch.stores.state(_LAYOUT, json.dumps(layout.model_dump()).encode())  # names that are no text are escaped
    return layout


def layout(batch: Batch, job: Path) -> Layout:
    """What `laid_out` kept; ConfigError where there is nothing, or nothing of this version."""
    at, again = batch.stores.at(_LAYOUT), f"rsvideo chunks {job} makes it"
    if batch.stores.stamp(_LAYOUT) is None:
        raise ConfigError(f"{job} is not cut into chunks, there is no {at}; {again}, and all machines must see it")
    data = batch.stores.read(_LAYOUT, most=_MOST_BYTES)
    try:
        stated = json.loads(data)
        if (theirs := str(stated.get("rsvideo"))) != (ours := version("rsvideo")):
            raise ConfigError(f"{job} was cut by rsvideo {theirs}, this is {ours}; all machines need the same version")
        return Layout.model_validate(stated)
    except (ValidationError, json.JSONDecodeError, UnicodeDecodeError, RecursionError, AttributeError) as error:
        raise UnreadableError(f"{at} is damaged; {again} anew") from error


def planned(batch: Batch, cut: Layout, ours: Callable[[Item], bool]) -> list[Planned | Unreadable]:
    """The batch's plan with what its layout holds; ConfigError where settings or a source are no longer those that were cut."""
    plans = plan.settled(batch, ours, {part.output: part.found for part in cut.parts})
    for each in plans:
        if not isinstance(each, Planned):
            continue
        if (part := cut.part(each.request.output.name)) is None:
            raise ConfigError(f"{each.source} is not among the chunks of this job; rsvideo chunks cuts it anew")
        if each.mark != part.mark:
            what = "has changed" if each.mark.source != part.mark.source else "has other settings"
            raise ConfigError(f"{each.source} {what} since it was cut; rsvideo chunks cuts it anew, or is --set not the same?")
    return plans


def numbers(text: str) -> tuple[int, ...]:
    """Numbers of chunks as they are written, such as 3-17 or 3,5-7, in order; ValueError."""
    found: set[int] = set()
    for word in text.split(","):
        first, dash, last = (each.strip() for each in word.partition("-"))
        if not (first.isdecimal() and (last.isdecimal() if dash else True) and len(first + last) <= 16):
            raise ValueError(f"chunks must read like 3, 3-17 or 3,5-7, got {shown(text)}")
        end = int(last) if dash else int(first)
        if end < int(first) or end > MOST_CHUNKS:
            raise ValueError(f"chunks must run from a lower to a higher number, {MOST_CHUNKS} at most, got {shown(word.strip())}")
        found.update(range(int(first), end + 1))
    return tuple(sorted(found))


def written(numbers: Iterable[int]) -> str:
    """The same as a person writes them: 3,5-7."""
    runs = [[n for _, n in run] for _, run in groupby(enumerate(sorted(numbers)), key=lambda pair: pair[1] - pair[0])]
    return ",".join(str(run[0]) if len(run) == 1 else f"{run[0]}-{run[-1]}" for run in runs)


def orders(batch: Batch, cut: Layout, wanted: Sequence[int]) -> dict[int, Restore]:
    """The orders for chunks of these numbers, but for those that a store holds already, or whose clip is finished."""
    every = cut.chunks
    if wanted[-1] >= len(every):
        raise ConfigError(f"chunks must lie in 0 to {len(every) - 1}, got {wanted[-1]}; rsvideo chunks lists them")
    chosen = {number: every[number] for number in wanted}
    outputs = {part.output for part, _ in chosen.values()}
    some = replace(batch, items=tuple(item for item in batch.items if item.request.output.name in outputs))
    plans: dict[str, Planned] = {}
    for each in planned(some, cut, lambda _: True):
        if isinstance(each, Unreadable):
            raise UnreadableError(each.fault)
        plans[each.request.output.name] = each
    awaited = {output for output, each in plans.items() if each.store.there()}
    orders = {
        number: Restore(request=plans[part.output].request, chunk=chunk, folder=Path(), store=plans[part.output].store)
        for number, (part, chunk) in chosen.items()
        if part.output in awaited
    }
    return {number: order for number, order in orders.items() if order.store.record(order.chunk) is None}


def restored(wanted: Mapping[int, Restore], crew: Crew, folder: Path) -> Iterator[tuple[int, Failed | None]]:
    """Restore chunks in a folder of this machine's own, and put them into their stores; each with what went wrong, if anything did."""
    numbers = {(order.store, order.chunk): number for number, order in wanted.items()}
    waiting = deque[Order](replace(order, folder=folder / order.store.name) for order in wanted.values())
    for order, answer in answers_to(waiting, crew):
        if isinstance(order, Restore) and not isinstance(answer, Progress):
            yield numbers[order.store, order.chunk], _put(order, answer)


def _put(order: Restore, answer: Answer) -> Failed | None:
    if isinstance(answer, Failed):
        return answer
    assert isinstance(answer, str)
    try:
        order.store.put(order.chunk, answer, order.folder)
        for name in json.loads(answer)["sha256"]:
            (order.folder / name).unlink()
    except OSError as error:
        return failed(error)
    return None


class Finishers:
    """Hands that restore nothing: a clip's chunks are those of the layout, and one that no store holds is missing."""

    tries = Crew.tries

    def __init__(self, cut: Layout, crew: Crew) -> None:
        self._cut, self._crew = cut, crew
        self._numbers = {(part.output, chunk): number for number, (part, chunk) in enumerate(cut.chunks)}
        self._at_once: list[tuple[Order, Answer]] = []
        self.missing: list[int] = []

    @property
    def busy(self) -> bool:
        """Whether an answer is still to come."""
        return bool(self._at_once) or self._crew.busy

    def free(self, kind: type[Order]) -> bool:
        """Whether one more order of this kind can be given: only the encoding takes time."""
        return kind is not Finish or self._crew.free(kind)

    def give(self, order: Order) -> None:
        """Encode a clip, or answer from the layout."""
        output = order.request.output.name
        if isinstance(order, Cut):
            part = self._cut.part(output)
            assert part is not None, "a plan has been compared with the layout"
            self._at_once.append((order, part.chunks))
        elif isinstance(order, Restore):
            number = self._numbers[output, order.chunk]
            self.missing.append(number)
            self._at_once.append((order, Failed(words=f"chunk {number} is missing", unreadable=True)))
        else:
            self._crew.give(order)

    def answers(self) -> Iterator[tuple[Order, Answer]]:
        """What is answered at once, or else what the encoding reports."""
        if self._at_once:
            now, self._at_once = self._at_once, []
            yield from now
        else:
            yield from self._crew.answers()


def values(cut: Layout, batch: Batch) -> list[dict[str, Any]]:
    """All chunks as plain values."""
    items = {item.request.output.name: item for item in batch.items}
    return [
        {
            "chunk": number,
            "source": items[part.output].source,
            "output": items[part.output].output,
            "first": chunk.first,
            "last": chunk.last,
        }
        for number, (part, chunk) in enumerate(cut.chunks)
    ]
