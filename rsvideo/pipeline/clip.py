"""One clip, from file to file: every question settled, cut into chunks, each restored by itself, and all of them encoded.

A chunk is restored from its own frames, `warm_up` frames before and two behind them, so that the result does not depend on
who restores which chunk.
"""

import hashlib
import json
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from fractions import Fraction
from importlib.metadata import version
from itertools import chain, groupby, pairwise
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel

from rsvideo.config import gcsv, sidecar
from rsvideo.config import motion as motion_file
from rsvideo.config.files import UnreadableError, write_whole
from rsvideo.config.method import GyroFile, Method, check_gyro
from rsvideo.config.sidecar import FrameRecord
from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline import known, log, methods, output, recorded
from rsvideo.pipeline.methods import Treatment
from rsvideo.pipeline.recorded import Gyro
from rsvideo.restoration import steady, timing
from rsvideo.restoration.blind import Settings
from rsvideo.restoration.clip import Movement
from rsvideo.video import colour, cuts, decode, planes, vidstab
from rsvideo.video.clip import Picture, Stream
from rsvideo.video.encode import Encoding, Writer, chosen

SMALLEST = 32  # px a side; below, there is nothing to measure motion by
LONGEST = 32  # frames of a chunk, and fewer of large pictures:
MOST_BYTES = 256 << 20  # of a chunk's pictures as decoded
WARM_UP, AHEAD = 4, 2  # frames before and behind a chunk that its motion is found with
_SECONDS_A_PIXEL = 2e-5  # of work, roughly, on two cores


@dataclass(frozen=True, kw_only=True)
class ClipJob:
    """What is asked for one clip; None leaves the answer to the file or to the method."""

    source: Path
    output: Path
    exposure: float | None  # seconds; this or shutter_angle
    shutter_angle: float | None  # degrees
    readout: float | None  # seconds; this, row_time or scanlines_total
    row_time: float | None  # seconds
    scanlines_total: int | None
    direction: Direction | None
    camera: str | None  # a profile's name or file, or a camera of the public table
    focal_px: float | None
    transfer: str | None
    trajectory: Path | None  # motion that is given
    method: Method
    block_rows: int | None  # of the method stitch
    gyro: GyroFile  # of the methods that follow one
    steering: Mapping[str, Any]  # the core's settings under their names; those left out have their defaults
    encoding: Mapping[str, Any]  # codec, quality, pixel_format
    path: Literal["keep", "smooth"]  # of the camera, in what is written
    span: tuple[float, float] | None  # seconds, the part that is restored
    side_by_side: bool
    on_damage: Literal["fail", "passthrough", "skip"]
    rate: str | None  # frames a second of a sequence of pictures
    force: bool  # take a timing that cannot be, too
    overwrite: bool


@dataclass(frozen=True, kw_only=True, eq=False)
class ClipTask:
    """A job whose every question is answered."""

    job: ClipJob
    stream: Stream
    resolved: timing.Resolved
    camera: sidecar.Camera
    settings: Settings
    gyro: Gyro | None
    encoding: Encoding
    first: int  # frames [first, last) are restored
    last: int
    notes: tuple[str, ...]  # what the user should know before the work

    @property
    def timing(self) -> ShutterTiming:
        """Of every frame."""
        return self.resolved.timing

    @property
    def timing_source(self) -> str:
        """Who said so."""
        return self.resolved.source

    @property
    def frames(self) -> int:
        """How many are restored."""
        return self.last - self.first

    @property
    def rows(self) -> int:
        """As stored."""
        return self.stream.rows

    @property
    def cols(self) -> int:
        """As stored."""
        return self.stream.cols

    @property
    def record(self) -> Path:
        """Where the sidecar goes."""
        return self.job.output.with_suffix(".rsvideo.json")

    @property
    def log(self) -> Path:
        """Where the motion goes as a gyroscope's log."""
        return self.job.output.with_suffix(".gcsv")

    @property
    def treatment(self) -> Treatment:
        """What is done to the frames."""
        return Treatment(
            method=self.job.method,
            settings=self.settings,
            block_rows=self.job.block_rows,
            gyro=self.gyro,
            timing=self.timing,
            timing_source=self.timing_source,
            intrinsics=self.camera.intrinsics,
        )

    def estimate(self) -> tuple[float, int]:
        """Seconds of work and bytes of disk while it lasts, roughly."""
        pixels = self.frames * self.rows * self.cols
        return 0.0 if self.job.method is Method.NONE else pixels * _SECONDS_A_PIXEL, self.frames * _picture_bytes(self.stream)


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """Frames first to last, both included, restored with `warm_up` frames before them in view."""

    index: int
    first: int
    last: int
    warm_up: int


