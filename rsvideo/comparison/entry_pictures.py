"""The recording, what methods made of it, and its truth: their pictures, lined up frame by frame."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

from rsvideo.comparison.decoded import DecodedPicture, Source
from rsvideo.comparison.method_run import MethodRun
from rsvideo.config import sidecar
from rsvideo.config.sidecar import FrameRecord, Sidecar
from rsvideo.report.comparison import Role


@dataclass(frozen=True, kw_only=True, eq=False)
class EntryPictures:
    """The pictures of one entry, in order, under the indices of the source's frames."""

    name: str
    role: Role
    pictures: Iterator[tuple[int, DecodedPicture]]
    run: MethodRun | None = None  # of a method
    sidecar: Sidecar | None = None

    @cached_property
    def records(self) -> Mapping[int, FrameRecord]:
        """Of frames, by their index."""
        return {} if self.sidecar is None else {record.index: record for record in self.sidecar.frames}


def opened(source: Source, runs: Sequence[MethodRun], truth: Path | None) -> list[EntryPictures]:
    """The recording first, unless the method `none` stands for it; then the methods that gave a result; the truth last."""
    entries = [_of_method(source, run) for run in runs if run.fault is None]
    entries.sort(key=lambda entry: entry.name != "none")
    part = range(source.first, source.last)
    if not entries or entries[0].name != "none":
        entries.insert(0, EntryPictures(name="recorded", role="recorded", pictures=zip(part, source.own(), strict=False)))
    if truth is not None:
        entries.append(EntryPictures(name="truth", role="truth", pictures=zip(part, source.of_truth(truth), strict=False)))
    return entries


def _of_method(source: Source, run: MethodRun) -> EntryPictures:
    held = sidecar.read(run.record) if run.record.exists() else None
    indices = range(source.first, source.last) if held is None else [frame.index for frame in held.frames]
    pictures = zip(indices, source.of_result(run.output), strict=False)
    return EntryPictures(name=run.method, role="method", pictures=pictures, run=run, sidecar=held)


def lined_up(entries: Sequence[EntryPictures], source: Source) -> Iterator[tuple[int, dict[str, DecodedPicture]]]:
    """Frame by frame, the pictures of all entries that have one, by the entries' names."""
    heads = {entry.name: next(entry.pictures, None) for entry in entries}
    for index in range(source.first, source.last):
        pictures = {}
        for entry in entries:
            while (head := heads[entry.name]) is not None and head[0] < index:
                heads[entry.name] = next(entry.pictures, None)
            if head is not None and head[0] == index:
                pictures[entry.name] = head[1]
                heads[entry.name] = next(entry.pictures, None)
        yield index, pictures
