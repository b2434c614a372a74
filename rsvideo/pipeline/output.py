"""What photographs and clips share when they are written: where they may be written, and the record of a frame."""

import json
import tempfile
from dataclasses import asdict
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float
from pydantic import JsonValue

from rsvideo.config import media, placing, sidecar
from rsvideo.config.request import Request
from rsvideo.frame import FrameResult

if TYPE_CHECKING:
    from rsvideo.pipeline.prepare import Task

_DIGITS = 5  # of the values of a PSF, whose sum is 1


def check(request: Request) -> None:
    """Refuse what cannot be written, with ValueError or FileExistsError."""
    source, output = request.source, request.output
    if media.is_pipe(output):
        return
    folder = output.parent
    if not folder.is_dir():
        raise ValueError(f"the folder {folder} of OUTPUT must exist; make it first, or is its name mistyped?")
    if placing.same(output, source):
        raise ValueError(f"OUTPUT must not be INPUT, both are {output}; the original is never replaced")
    try:
        tempfile.TemporaryFile(dir=folder).close()
    except OSError as error:
        raise ValueError(f"the folder {folder} of OUTPUT must be writable: {error.strerror}; is it yours?") from error
    placing.check(request.files, request.inputs, overwrite=request.overwrite)
    for path in request.files[1:]:
        if path.is_dir():
            raise ValueError(f"{path} is written beside OUTPUT, a folder of that name stands there; move it, or give OUTPUT another name")


def check_kind(output: Path, *, folder: bool) -> None:
    """Refuse a folder where a file is written, and a file where a folder is, with ValueError."""
    if output.exists() and output.is_dir() != folder:
        one, other = ("a folder", "a file") if folder else ("a file", "a folder")
        raise ValueError(f"OUTPUT must be {one}, {output} is {other}")


def settings_record(
    task: "Task", transfer: str, *, input_sha256: str | None = None, encoding: dict[str, JsonValue] | None = None
) -> sidecar.Settings:
    """All that steered the work, for the sidecar; `transfer` is the name of the codes' curve."""
    trajectory = task.request.motion.trajectory
    return sidecar.Settings(
        rsvideo=version("rsvideo"),
        camera=task.camera,
        direction=task.timing.direction,
        transfer=transfer,
        trajectory_from=None if trajectory is None else str(trajectory),
        restoration=_steered(asdict(task.settings)),
        input_sha256=input_sha256,
        encoding=encoding or {},
    )


def _steered(settings: dict[str, JsonValue]) -> dict[str, JsonValue]:
    """The core's settings as the sidecar has them; of the device only where it is not the processor."""
    unsaid = {"device"} if settings["device"] == "cpu" else set[str]()
    return json.loads(json.dumps({name: value for name, value in settings.items() if name not in unsaid}))


def frame_record(result: FrameResult, to_next: np.ndarray | None = None) -> sidecar.FrameRecord:
    """What became of a frame; `to_next` leads from its pose to the next frame's."""
    path = result.trajectory
    t = sidecar.Sampled.times(path.t0, path.t1)
    return sidecar.FrameRecord(
        index=result.frame.index,
        time_s=result.frame.time,
        timing=sidecar.Timing(exposure_s=result.timing.exposure, row_time_s=result.timing.row_time, source=result.timing_source),
        trajectory=sidecar.Sampled.of(t, path.at(t)),
        to_next=None if to_next is None else [*to_next.tolist(), 0.0][:3],
        verdict=result.verdict,
        seconds=result.seconds,
        convergence=list(result.convergence),
        overlaid=round(result.overlaid, 4),
        psfs=None if result.psfs is None else _trimmed(result.psfs).round(_DIGITS).tolist(),
    )


def _trimmed(psfs: Float[np.ndarray, "down across k k"]) -> Float[np.ndarray, "down across n n"]:
    """The kernels without the rim that is 0 in all of them."""
    middle = psfs.shape[-1] // 2
    _, _, y, x = np.nonzero(psfs)
    reach = max(int(np.abs(y - middle).max(initial=0)), int(np.abs(x - middle).max(initial=0)))
    kept = slice(middle - reach, middle + reach + 1)
    return psfs[..., kept, kept]