class ChunkRecord(BaseModel):
    """A chunk that was restored: the files that hold its frames, and a line on what became of each."""

    pictures: str
    frames: str
    sha256: dict[str, str]  # of both, by their names


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a clip."""

    notes: tuple[str, ...]
    restored: int
    left: int
    failed: int  # frames that could not be decoded as they were meant
    seconds: float


def prepare(job: ClipJob) -> ClipTask:
    """Probe the clip and settle timing, camera and encoding; raises ValueError, UnreadableError or FileExistsError."""
    _check_output(job)
    clip = known.gather(job.source, camera=job.camera, rate=None if job.rate is None else _rate(job.rate), on_damage=job.on_damage)
    stream = clip.stream
    if min(stream.rows, stream.cols) < SMALLEST:
        raise UnreadableError(f"{job.source} must be at least {SMALLEST} x {SMALLEST} px, it is {stream.cols} x {stream.rows}")
    if job.transfer:
        stream = replace(stream, colour=replace(stream.colour, transfer=Transfer(job.transfer)))
    elif clip.profile and clip.profile.tone and not stream.colour.floating:
        stream = replace(stream, colour=replace(stream.colour, transfer=clip.profile.tone, clip=clip.profile.clip))
    first, last = span(job, stream)
    notes = clip.notes
    if job.method is Method.NONE:
        asked = timing.Asked(exposure=1e-3, readout=0.0)  # which nobody looks at
    else:
        asked = timing.Asked(
            exposure=job.exposure,
            shutter_angle=job.shutter_angle,
            readout=job.readout,
            row_time=job.row_time,
            scanlines_total=job.scanlines_total,
            direction=job.direction,
            force=job.force,
        )
    if job.method.steadied and not vidstab.available():
        raise ValueError(f"the method {job.method} needs imageio-ffmpeg; pip install 'rsvideo[vidstab]' brings it")
    resolved = timing.resolve(asked, clip.shutter)
    camera = _camera(job, clip)
    settings = Settings(**job.steering)
    gyro = _gyro(job, stream, first, last, resolved.timing, camera.intrinsics, settings)
    encoding = Encoding(**job.encoding)
    _, _, told = chosen(job.output, stream, encoding)
    return ClipTask(
        job=job,
        stream=stream,
        resolved=resolved,
        camera=camera,
        settings=settings,
        gyro=gyro,
        encoding=encoding,
        first=first,
        last=last,
        notes=(*notes, *resolved.notes, *((gyro.note,) if gyro else ()), *told),
    )


def _check_output(job: ClipJob) -> None:
    output.check(
        job.source, (job.output, job.output.with_suffix(".rsvideo.json"), job.output.with_suffix(".gcsv")), overwrite=job.overwrite
    )


def _rate(words: str) -> Fraction:
    try:
        rate = Fraction(words)
    except (ValueError, ZeroDivisionError):
        rate = Fraction(0)
    if not Fraction(1, 100) <= rate <= 100_000:
        raise ValueError(f"rate must be frames a second, such as 24 or 30000/1001, got {words!r}")
    return rate


def span(job: ClipJob, stream: Stream) -> tuple[int, int]:
    """Frames [first, last) that are shown within the span."""
    if job.span is None:
        return 0, stream.frames
    seconds, tick = (stream.times - stream.times[0]) * float(stream.time_base), 0.6 * float(stream.time_base)  # times are rounded to it
    first, last = (int(np.searchsorted(seconds, t - tick)) for t in job.span)
    if first >= last:
        raise ValueError(
            f"range must hold at least one frame of the clip's {stream.duration_s:.3f} s, got {job.span[0]:g} s to {job.span[1]:g} s;"
            " is it in minutes:seconds?"
        )
    return first, last


def _camera(job: ClipJob, clip: known.KnownClip) -> sidecar.Camera:
    rows, cols = clip.stream.rows, clip.stream.cols
    if job.focal_px is None and clip.profile and clip.profile.intrinsics:
        return sidecar.Camera.of(clip.profile.intrinsics, clip.profile.profile)
    if job.focal_px is not None:
        focal, source = job.focal_px, "explicit"
    elif clip.focal is not None:
        focal, source = clip.focal.value, clip.focal.source
    elif not job.method.needs_lens or (job.steering.get("motion") == "shift" and job.trajectory is None):
        focal, source = float(max(rows, cols)), "assumed"
    else:
        raise ValueError(
            f"focal-px must be given, {job.source} does not say its focal length; it is about 0.7 to 0.9 times the longer side"
            " for most phones, focal length / sensor's width * columns for cameras; --motion shift does without"
        )
    return sidecar.Camera.of(Intrinsics.centred(focal=focal, rows=rows, cols=cols), source)


def _gyro(
    job: ClipJob, stream: Stream, first: int, last: int, timing: ShutterTiming, camera: Intrinsics, settings: Settings
) -> Gyro | None:
    check_gyro(job.gyro, job.method)
    if not job.method.recorded or job.trajectory is not None:
        return None
    found = recorded.read(job.gyro, job.source, timing)
    pictures = decode.pictures(stream, first, min(last, first + recorded.LOOKED_AT), on_damage=job.on_damage)
    return recorded.placed(job.gyro, found, (_frame(stream, p) for p in pictures), timing, camera, settings)


def _picture_bytes(stream: Stream) -> int:
    c = stream.colour
    chroma = 0 if c.subsampling == "4:0:0" else 2 / (1 << sum(c.chroma_shift))
    return round(stream.rows * stream.cols * (1 + chroma) * (4 if c.floating else 1 if c.depth == 8 else 2))


def chunks(task: ClipTask) -> list[Chunk]:
    """The clip cut at its changes of scene, and long scenes into equal parts; depends on the clip alone."""
    longest = max(8, min(LONGEST, MOST_BYTES // _picture_bytes(task.stream)))
    scenes = [task.first, *(() if task.job.method is Method.NONE else cuts.cuts(_pictures(task), task.stream.colour)), task.last]
    out: list[Chunk] = []
    for begin, end in pairwise(scenes):
        edges = np.linspace(begin, end, -(-(end - begin) // longest) + 1).round().astype(int).tolist()
        out += [Chunk(index=len(out) + n, first=a, last=b - 1, warm_up=min(WARM_UP, a - begin)) for n, (a, b) in enumerate(pairwise(edges))]
    return out


def _pictures(task: ClipTask, first: int | None = None, last: int | None = None) -> Iterator[Picture]:
    return decode.pictures(
        task.stream,
        task.first if first is None else first,
        task.last if last is None else last,
        on_damage=task.job.on_damage,
    )


def work(task: ClipTask, chunk: Chunk, folder: Path, observe: Callable[[int, str, float], None]) -> ChunkRecord:
    """Restore a chunk into a file of `folder`."""
    begin, end = chunk.first - chunk.warm_up, min(chunk.last + 1 + AHEAD, task.last)
    pictures = list(_pictures(task, begin, end))
    if task.job.method.steadied:
        pictures = _steadied(task, pictures, folder)
    moving = _movement(task, pictures, lambda index: observe(index, "motion", 0.0))
    mine = [k for k, p in enumerate(pictures) if chunk.first <= p.index <= chunk.last]
    wanted, moving = [pictures[k] for k in mine], moving.part(mine[0], mine[-1] + 1) if mine else moving.part(0, 0)
    record = ChunkRecord(pictures=f"{chunk.index:06}.zip", frames=f"{chunk.index:06}.jsonl", sha256={})
    lines: list[bytes] = []

    def shown() -> Iterator[Picture]:
        for k, (picture, result) in enumerate(zip(wanted, _results(task, wanted, moving, observe), strict=True)):
            lines.append(output.frame_record(result, moving.steps[k] if moving.tied[k] else None).encode() + b"\n")
            restored = result.verdict is Verdict.RESTORED
            yield colour.codes(result.latent, picture, task.stream.colour) if restored else picture

    record.sha256[record.pictures] = planes.write(folder / record.pictures, shown())
    write_whole({folder / record.frames: b"".join(lines)})
    record.sha256[record.frames] = hashlib.sha256(b"".join(lines)).hexdigest()
    return record


def told(records: Iterable[ChunkRecord], folder: Path) -> Iterator[FrameRecord]:
    """What became of the frames, one after the other; raises UnreadableError."""
    for record in records:
        path = folder / record.frames
        try:
            with path.open("rb") as file:
                for line in file:
                    yield FrameRecord.model_validate_json(line)
        except (OSError, ValueError) as error:
            raise UnreadableError(f"{path} is damaged: {error}") from error


def _steadied(task: ClipTask, pictures: list[Picture], folder: Path) -> list[Picture]:
    """vid.stab's frames in place of the clip's; whoever comes first makes them, for all chunks."""
    whole = folder / "vidstab.mkv"
    if not whole.exists():
        with tempfile.TemporaryDirectory(dir=folder) as name:
            vidstab.stabilised(task.job.source, Path(name) / whole.name, Path(name)).replace(whole)
    stream = decode.probe(whole)
    steady = decode.pictures(stream, pictures[0].index, pictures[-1].index + 1)
    laid = (colour.relaid(picture, stream.colour, replace(task.stream.colour, transfer=stream.colour.transfer)) for picture in steady)
    return [replace(before, planes=after.planes) for before, after in zip(pictures, laid, strict=True)]


def _results(
    task: ClipTask, pictures: list[Picture], moving: Movement, observe: Callable[[int, str, float], None]
) -> Iterator[FrameResult]:
    """What becomes of each picture, in order."""
    for damaged, some in groupby(range(len(pictures)), key=lambda k: pictures[k].damaged):
        indices = list(some)
        frames = (_frame(task.stream, pictures[k]) for k in indices)
        if damaged or task.job.method is Method.NONE:
            verdict = Verdict.DAMAGED if damaged else Verdict.UNTOUCHED
            for frame in frames:
                yield methods.untouched(task.treatment, frame, verdict)
                observe(frame.index, "passed on", 1.0)
        else:
            part = moving.part(indices[0], indices[-1] + 1)
            yield from methods.run(task.treatment, frames, part, lambda index, fraction: observe(index, "restoring", fraction))


def _frame(stream: Stream, picture: Picture) -> Frame:
    pixels, clipped = colour.light(picture, stream.colour)
    return Frame(pixels=pixels, clipped=clipped, time=picture.time, index=picture.index)


def _movement(task: ClipTask, pictures: Sequence[Picture], observe: Callable[[int], None]) -> Movement:
    """The motion within each frame, and from each to the next."""
    camera = task.camera.intrinsics
    if task.job.trajectory is not None:
        ways, steps = motion_file.of_clip(task.job.trajectory, task.timing, camera, [(p.index, p.time) for p in pictures])
        tied = [step is not None for step in steps]
        return Movement(within=[*ways], steps=np.array([step or [0.0] * 3 for step in steps]), tied=tied)
    begins = np.array([p.time for p in pictures])
    return methods.movement(task.treatment, (_frame(task.stream, p) for p in pictures), begins, observe)


def finish(task: ClipTask, records: list[ChunkRecord], folder: Path) -> Outcome:
    """Encode the restored frames as the original was; then the sidecar and the gyroscope's log."""
    stream, camera = task.stream, task.camera.intrinsics
    kept, steps, verdicts, seconds = _gist(told(records, folder))
    pictures = chain.from_iterable(
        planes.read(folder / record.pictures, stream, (frame.index for frame in told([record], folder))) for record in records
    )
    enlargement = 1.0
    if task.job.path == "smooth":
        turns, enlargement = steady.corrections(steps, float(stream.rate), camera)
        pictures = (_turned(task, p, turn, enlargement) for p, turn in zip(pictures, turns, strict=True))
    if task.job.side_by_side:
        even = stream.cols - stream.cols % 2  # so that chroma samples stay with their pixels
        pictures = (_beside(before, after, even) for before, after in zip(_pictures(task), pictures, strict=True))
        stream = replace(stream, cols=even + stream.cols)
    last = task.last
    if len(kept) < task.frames:  # damaged ones were left out
        stream = replace(stream, times=np.concatenate([stream.times[: task.first], stream.times[kept], stream.times[last:]]))
        last = task.first + len(kept)
    with Writer(task.job.output, stream, task.encoding, first=task.first, last=last) as writer:
        for picture in pictures:
            writer.write(picture)
    notes = writer.notes
    files = {task.record: sidecar.encoded(str(task.job.source), _settings(task), told(records, folder))}
    parts = log.parts(told(records, folder), float(stream.rate), task.timing, camera)
    if task.job.method is not Method.NONE and (first := next(parts, None)):
        files[task.log] = gcsv.encoded(chain([first], parts), timing=task.timing, video=task.job.output.name, model="rsvideo")
    write_whole(files)
    if task.job.path == "smooth":
        notes += (f"smoothed: the picture is enlarged by {100 * (enlargement - 1):.1f} % to hide its moving borders",)
    return Outcome(
        notes=notes,
        restored=verdicts[Verdict.RESTORED],
        left=verdicts.total() - verdicts[Verdict.RESTORED] - verdicts[Verdict.DAMAGED],
        failed=verdicts[Verdict.DAMAGED],
        seconds=seconds,
    )


