"""What is asked of one photograph, and every question that leaves open, answered before the work."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from rsvideo.config import sidecar
from rsvideo.config.files import UnreadableError
from rsvideo.config.method import GyroFile, Method, check_gyro
from rsvideo.config.quantity import HAND_HELD_LIMIT, hand_held
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.tone import Transfer
from rsvideo.pipeline import output
from rsvideo.shooting import profiles
from rsvideo.stills import still
from rsvideo.stills.still import Format, Still

SMALLEST = 32  # px a side; below, there is nothing to measure motion by
_WIDEST = 0.2  # focal length per longer side: a field of view of 136 degrees


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is asked for; None leaves the answer to the file or to the method."""

    source: Path
    output: Path
    exposure: float | None = None  # seconds
    readout: float | None = None  # seconds; this or row_time
    row_time: float | None = None  # seconds
    direction: Direction | None = None
    camera: str | None = None  # a profile's name or file
    focal_px: float | None = None
    transfer: Transfer | None = None
    trajectory: Path | None = None  # motion that is given
    method: Method = Method.RSVIDEO
    block_rows: int | None = None  # of the method stitch
    gyro: GyroFile = field(default_factory=GyroFile)  # of the methods that follow one
    steering: Mapping[str, Any] = field(default_factory=dict)  # the core's settings under their names; those left out have their defaults
    overwrite: bool = False

    @property
    def record(self) -> Path:
        """Where the sidecar goes."""
        return self.output.with_suffix(".rsvideo.json")


@dataclass(frozen=True, kw_only=True, eq=False)
class Task:
    """A job whose every question is answered."""

    job: Job
    still: Still
    timing: ShutterTiming
    timing_source: str
    camera: sidecar.Camera
    notes: tuple[str, ...]  # what the user should know before the work


def prepare(job: Job) -> Task:
    """Read the photograph and settle timing and camera; raises ValueError, UnreadableError or FileExistsError."""
    _check_output(job)
    if job.method.needs_clip:
        raise ValueError(f"method {job.method} concerns clips, it sees the motion between frames; {job.source} is taken for a photograph")
    check_gyro(job.gyro, job.method)
    if job.method.recorded and job.trajectory is None and job.gyro.path is None:
        raise ValueError(f"the method {job.method} needs a gyroscope's log of a photograph; give --gyro")
    known = None if job.camera is None else profiles.find(job.camera)
    timed = known is not None and known.timing is not None
    if (job.readout is not None and job.row_time is not None) or (job.readout is None and job.row_time is None and not timed):
        both = "both were given" if job.readout is not None else "neither was; a phone's or DSLR's video often reads in 10ms to 30ms"
        raise ValueError(f"exactly one of --readout and --row-time must be given, {both}")
    tone, clip = (job.transfer, None) if job.transfer or not known else profiles.response(known)
    photograph = still.read(job.source, tone, clip)
    rows, cols = photograph.pixels.shape[:2]
    if min(rows, cols) < SMALLEST:
        raise UnreadableError(
            f"{job.source} must be at least {SMALLEST} x {SMALLEST} px, it is {cols} x {rows};"
            " so small a picture has nothing to measure motion by"
        )
    said, told = profiles.for_clip(known, rows, cols, None) if known else (None, ())
    timing, source = _timing(job, photograph, said)
    camera, notes = _camera(job, photograph, said)
    return Task(
        job=job,
        still=photograph,
        timing=timing,
        timing_source=source,
        camera=camera,
        notes=photograph.notes + told + notes,
    )


def _check_output(job: Job) -> None:
    Format.of_output(job.output)
    if job.output.is_dir():
        raise ValueError(f"OUTPUT must be a file, {job.output} is a folder")
    output.check(job.source, (job.output, job.record), overwrite=job.overwrite)


def _timing(job: Job, photograph: Still, said: profiles.Facts | None) -> tuple[ShutterTiming, str]:
    exposure = photograph.capture.exposure if job.exposure is None else job.exposure
    if exposure is None:
        raise ValueError(f"exposure must be given, {job.source} does not say it in EXIF; 1/50, 20ms and 0.02 are times")
    exposure = hand_held("exposure" if job.exposure is not None else "exposure (from EXIF)", exposure, zero=False)
    rows, cols = photograph.pixels.shape[:2]
    direction = job.direction or (said.direction.value if said and said.direction else Direction.TOP_TO_BOTTOM)
    scanlines = rows if direction in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP) else cols
    whence = "explicit"
    if job.readout is not None:
        readout = hand_held("readout", job.readout, zero=True)
    elif job.row_time is None and said and said.readout:
        readout, whence = hand_held("readout (from the profile)", said.readout.value, zero=True), f"by {said.readout.source}"
    else:
        readout = scanlines * (job.row_time or 0.0)
        if readout > HAND_HELD_LIMIT:
            raise ValueError(
                f"row-time must let {scanlines} rows be read in {HAND_HELD_LIMIT:g} s, got {job.row_time:g} s a row,"
                f" which makes {readout:g} s;"
                " is it in milliseconds or microseconds?"
            )
    timing = ShutterTiming.from_readout(exposure=exposure, readout=readout, rows=scanlines, direction=direction)
    opened = "explicit" if job.exposure is not None else "from EXIF"
    return timing, opened if opened == whence else f"exposure {opened}, readout {whence}"


def _camera(job: Job, photograph: Still, said: profiles.Facts | None) -> tuple[sidecar.Camera, tuple[str, ...]]:
    rows, cols = photograph.pixels.shape[:2]
    longer = max(rows, cols)
    notes: tuple[str, ...] = ()
    if job.focal_px is None and said and said.intrinsics:
        return sidecar.Camera.of(said.intrinsics, said.profile), notes
    if job.focal_px is not None:
        focal, source = job.focal_px, "explicit"
        if focal < _WIDEST * longer:
            raise ValueError(
                f"focal-px must be at least {_WIDEST * longer:g} px for a picture whose longer side is {longer} px, got {focal:g};"
                " is it in millimetres? pixels = millimetres * width of the picture in pixels / width of the sensor in millimetres"
            )
    elif (exif_focal := photograph.capture.focal_px(rows, cols)) is not None:
        focal, source = exif_focal, "EXIF"
        notes = (
            f"focal length {focal:.0f} px from EXIF's 35 mm equivalent of {photograph.capture.focal_35mm:g} mm, for an uncropped picture",
        )
    elif job.method.needs_lens and (job.steering.get("motion") != "shift" or job.trajectory is not None):
        raise ValueError(
            f"focal-px must be given, {job.source} does not say a 35 mm equivalent in EXIF;"
            " it is about 0.7 times the longer side for most phones, and --motion shift does without"
        )
    else:
        focal, source = float(longer), "assumed"  # a shift does not depend on it
    return sidecar.Camera.of(Intrinsics.centred(focal=focal, rows=rows, cols=cols), source), notes
