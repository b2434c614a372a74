"""One photograph, from file to file."""

import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from importlib.metadata import version

import numpy as np

from rsvideo.config import sidecar
from rsvideo.config.files import write_whole
from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.camera import Camera
from rsvideo.pipeline import gyro_alignment, methods, output
from rsvideo.pipeline.job import Task
from rsvideo.pipeline.methods import Treatment
from rsvideo.restoration.settings import Settings
from rsvideo.shooting import given_motion
from rsvideo.stills import still
from rsvideo.stills.still import Format


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What became of a photograph."""

    notes: tuple[str, ...]
    verdict: Verdict
    seconds: float

    @property
    def told(self) -> str:
        """In words."""
        return f"{self.verdict}, {self.seconds:.1f} s"


def carry_out(task: Task, observe: Callable[[str, float], None]) -> Outcome:
    """Restore the photograph, with a motion that is given or without, and write it; `observe` is told the stage and the fraction done."""
    job, settings = task.job, Settings(**task.job.steering)
    trajectory = None if job.trajectory is None else given_motion.read(job.trajectory, task.timing, task.camera.intrinsics)
    follows = job.method.recorded and trajectory is None
    gyro = gyro_alignment.of_photograph(job.gyro, job.source, task.timing) if follows else None
    asked = Treatment(
        method=task.job.method,
        settings=settings,
        block_rows=task.job.block_rows,
        gyro=gyro,
        camera=Camera(timing=task.timing, intrinsics=task.camera.intrinsics),
        timing_source=task.timing_source,
    )
    result = methods.photograph(
        asked, Frame(pixels=task.still.pixels, clipped=task.still.clipped), trajectory, lambda at: observe(at.stage, at.fraction)
    )
    kind = Format.of_output(task.job.output)
    if result.verdict is Verdict.RESTORED:
        if not np.isfinite(result.latent).all():
            raise ArithmeticError("the restored picture holds numbers that are not finite")
        data, notes = still.encode(task.still, result.latent.astype(np.float32), kind)
    else:
        data, notes = still.unchanged(task.still, kind)
    write_whole({task.job.output: data, task.job.record: _record(task, settings, result).encode()})
    return Outcome(notes=notes, verdict=result.verdict, seconds=result.seconds)


def _record(task: Task, settings: Settings, result: FrameResult) -> sidecar.Sidecar:
    return sidecar.Sidecar(
        input=str(task.job.source),
        settings=sidecar.Settings(
            rsvideo=version("rsvideo"),
            camera=task.camera,
            direction=task.timing.direction,
            transfer=task.still.transfer.value,
            trajectory_from=None if task.job.trajectory is None else str(task.job.trajectory),
            restoration=json.loads(json.dumps(asdict(settings))),
        ),
        frames=[output.frame_record(result)],
    )