def _gist(frames: Iterable[FrameRecord]) -> tuple[list[int], list[list[float] | None], Counter[str], float]:
    """Of all frames: their indices, the steps from each to the next, how many met which verdict, and the seconds of work."""
    kept, steps, verdicts, seconds = [], [], Counter[str](), 0.0
    for frame in frames:
        kept.append(frame.index)
        steps.append(frame.to_next)
        verdicts[frame.verdict] += 1
        seconds += frame.seconds
    return kept, steps, verdicts, seconds


def carry_out(task: ClipTask, observe: Callable[[str, float], None]) -> Outcome:
    """The whole clip in this process, chunk after chunk; `observe` is told the stage, and how much of the whole is done."""
    with tempfile.TemporaryDirectory(prefix=".rsvideo-", dir=task.job.output.parent) as name:
        folder, done, records = Path(name), 0, []
        observe("looking for cuts", 0.0)
        for chunk in chunks(task):

            def heard(index: int, stage: str, fraction: float, chunk=chunk, done=done) -> None:
                observe(f"frame {index}: {stage}", (done + max(0.0, index - chunk.first + fraction)) / task.frames)

            records.append(work(task, chunk, folder, heard))
            done += chunk.last - chunk.first + 1
        observe("encoding", 1.0)
        return finish(task, records, folder)


