"""From a job's file to one request per photograph and clip, and what each comes to."""

import glob
import hashlib
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import BaseModel, ConfigDict

from rsvideo.batch import cache, objects, sources
from rsvideo.batch.job import JobFile, Overrides, Report, overrides, parsed
from rsvideo.batch.places import Folder, Place, key
from rsvideo.batch.recognition import relative
from rsvideo.batch.sources import Source
from rsvideo.batch.store import FOLDER, Store
from rsvideo.config import address, names, yaml
from rsvideo.config.files import UnreadableError
from rsvideo.config.media import SEQUENCES, is_clip, is_sequence
from rsvideo.config.request import Measured, Request, Sections
from rsvideo.config.sidecar import Mark
from rsvideo.config.yaml import ConfigError, Positions, shown
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline import deblur, demand, devices, fingerprint
from rsvideo.pipeline.pieces import Chunk
from rsvideo.pipeline.prepare import prepare
from rsvideo.progress import Observer, Progress, ignore

_LONGEST_STEM, _TELLING = 40, 8  # characters of a folder's name


@dataclass(frozen=True, kw_only=True)
class Item:
    """One photograph or clip, and the line of the file that asks for it."""

    request: Request
    where: str
    results: Place  # where the result goes, and what is written with it
    input: str  # the source, relative to the results where both can be moved together

    @property
    def source(self) -> str:
        """What people call it."""
        return self.request.named

    @property
    def output(self) -> str:
        """What people call it."""
        return self.results.at(self.request.output.name)

    @property
    def written(self) -> list[str]:
        """All that is written, as people call it."""
        return [self.results.at(path.name) for path in self.request.files]


@dataclass(frozen=True, kw_only=True)
class Batch:
    """All that a job's file asks for."""

    folder: Path  # of the results; of those that go elsewhere, the one that is worked in
    working: Path  # of what is kept until all is done
    results: Place
    stores: Place  # where machines leave what they have restored
    job: str  # the job's file, relative to the results where both can be moved together
    items: tuple[Item, ...]
    report: Report

    def working_in(self, folder: Path) -> "Batch":
        """The same for a machine that makes no results: those that go elsewhere need no folder beside the job's file."""
        if isinstance(self.results, Folder):
            return self
        items = [replace(item, request=item.request.replaced(output=folder / item.request.output.name)) for item in self.items]
        return replace(self, folder=folder, items=tuple(items))


class Found(BaseModel):
    """What was found in a source before its work, and need not be looked for again."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    measured: Measured | None
    gyro_offset: float | None
    gyro_axes: str | None

    @classmethod
    def of(cls, request: Request) -> "Found":
        """As a request states it that was prepared."""
        return cls(measured=request.measured, gyro_offset=request.motion.gyro_offset, gyro_axes=request.motion.gyro_axes)

    def stated(self, request: Request) -> Request:
        """The request with it."""
        gyro = {name: value for name in ("gyro_offset", "gyro_axes") if (value := getattr(self, name)) is not None}
        return request.replaced(measured=self.measured, **({"motion": gyro} if gyro else {}))


@dataclass(frozen=True, kw_only=True)
class Planned:
    """A photograph or clip whose every question is answered."""

    request: Request
    timing: ShutterTiming
    timing_source: str
    notes: tuple[str, ...]
    first: int
    frames: int
    rows: int
    cols: int
    seconds: float  # a rough guess at the work
    bytes: int  # of disk, while it lasts
    item: Item  # as it was before its questions were answered
    store: Store
    mark: Mark

    @property
    def source(self) -> str:
        """What people call it."""
        return self.item.source

    @property
    def output(self) -> str:
        """What people call it."""
        return self.item.output

    def values(self, chunks: Sequence[Chunk]) -> dict[str, Any]:
        """The plan as plain values."""
        return {
            "source": self.source,
            "output": self.output,
            "sidecar": self.item.results.at(self.request.record.name),
            "frames": self.frames,
            "rows": self.rows,
            "cols": self.cols,
            "exposure_s": self.timing.exposure,
            "row_time_s": self.timing.row_time,
            "direction": str(self.timing.direction),
            "timing_source": self.timing_source,
            "chunks": [asdict(chunk) for chunk in chunks],
            "seconds": self.seconds,
            "bytes": self.bytes,
            "notes": self.notes,
        }


@dataclass(frozen=True, kw_only=True)
class Unreadable:
    """What cannot be restored, for its source is missing or damaged."""

    source: str
    output: str
    fault: str


def read(path: Path, sets: Sequence[str] = (), *, overwrite: bool = False) -> Batch:
    """The batch in a job's file; raises ConfigError, or UnreadableError for a file that is missing."""
    data, positions = yaml.load(path)
    job, wanted = parsed(data, positions), overrides(sets)
    output = job.output.model_copy(update=wanted.output.model_dump(exclude_unset=True))
    report = job.report.model_copy(update=wanted.report.model_dump(exclude_unset=True))
    batch = _placed(path, output.folder, report, positions)
    items = _without_results(_items(job, wanted, positions, batch, output.name, overwrite=overwrite))
    _check_results(items, path)
    return replace(batch, items=tuple(items))


