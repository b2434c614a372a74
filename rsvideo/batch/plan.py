"""From a job's file to one request per photograph and clip, and what each comes to."""

import glob
import hashlib
import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from itertools import islice
from pathlib import Path
from types import MappingProxyType
from typing import Any

from pydantic import BaseModel, ConfigDict

from rsvideo.batch.job import Clip, JobFile, Overrides, Report, overrides, parsed
from rsvideo.batch.recognition import relative
from rsvideo.config import names, patterns, yaml
from rsvideo.config.files import UnreadableError
from rsvideo.config.media import is_clip
from rsvideo.config.placing import real
from rsvideo.config.request import Measured, Request, Sections
from rsvideo.config.sidecar import Mark
from rsvideo.config.yaml import ConfigError, Positions, shown
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline import deblur, demand, fingerprint
from rsvideo.pipeline.pieces import Chunk
from rsvideo.pipeline.prepare import prepare

MOST_SOURCES = 10_000
_LONGEST_STEM, _TELLING = 40, 8  # characters of a folder's name


@dataclass(frozen=True, kw_only=True)
class Item:
    """One photograph or clip, and the line of the file that asks for it."""

    request: Request
    where: str


@dataclass(frozen=True, kw_only=True)
class Batch:
    """All that a job's file asks for."""

    folder: Path  # of the results
    working: Path  # of what is kept until all is done
    job: str  # the job's file, relative to the folder
    items: tuple[Item, ...]
    report: Report


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
    overwrite: bool  # whatever stands there; the request's own is true of the job's own results too
    mark: Mark

    def values(self, chunks: Sequence[Chunk]) -> dict[str, Any]:
        """The plan as plain values."""
        return {
            "source": str(self.request.source),
            "output": str(self.request.output),
            "sidecar": str(self.request.record),
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
    folder = path.parent / output.folder
    items = _without_results(_items(job, wanted, positions, folder, output.name, overwrite=overwrite))
    _check_results(items, path)
    return Batch(folder=folder, working=working_of(path, folder), job=relative(path, folder), items=tuple(items), report=report)


def working_of(job: Path, folder: Path) -> Path:
    """The folder in which a job works whose results go to `folder`."""
    own = hashlib.sha256(relative(job, folder).encode()).hexdigest()[:_TELLING]  # jobs of one name in two folders do not share it
    return folder / f".rsvideo-{job.stem[:_LONGEST_STEM]}-{own}"


def settled(
    batch: Batch, ours: Callable[[Request], bool], found: Mapping[str, Found] = MappingProxyType({})
) -> list["Planned | Unreadable"]:
    """Open all sources and answer every question; `ours` says whether what stands under a request's names was written by this very job.

    `found` is what need not be looked for again, by the names of the outputs. A damaged source does not hold up the others; a wrong
    request (ConfigError) or an output that exists (FileExistsError) does.
    """
    plans = [_settled(item, batch.job, ours=ours(item.request), found=found.get(item.request.output.name)) for item in batch.items]
    taken: dict[Path, Planned] = {}
    for plan in plans:
        if isinstance(plan, Planned) and (other := taken.setdefault(plan.request.record, plan)) is not plan:
            sources = f"{plan.request.source} and {other.request.source}"
            raise ConfigError(f"{sources} would both write {plan.request.record}; give one of them another name")
    return plans


def chunks(plan: Planned) -> tuple[Chunk, ...]:
    """Where the source will be cut."""
    return tuple(deblur.chunks(prepare(plan.request)))


def _settled(item: Item, job: str, *, ours: bool, found: Found | None) -> "Planned | Unreadable":
    request = item.request.replaced(overwrite=item.request.overwrite or ours)
    try:
        task = prepare(found.stated(request) if found else request)
        demand.check(task)
        settings, source = _fingerprints(request, task.timing)
        seconds, size = task.estimate()
    except FileExistsError as error:
        raise FileExistsError(f"{item.where}: {error}") from error
    except UnreadableError as error:
        return Unreadable(source=str(request.source), output=str(request.output), fault=" ".join(str(error).split()))
    except ValueError as error:
        raise ConfigError(f"{item.where}: {request.source}: {error}") from error
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
        overwrite=item.request.overwrite,
        mark=Mark(job=job, input=relative(request.source, request.output.parent), settings=settings, source=source),
    )


