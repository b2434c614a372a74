"""What is asked of one clip, and every question that leaves open, answered before the work."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path
from typing import Any, Literal

import numpy as np

from rsvideo.config import sidecar
from rsvideo.config.files import UnreadableError
from rsvideo.config.method import GyroFile, Method, check_gyro
from rsvideo.config.quantity import frame_rate
from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera, Intrinsics
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline import clip_facts, gyro_alignment, output
from rsvideo.pipeline.gyro_alignment import Gyro
from rsvideo.pipeline.methods import Treatment
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import timing
from rsvideo.video import colour, decode, vidstab
from rsvideo.video.output_format import Encoding, chosen
from rsvideo.video.stream import Picture, Stream

SMALLEST = 32  # px a side; below, there is nothing to measure motion by
_SECONDS_A_PIXEL = 2e-5  # of work, roughly, on two cores


@dataclass(frozen=True, kw_only=True)
class ClipJob:
    """What is asked for one clip; None leaves the answer to the file or to the method."""

    source: Path
    output: Path
    exposure: float | None = None  # seconds; this or shutter_angle
    shutter_angle: float | None = None  # degrees
    readout: float | None = None  # seconds; this, row_time or scanlines_total
    row_time: float | None = None  # seconds
    scanlines_total: int | None = None
    direction: Direction | None = None
    camera: str | None = None  # a profile's name or file, or a camera of the public table
    focal_px: float | None = None
    transfer: str | None = None
    trajectory: Path | None = None  # motion that is given
    method: Method = Method.RSVIDEO
    block_rows: int | None = None  # of the method stitch
    gyro: GyroFile = field(default_factory=GyroFile)  # of the methods that follow one
    steering: Mapping[str, Any] = field(default_factory=dict)  # the core's settings under their names; those left out have their defaults
    encoding: Mapping[str, Any] = field(default_factory=dict)  # codec, quality, pixel_format
    path: Literal["keep", "smooth"] = "keep"  # of the camera, in what is written
    span: tuple[float, float] | None = None  # seconds, the part that is restored
    side_by_side: bool = False
    on_damage: Literal["fail", "passthrough", "skip"] = "fail"
    rate: str | None = None  # frames a second of a sequence of pictures
    force: bool = False  # take a timing that cannot be, too
    overwrite: bool = False

    @property
    def record(self) -> Path:
        """Where the sidecar goes."""
        return self.output.with_suffix(".rsvideo.json")

    @property
    def log(self) -> Path:
        """Where the motion goes as a gyroscope's log."""
        return self.output.with_suffix(".gcsv")

    @property
    def pictures_a_second(self) -> Fraction | None:
        """Of a sequence, where it is given."""
        return None if self.rate is None else frame_rate(self.rate)


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
    def treatment(self) -> Treatment:
        """What is done to the frames."""
        return Treatment(
            method=self.job.method,
            settings=self.settings,
            block_rows=self.job.block_rows,
            gyro=self.gyro,
            camera=Camera(timing=self.timing, intrinsics=self.camera.intrinsics),
            timing_source=self.timing_source,
        )

    def pictures(self, first: int | None = None, last: int | None = None) -> Iterator[Picture]:
        """Those from first to last - 1, or all that are restored."""
        first, last = self.first if first is None else first, self.last if last is None else last
        return decode.pictures(self.stream, first, last, on_damage=self.job.on_damage)

    def frame(self, picture: Picture) -> Frame:
        """A picture in linear light."""
        return _frame(self.stream, picture)

    def estimate(self) -> tuple[float, int]:
        """Seconds of work and bytes of disk while it lasts, roughly."""
        pixels = self.frames * self.rows * self.cols
        return 0.0 if self.job.method is Method.NONE else pixels * _SECONDS_A_PIXEL, self.frames * self.picture_bytes

    @property
    def picture_bytes(self) -> int:
        """Of a picture as decoded."""
        c = self.stream.colour
        chroma = 0 if c.subsampling == "4:0:0" else 2 / (1 << sum(c.chroma_shift))
        return round(self.rows * self.cols * (1 + chroma) * (4 if c.floating else 1 if c.depth == 8 else 2))


def prepare(job: ClipJob) -> ClipTask:
    """Probe the clip and settle timing, camera and encoding; raises ValueError, UnreadableError or FileExistsError."""
    output.check(job.source, (job.output, job.record, job.log), overwrite=job.overwrite)
    clip = clip_facts.gather(job.source, camera=job.camera, rate=job.pictures_a_second, on_damage=job.on_damage)
    stream = clip.stream
    if min(stream.rows, stream.cols) < SMALLEST:
        raise UnreadableError(f"{job.source} must be at least {SMALLEST} x {SMALLEST} px, it is {stream.cols} x {stream.rows}")
    if job.transfer:
        stream = replace(stream, colour=replace(stream.colour, transfer=Transfer(job.transfer)))
    elif clip.profile and clip.profile.tone and not stream.colour.floating:
        stream = replace(stream, colour=replace(stream.colour, transfer=clip.profile.tone, saturation=clip.profile.saturation))
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
    if gyro:  # which need not be looked for again
        job = replace(job, gyro=replace(job.gyro, offset=gyro.offset, axes=gyro.axes))
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


def _camera(job: ClipJob, clip: clip_facts.KnownClip) -> sidecar.Camera:
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
    found = gyro_alignment.read(job.gyro, job.source, timing)
    pictures = decode.pictures(stream, first, min(last, first + gyro_alignment.LOOKED_AT), on_damage=job.on_damage)
    placed = gyro_alignment.placed(job.gyro, found, (_frame(stream, p) for p in pictures), timing, camera, settings)
    placed.check_cover((stream.times[first:last] - stream.times[0]) * float(stream.time_base), timing)
    return placed


def _frame(stream: Stream, picture: Picture) -> Frame:
    pixels, clipped = colour.light(picture, stream.colour)
    return Frame(pixels=pixels, clipped=clipped, time=picture.time, index=picture.index)
