"""From a job's file to one request per clip, and what each comes to."""

import glob
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from typing import Any

from rsvideo.batch.job import Clip, JobFile, Said, Treatment, said, understood
from rsvideo.config import yaml
from rsvideo.config.files import UnreadableError
from rsvideo.config.method import GyroFile
from rsvideo.config.yaml import ConfigError, Positions, shown
from rsvideo.physics.shutter import ShutterTiming
from rsvideo.pipeline import chunk, clip_job, fingerprint
from rsvideo.pipeline.chunk import Chunk
from rsvideo.pipeline.clip_job import ClipJob

MOST_CLIPS = 10_000


@dataclass(frozen=True, kw_only=True)
class Request:
    """One clip, and the line of the file that asks for it."""

    job: ClipJob
    where: str


@dataclass(frozen=True, kw_only=True)
class Batch:
    """All that a job's file asks for."""

    folder: Path  # of the results
    working: Path  # of what is kept until all is done
    requests: tuple[Request, ...]
    most_failed_frames: int


@dataclass(frozen=True, kw_only=True)
class Planned:
    """A clip whose every question is answered."""

    job: ClipJob
    record: Path  # the sidecar
    timing: ShutterTiming
    timing_source: str
    notes: tuple[str, ...]
    frames: int
    rows: int
    cols: int
    seconds: float  # a rough guess at the work
    bytes: int  # of disk, while it lasts
    settings: str  # fingerprints
    source: str

    def told(self, chunks: Sequence[Chunk]) -> dict[str, Any]:
        """The plan as plain values."""
        return {
            "source": str(self.job.source),
            "output": str(self.job.output),
            "sidecar": str(self.record),
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
    """A clip that cannot be restored, for its source is missing or damaged."""

    source: str
    output: str
    fault: str


def read(path: Path, sets: Sequence[str] = (), *, overwrite: bool = False) -> Batch:
    """The batch in a job's file; raises ConfigError, or UnreadableError for a file that is missing."""
    data, positions = yaml.load(path)
    job, wanted = understood(data, positions), said(sets)
    output = job.output.model_copy(update=wanted.output.model_dump(exclude_unset=True))
    report = job.report.model_copy(update=wanted.report.model_dump(exclude_unset=True))
    folder = _beside(path, output.folder)
    requests = _without_results(_requests(job, wanted, positions, folder, output.name, overwrite=overwrite))
    _check_apart(requests)
    return Batch(
        folder=folder,
        working=folder / f".rsvideo-{path.stem}",
        requests=tuple(request for request, _ in requests),
        most_failed_frames=report.most_failed_frames,
    )


def settled(batch: Batch, ours: Callable[[str], bool]) -> list["Planned | Unreadable"]:
    """Open all clips and answer every question; `ours` says whether an output of that name was written by this very job.

    A damaged clip does not hold up the others; a wrong request (ConfigError) or an output that exists (FileExistsError) does.
    """
    clips = [_settled(request, ours=ours(request.job.output.name)) for request in batch.requests]
    taken: dict[Path, Planned] = {}
    for clip in clips:
        if isinstance(clip, Planned) and (other := taken.setdefault(clip.record, clip)) is not clip:
            sources = f"{clip.job.source} and {other.job.source}"
            raise ConfigError(f"{sources} would both write {clip.record}; give one of them another name")
    return clips


def chunks(clip: Planned) -> tuple[Chunk, ...]:
    """Where the clip will be cut."""
    return tuple(chunk.chunks(clip_job.prepare(clip.job)))


def _settled(request: Request, *, ours: bool) -> "Planned | Unreadable":
    job = replace(request.job, overwrite=request.job.overwrite or ours)
    try:
        task = clip_job.prepare(job)
        settings, source = _fingerprints(job, task.timing)
        seconds, size = task.estimate()
    except FileExistsError as error:
        raise FileExistsError(f"{request.where}: {error}") from error
    except UnreadableError as error:
        return Unreadable(source=str(job.source), output=str(job.output), fault=" ".join(str(error).split()))
    except ValueError as error:
        raise ConfigError(f"{request.where}: {job.source}: {error}") from error
    return Planned(
        job=task.job,
        record=task.job.record,
        timing=task.timing,
        timing_source=task.timing_source,
        notes=tuple(task.notes),
        frames=task.frames,
        rows=task.rows,
        cols=task.cols,
        seconds=float(seconds),
        bytes=int(size),
        settings=settings,
        source=source,
    )


def _fingerprints(job: ClipJob, timing: ShutterTiming) -> tuple[str, str]:
    """Of all that steers the work, and of the source."""
    try:
        return fingerprint.of_values({"request": fingerprint.of_request(job), "timing": repr(timing)}), fingerprint.of_source(job.source)
    except OSError as error:
        raise UnreadableError(f"{error.filename} cannot be read: {error.strerror}") from error


def _requests(
    job: JobFile, wanted: Said, positions: Positions, folder: Path, pattern: str, *, overwrite: bool
) -> Iterator[tuple[Request, bool]]:
    for number, clip in enumerate(job.clips):
        treatment = job.treatment(clip, wanted)
        for place, source, literal in _sources(clip, number, positions):
            parts = {"stem": source.name if source.is_dir() else source.stem, "ext": "" if source.is_dir() else source.suffix}
            parts["folder"] = source.absolute().parent.name
            name = re.sub(r"\{(\w+)\}", lambda match, parts=parts: parts[match[1]], clip.name or pattern)
            made = _job(treatment, source, folder / name, positions.path, overwrite=overwrite)
            yield Request(job=made, where=positions.where(place)), literal


def _sources(clip: Clip, number: int, positions: Positions) -> Iterator[tuple[tuple[str | int, ...], Path, bool]]:
    folder = positions.path.parent
    for at, pattern in enumerate(clip.source):
        place = ("clips", number, "source", at)
        path = folder / pattern
        if not pattern.strip() or "\0" in pattern:
            raise ConfigError(positions.fault(place, f"must name a clip, got {shown(pattern)}"))
        if path.exists():
            yield place, path, True
        elif not glob.has_magic(pattern):
            raise UnreadableError(positions.fault(place, f"{path} does not exist; names are relative to the folder of the job's file"))
        else:
            found = sorted(islice(glob.iglob(pattern, root_dir=folder, recursive=True), MOST_CLIPS + 1))  # noqa: PTH207 # Path.glob refuses "/..."
            if not found:
                raise ConfigError(positions.fault(place, f"nothing in {folder.absolute()} matches {shown(pattern)}"))
            if len(found) > MOST_CLIPS:
                raise ConfigError(positions.fault(place, f"{shown(pattern)} must match at most {MOST_CLIPS} clips"))
            for name in found:
                yield place, folder / name, False


def _without_results(requests: Iterator[tuple[Request, bool]]) -> list[tuple[Request, bool]]:
    """A pattern such as *.mp4 does not mean what the job itself has written beside its sources."""
    all_of_them = list(requests)
    by_result = {request.job.output.resolve(): request for request, _ in all_of_them}
    return [(each, literal) for each, literal in all_of_them if literal or by_result.get(each.job.source.resolve()) in (None, each)]


def _check_apart(requests: Sequence[tuple[Request, bool]]) -> None:
    taken: dict[Path, Request] = {}
    sources = {request.job.source.resolve(): request for request, _ in requests}
    for request, _ in requests:
        output = request.job.output
        if (other := taken.setdefault(output, request)) is not request:
            raise ConfigError(
                f"{request.where}: {request.job.source} would write {output}, as {other.job.source} does ({other.where});"
                " each clip needs a name of its own: {folder} in output.name stands for the source's folder"
            )
        if (other := sources.get(output.resolve())) is not None:
            raise ConfigError(f"{request.where}: {output} is the result of {request.job.source} and a source too ({other.where})")


def _job(treatment: Treatment, source: Path, output: Path, path: Path, *, overwrite: bool) -> ClipJob:
    camera, motion, deblur, encoding = treatment.camera, treatment.motion, treatment.deblur, treatment.encoding
    steering = {
        "motion": motion.model,
        "degree": motion.degree,
        "start": motion.start,
        "refinement": motion.refinement,
        "prior": deblur.prior,
        "frames": deblur.frames,
    }
    written = encoding.model_dump(include={"codec", "quality", "pixel_format"}, exclude_none=True)
    profile = camera.profile
    if profile is not None and (beside := _beside(path, profile)).is_file():
        profile = str(beside)
    return ClipJob(
        source=source,
        output=output,
        exposure=camera.exposure,
        shutter_angle=camera.shutter_angle,
        readout=camera.readout,
        row_time=camera.row_time,
        scanlines_total=camera.scanlines_total,
        direction=camera.direction,
        camera=profile,
        focal_px=camera.focal_px,
        transfer=camera.transfer,
        trajectory=None if motion.trajectory is None else _beside(path, motion.trajectory),
        method=deblur.method,
        block_rows=deblur.block_rows,
        gyro=GyroFile(path=None if motion.gyro is None else _beside(path, motion.gyro), offset=motion.gyro_offset, axes=motion.gyro_axes),
        steering={name: value for name, value in steering.items() if value is not None},
        encoding=written,
        path=motion.path,
        span=treatment.input.range,
        side_by_side=encoding.side_by_side,
        on_damage=treatment.input.on_damage,
        rate=treatment.input.rate,
        force=camera.force,
        overwrite=overwrite,
    )


def _beside(path: Path, name: str) -> Path:
    return path.parent / name