def _fingerprints(request: Request, timing: ShutterTiming) -> tuple[str, str]:
    """Of all that steers the work, and of the source."""
    try:
        steering = {"request": fingerprint.of_request(request), "timing": repr(timing)}
        return fingerprint.of_values(steering), fingerprint.of_source(request.source)
    except OSError as error:
        raise UnreadableError(f"{error.filename} cannot be read: {error.strerror}") from error


def _items(
    job: JobFile, wanted: Overrides, positions: Positions, folder: Path, pattern: str, *, overwrite: bool
) -> Iterator[tuple[Item, bool]]:
    """What the entries come to, each with whether its source is named itself, not only matched by a pattern."""
    for number, clip in enumerate(job.clips):
        layers = job.sections(clip, wanted)
        sections = Sections.layered(layers).files_beside(positions.path.parent)
        of_photographs = [
            Sections.layered(each if each is clip and named else each.without_clips_options() for each in layers).files_beside(
                positions.path.parent
            )
            for named in (False, True)
        ]
        for place, source, named in _sources(clip, number, positions):
            output = folder / _result_name(source, clip.name or pattern)
            treated = sections if is_clip(source) else of_photographs[named]
            yield Item(request=Request.of(source, output, treated, overwrite=overwrite), where=positions.where(place)), named


def _result_name(source: Path, pattern: str) -> str:
    parts = {"stem": source.name if source.is_dir() else source.stem, "ext": "" if source.is_dir() else source.suffix}
    parts["folder"] = source.absolute().parent.name
    return re.sub(r"\{(\w+)\}", lambda match: parts[match[1]], pattern)


def _sources(clip: Clip, number: int, positions: Positions) -> Iterator[tuple[tuple[str | int, ...], Path, bool]]:
    folder = positions.path.parent
    for at, pattern in enumerate(clip.source):
        place = ("clips", number, "source", at)
        path = folder / pattern
        if not pattern.strip() or "\0" in pattern:
            raise ConfigError(positions.fault(place, f"must name a clip or a photograph, got {shown(pattern)}"))
        if os.path.exists(path):  # noqa: PTH110 # Path.exists raises on a name that is too long
            yield place, path, True
        elif not glob.has_magic(pattern):
            raise UnreadableError(positions.fault(place, f"{path} does not exist; names are relative to the folder of the job's file"))
        else:
            try:
                found = sorted(set(islice(patterns.matching(pattern, folder), MOST_SOURCES + 1)))
            except ValueError as error:
                raise ConfigError(positions.fault(place, str(error))) from error
            if not found:
                raise ConfigError(positions.fault(place, f"nothing in {folder.absolute()} matches {shown(pattern)}"))
            if len(found) > MOST_SOURCES:
                raise ConfigError(positions.fault(place, f"{shown(pattern)} must match at most {MOST_SOURCES} files"))
            for each in found:
                yield place, each, False


def _without_results(items: Iterator[tuple[Item, bool]]) -> list[Item]:
    """A pattern such as *.mp4 does not mean what the job itself has written beside its sources."""
    all_of_them = list(items)
    by_result = {real(item.request.output): item for item, _ in all_of_them}
    return [each for each, named in all_of_them if named or by_result.get(real(each.request.source)) in (None, each)]


def _check_results(items: Sequence[Item], job: Path) -> None:
    """Refuse names of results that cannot be, and those of sources, of each other and of anything else that the job reads."""
    taken: dict[Path, Item] = {}
    sources = {real(item.request.source): item for item in items}
    inputs = {real(path) for item in items for path in item.request.inputs} | {real(job)}
    for item in items:
        output = item.request.output
        try:
            names.check(*item.request.files)
        except ValueError as error:
            raise ConfigError(f"{item.where}: {error}") from error
        if (other := taken.setdefault(output, item)) is not item:
            raise ConfigError(
                f"{item.where}: {item.request.source} would write {output}, as {other.request.source} does ({other.where});"
                " each source needs a name of its own: {folder} in output.name stands for the source's folder"
            )
        if (other := sources.get(real(output))) is not None:
            raise ConfigError(f"{item.where}: {output} is the result of {item.request.source} and a source too ({other.where})")
        if (path := next((path for path in item.request.files if real(path) in inputs), None)) is not None:
            raise ConfigError(
                f"{item.where}: {path} would be written with the result of {item.request.source}, and is read by this job too"
            )