def _placed(path: Path, folder: str, report: Report, positions: Positions) -> Batch:
    """A batch without its items: where its results go, and where it works."""
    working = working_of(path, folder)
    if not address.is_address(folder):
        results, stores = Folder(path=path.parent / folder), Folder(path=working / FOLDER)
        name = relative(path, results.path)
        return Batch(folder=results.path, working=working, results=results, stores=stores, job=name, items=(), report=report)
    try:
        if glob.has_magic(folder):
            raise ValueError(f"must be one address, not a pattern, got {shown(folder)}")
        results = objects.Objects(address=str(address.parsed(folder)))
    except ValueError as error:
        raise ConfigError(positions.fault(("output", "folder"), str(error))) from error
    stores = results.within(f".rsvideo-{_telling(path.name)}/{FOLDER}")  # the same from all machines, wherever they keep the job
    return Batch(folder=working, working=working, results=results, stores=stores, job=path.name, items=(), report=report)


def working_of(job: Path, folder: str) -> Path:
    """The folder of this machine in which a job works whose results go to `folder`; jobs of one name in two folders do not share it."""
    stem = job.stem[:_LONGEST_STEM]
    if address.is_address(folder):
        return job.parent / f".rsvideo-{stem}-{_telling(folder.removesuffix('/'))}"
    results = job.parent / folder
    return results / f".rsvideo-{stem}-{_telling(relative(job, results))}"


def _telling(name: str) -> str:
    return hashlib.sha256(name.encode()).hexdigest()[:_TELLING]


def settled(
    batch: Batch, ours: Callable[[Item], bool], found: Mapping[str, Found] = MappingProxyType({}), observe: Observer = ignore
) -> list["Planned | Unreadable"]:
    """Open all sources and answer every question; `ours` says whether what stands under an item's names was written by this very job.

    `found` is what need not be looked for again, by the names of the outputs. A damaged source does not hold up the others; a wrong
    request (ConfigError) or an output that exists (FileExistsError) does.
    """
    plans = []
    for number, item in enumerate(batch.items):
        observe(Progress(stage=f"looking into {item.source}", fraction=number / len(batch.items)))
        plans.append(_settled(item, batch, ours=ours(item), found=found.get(item.request.output.name)))
    taken: dict[Path, Planned] = {}
    for plan in plans:
        if isinstance(plan, Planned) and (other := taken.setdefault(plan.request.record, plan)) is not plan:
            record = plan.item.results.at(plan.request.record.name)
            raise ConfigError(f"{plan.source} and {other.source} would both write {record}; give one of them another name")
    return plans


def clips(batch: Batch) -> list[Request]:
    """Of the clips that lie on this machine, each with its device: what others need to look for what their plans must know."""
    local = (item.request for item in batch.items if item.request.is_clip and item.request.origin is None)
    return [devices.settled(request.replaced(overwrite=True)) for request in local]  # they write nothing


def chunks(plan: Planned) -> tuple[Chunk, ...]:
    """Where the source will be cut."""
    return tuple(deblur.chunks(prepare(plan.request)))


def _settled(item: Item, batch: Batch, *, ours: bool, found: Found | None) -> "Planned | Unreadable":
    request = item.request.replaced(overwrite=item.request.overwrite or ours)
    try:
        _check_free(item, overwrite=request.overwrite)
        if request.origin:
            cache.bring(request.origin)
        task = prepare(found.stated(request) if found else request)
        demand.check(task)
        settings, source = _fingerprints(request, task.timing)
        seconds, size = task.estimate()
    except FileExistsError as error:
        raise FileExistsError(f"{item.where}: {error}") from error
    except UnreadableError as error:
        return Unreadable(source=item.source, output=item.output, fault=" ".join(str(error).split()))
    except ValueError as error:
        raise ConfigError(f"{item.where}: {item.source}: {error}") from error
    mark = Mark(job=batch.job, input=item.input, settings=settings, source=source)
    return Planned(
        request=task.request,
        timing=task.timing,
        timing_source=task.timing_source,
        notes=tuple(task.notes),
        first=task.first,
        frames=task.frames,
        rows=task.rows,
        cols=task.cols,
        seconds=float(seconds),
        bytes=int(size),
        item=item,
        store=Store.of(batch.stores, item.request.output.name, mark),
        mark=mark,
    )


