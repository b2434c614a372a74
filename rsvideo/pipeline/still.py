"""One photograph, from file to file."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from rsvideo.config import motion, sidecar
from rsvideo.config.files import UnreadableError
from rsvideo.config.quantity import LONGEST, hand_held
from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Intrinsics
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.tone import Transfer
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.blind import Iterate, Settings, restore
from rsvideo.video import still
from rsvideo.video.still import Format, Still

SMALLEST = 32  # px a side; below, there is nothing to measure motion by
_WIDEST = 0.2  # focal length per longer side: a field of view of 136 degrees


@dataclass(frozen=True, kw_only=True)
class Job:
    """What is asked for; None leaves the answer to the file or to the method."""

    source: Path
    output: Path
    exposure: float | None  # seconds
    readout: float | None  # seconds; this or row_time
    row_time: float | None  # seconds
    direction: Direction
    focal_px: float | None
    transfer: Transfer | None
    trajectory: Path | None  # motion that is given
    settings: Settings
    overwrite: bool

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
    trajectory: Trajectory | None
    notes: tuple[str, ...]  # what the user should know before the work


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What is to be written, and what is to be said."""

    files: Mapping[Path, bytes]
    sidecar: sidecar.Sidecar
    notes: tuple[str, ...]


def prepare(job: Job) -> Task:
    """Read the photograph and settle timing and camera; raises ValueError, UnreadableError or FileExistsError."""
    _check_output(job)
    if (job.readout is None) == (job.row_time is None):
        both = "both were given" if job.readout is not None else "neither was; a phone's or DSLR's video often reads in 10ms to 30ms"
        raise ValueError(f"exactly one of --readout and --row-time must be given, {both}")
    photograph = still.read(job.source, job.transfer)
    rows, cols = photograph.pixels.shape[:2]
    if min(rows, cols) < SMALLEST:
        raise UnreadableError(
            f"{job.source} must be at least {SMALLEST} x {SMALLEST} px, it is {cols} x {rows};"
            " so small a picture has nothing to measure motion by"
        )
    timing, source = _timing(job, photograph)
    camera, notes = _camera(job, photograph)
    return Task(
        job=job,
        still=photograph,
        timing=timing,
        timing_source=source,
        camera=camera,
        trajectory=None if job.trajectory is None else motion.read(job.trajectory, timing, camera.intrinsics),
        notes=photograph.notes + notes,
    )


def carry_out(task: Task, observe: Callable[[Iterate], None]) -> Outcome:
    """Restore the photograph; nothing is written yet."""
    result = restore(
        Frame(pixels=task.still.pixels, clipped=task.still.clipped),
        task.timing,
        task.camera.intrinsics,
        task.job.settings,
        timing_source=task.timing_source,
        trajectory=task.trajectory,
        observe=observe,
    )
    kind = Format.of_output(task.job.output)
    if result.verdict is Verdict.RESTORED:
        if not np.isfinite(result.latent).all():
            raise ArithmeticError("the restored picture holds numbers that are not finite")
        data, notes = still.encode(task.still, result.latent.astype(np.float32), kind)
    else:
        data, notes = still.unchanged(task.still, kind)
    record = _record(task, result)
    return Outcome(files={task.job.output: data, task.job.record: record.encode()}, sidecar=record, notes=notes)


def _check_output(job: Job) -> None:
    Format.of_output(job.output)
    folder = job.output.parent
    if not folder.is_dir():
        raise ValueError(f"the folder {folder} of OUTPUT must exist; make it first, or is its name mistyped?")
    if job.output.resolve() == job.source.resolve():
        raise ValueError(f"OUTPUT must not be INPUT, both are {job.output}; the original is never replaced")
    if job.output.is_dir():
        raise ValueError(f"OUTPUT must be a file, {job.output} is a folder")
    for path in (job.output, job.record):
        if path.exists() and not job.overwrite:
            raise FileExistsError(f"{path} exists already; give --overwrite to replace it")


def _timing(job: Job, photograph: Still) -> tuple[ShutterTiming, str]:
    exposure = photograph.shot.exposure if job.exposure is None else job.exposure
    if exposure is None:
        raise ValueError(f"exposure must be given, {job.source} does not say it in EXIF; 1/50, 20ms and 0.02 are times")
    exposure = hand_held("exposure" if job.exposure is not None else "exposure (from EXIF)", exposure, zero=False)
    rows, cols = photograph.pixels.shape[:2]
    scanlines = rows if job.direction in (Direction.TOP_TO_BOTTOM, Direction.BOTTOM_TO_TOP) else cols
    if job.readout is not None:
        readout = hand_held("readout", job.readout, zero=True)
    else:
        readout = scanlines * (job.row_time or 0.0)
        if readout > LONGEST:
            raise ValueError(
                f"row-time must let {scanlines} rows be read in {LONGEST:g} s, got {job.row_time:g} s a row, which makes {readout:g} s;"
                " is it in milliseconds or microseconds?"
            )
    timing = ShutterTiming.from_readout(exposure=exposure, readout=readout, rows=scanlines, direction=job.direction)
    return timing, "explicit" if job.exposure is not None else "exposure from EXIF, readout explicit"


def _camera(job: Job, photograph: Still) -> tuple[sidecar.Camera, tuple[str, ...]]:
    rows, cols = photograph.pixels.shape[:2]
    longer = max(rows, cols)
    notes: tuple[str, ...] = ()
    if job.focal_px is not None:
        focal, source = job.focal_px, "explicit"
        if focal < _WIDEST * longer:
            raise ValueError(
                f"focal-px must be at least {_WIDEST * longer:g} px for a picture whose longer side is {longer} px, got {focal:g};"
                " is it in millimetres? pixels = millimetres * width of the picture in pixels / width of the sensor in millimetres"
            )
    elif (exif_focal := photograph.shot.focal_px(rows, cols)) is not None:
        focal, source = exif_focal, "EXIF"
        notes = (
            f"focal length {focal:.0f} px from EXIF's 35 mm equivalent of {photograph.shot.focal_35mm:g} mm, for an uncropped picture",
        )
    elif job.settings.motion == "rotation" or job.trajectory is not None:
        raise ValueError(
            f"focal-px must be given, {job.source} does not say a 35 mm equivalent in EXIF;"
            " it is about 0.7 times the longer side for most phones, and --motion shift does without"
        )
    else:
        focal, source = float(longer), "assumed"  # a shift does not depend on it
    return sidecar.Camera.of(Intrinsics.centred(focal=focal, rows=rows, cols=cols), source), notes


def _record(task: Task, result: FrameResult) -> sidecar.Sidecar:
    return sidecar.Sidecar(
        input=str(task.job.source),
        settings=sidecar.Settings(
            rsvideo=version("rsvideo"),
            camera=task.camera,
            direction=task.timing.direction,
            transfer=task.still.transfer,
            trajectory_from=None if task.job.trajectory is None else str(task.job.trajectory),
            restoration=asdict(task.job.settings),
        ),
        frames=[
            sidecar.FrameRecord(
                index=result.frame.index,
                time_s=result.frame.time,
                timing=sidecar.Timing(exposure_s=result.timing.exposure, row_time_s=result.timing.row_time, source=result.timing_source),
                trajectory=sidecar.Sampled.of(result.trajectory),
                verdict=result.verdict,
                seconds=result.seconds,
            )
        ],
    )