def _turned(task: ClipTask, picture: Picture, turn: np.ndarray, enlargement: float) -> Picture:
    pixels = colour.light(picture, task.stream.colour)[0]
    return colour.codes(steady.shown(pixels, turn, enlargement, task.camera.intrinsics), picture, task.stream.colour)


def _beside(before: Picture, after: Picture, cols: int) -> Picture:
    """`cols` columns of the source, then the result."""
    width = after.planes[0].shape[1]
    left = [plane[:, : cols // round(width / plane.shape[1])] for plane in before.planes]
    return replace(after, planes=tuple(np.hstack(pair) for pair in zip(left, after.planes, strict=True)))


def _settings(task: ClipTask) -> sidecar.Settings:
    return sidecar.Settings(
        rsvideo=version("rsvideo"),
        camera=task.camera,
        direction=task.timing.direction,
        transfer=task.stream.colour.transfer.value,
        trajectory_from=None if task.job.trajectory is None else str(task.job.trajectory),
        restoration=json.loads(json.dumps(asdict(task.settings))),
        input_sha256=_sha256(task.stream),
        encoding=json.loads(json.dumps(asdict(task.encoding))),
    )


def _sha256(stream: Stream) -> str:
    """Of the file, or of a sequence's files one after the other."""
    digest = hashlib.sha256()
    for path in stream.files or (stream.path,):
        with path.open("rb") as file:
            while block := file.read(1 << 20):
                digest.update(block)
    return digest.hexdigest()
