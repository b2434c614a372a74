"""One photograph, from file to file."""

import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import version
from pathlib import Path

import numpy as np

from rsvideo.config import sidecar
from rsvideo.frame import Frame, FrameResult, Verdict
from rsvideo.physics.trajectory import Trajectory
from rsvideo.pipeline import methods, output, recorded
from rsvideo.pipeline.job import Task
from rsvideo.pipeline.methods import Treatment
from rsvideo.restoration.blind import Iterate, Settings
from rsvideo.video import still
from rsvideo.video.still import Format


@dataclass(frozen=True, kw_only=True, eq=False)
class Outcome:
    """What is to be written, and what is to be said."""

    files: Mapping[Path, bytes]
    sidecar: sidecar.Sidecar
    notes: tuple[str, ...]


def carry_out(task: Task, settings: Settings, trajectory: Trajectory | None, observe: Callable[[Iterate], None]) -> Outcome:
    """Restore the photograph, with a motion that is given or without; nothing is written yet."""
    job = task.job
    follows = job.method.recorded and trajectory is None
    gyro = recorded.of_photograph(job.gyro, job.source, task.timing) if follows else None
    asked = Treatment(
        method=task.job.method,
        settings=settings,
        block_rows=task.job.block_rows,
        gyro=gyro,
        timing=task.timing,
        timing_source=task.timing_source,
        intrinsics=task.camera.intrinsics,
    )
    result = methods.photograph(asked, Frame(pixels=task.still.pixels, clipped=task.still.clipped), trajectory, observe)
    kind = Format.of_output(task.job.output)
    if result.verdict is Verdict.RESTORED:
        if not np.isfinite(result.latent).all():
            raise ArithmeticError("the restored picture holds numbers that are not finite")
        data, notes = still.encode(task.still, result.latent.astype(np.float32), kind)
    else:
        data, notes = still.unchanged(task.still, kind)
    record = _record(task, settings, result)
    return Outcome(files={task.job.output: data, task.job.record: record.encode()}, sidecar=record, notes=notes)


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