def _check_free(item: Item, *, overwrite: bool) -> None:
    """Of results that go elsewhere; those in a folder are checked with all that concerns files."""
    if isinstance(item.results, Folder):
        return
    if item.request.is_clip and (item.request.encoding.codec in SEQUENCES or is_sequence(item.request.source)):
        raise ValueError("a folder of pictures cannot be a result in object storage; codec must be one that clips are kept in")
    for path in item.request.files:
        if not overwrite and item.results.stamp(path.name):
            raise FileExistsError(f"{item.results.at(path.name)} exists already; give --overwrite to replace it")


def _fingerprints(request: Request, timing: ShutterTiming) -> tuple[str, str]:
    """Of all that steers the work, and of the source."""
    try:
        steering = {"request": fingerprint.of_request(request), "timing": repr(timing)}
        return fingerprint.of_values(steering), fingerprint.of_source(request.source)
    except OSError as error:
        raise UnreadableError(f"{error.filename} cannot be read: {error.strerror}") from error


def _items(
    job: JobFile, wanted: Overrides, positions: Positions, batch: Batch, pattern: str, *, overwrite: bool
) -> Iterator[tuple[Item, bool]]:
    """What the entries come to, each with whether its source is named itself, not only matched by a pattern."""
    beside = positions.path.parent
    for number, clip in enumerate(job.clips):
        layers = job.sections(clip, wanted)
        whole = Sections.layered(layers).files_beside(beside)
        of_photographs = [
            Sections.layered(each if each is clip and named else each.without_clips_options() for each in layers).files_beside(beside)
            for named in (False, True)
        ]
        for at, name in enumerate(clip.source):
            place = ("clips", number, "source", at)
            for source in sources.meant(name, place, positions):
                output = batch.folder / _result_name(source, clip.name or pattern)
                treated = whole if is_clip(source.path) else of_photographs[source.named]
                request = Request.of(source.path, output, treated, overwrite=overwrite, origin=source.origin)
                given = _input(source, batch.results, positions.path.parent)
                yield Item(request=request, where=positions.where(place), results=batch.results, input=given), source.named


def _input(source: Source, results: Place, beside: Path) -> str:
    """A source as a result's mark names it: the same on all machines, and where both are moved together."""
    if source.origin is None:
        return relative(source.path, results.path if isinstance(results, Folder) else beside)
    return source.origin.address if isinstance(results, Folder) else address.relative(source.origin.address, results.at())


def _result_name(source: Source, pattern: str) -> str:
    parts = source.parts
    return re.sub(r"\{(\w+)\}", lambda match: parts[match[1]], pattern)


def _without_results(items: Iterator[tuple[Item, bool]]) -> list[Item]:
    """A pattern such as *.mp4 does not mean what the job itself has written beside its sources."""
    all_of_them = list(items)
    by_result = {key(item.output): item for item, _ in all_of_them}
    return [each for each, named in all_of_them if named or by_result.get(key(each.source)) in (None, each)]


def _check_results(items: Sequence[Item], job: Path) -> None:
    """Refuse names of results that cannot be, and those of sources, of each other and of anything else that the job reads."""
    taken: dict[str, Item] = {}
    by_source = {key(item.source): item for item in items}
    inputs = {key(str(path)) for item in items for path in item.request.inputs} | {key(str(job)), *by_source}
    for item in items:
        try:
            names.check(*item.request.files)
        except ValueError as error:
            raise ConfigError(f"{item.where}: {error}") from error
        if (other := taken.setdefault(item.output, item)) is not item:
            raise ConfigError(
                f"{item.where}: {item.source} would write {item.output}, as {other.source} does ({other.where});"
                " each source needs a name of its own: {folder} in output.name stands for the source's folder"
            )
        if (other := by_source.get(key(item.output))) is not None:
            raise ConfigError(f"{item.where}: {item.output} is the result of {item.source} and a source too ({other.where})")
        if (read := next((written for written in item.written if key(written) in inputs), None)) is not None:
            raise ConfigError(f"{item.where}: {read} would be written with the result of {item.source}, and is read by this job too")
