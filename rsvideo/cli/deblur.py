"""rsvideo deblur: one blurred photograph in, a sharp one out."""

import os
import sys
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Option

Way = Literal["top-to-bottom", "bottom-to-top", "left-to-right", "right-to-left"]


def deblur(
    source: Annotated[Path, typer.Argument(metavar="INPUT", help="A PNG, TIFF, JPEG or raw photograph.")],
    output: Annotated[Path, Option("-o", "--output", metavar="OUTPUT", help="Where to write; the ending names the format.")],
    exposure: Annotated[
        str | None, Option(metavar="TIME", help="How long each row collects light: 1/50, 20ms, 0.02. [default: from EXIF]")
    ] = None,
    readout: Annotated[
        str | None, Option(metavar="TIME", help="From the first row's opening to the last one's; 0 is a global shutter.")
    ] = None,
    row_time: Annotated[str | None, Option(metavar="TIME", help="From one row's opening to the next one's, instead of --readout.")] = None,
    direction: Annotated[Way, Option(help="The way the readout runs over the picture as stored.")] = "top-to-bottom",
    focal_px: Annotated[str | None, Option(metavar="PX", help="Focal length in pixels. [default: from EXIF's 35 mm equivalent]")] = None,
    motion: Annotated[
        Literal["rotation", "shift"] | None, Option(help="All three angles, or the paper's shift. [default: rotation]")
    ] = None,
    degree: Annotated[int | None, Option(min=1, max=12, help="Of the trajectory's polynomial.")] = None,
    start: Annotated[Literal["kernels", "tracing"] | None, Option(help="How the first trajectory is found.")] = None,
    prior: Annotated[Literal["denoiser", "tv"] | None, Option(help="What a sharp picture is taken to look like.")] = None,
    transfer: Annotated[Literal["srgb", "bt709", "linear"] | None, Option(help="How codes stand for light. [default: srgb]")] = None,
    trajectory: Annotated[
        Path | None, Option(metavar="FILE", help="Restore with this motion: a sidecar, or CSV of t_s,pitch_rad,yaw_rad,roll_rad.")
    ] = None,
    threads: Annotated[int | None, Option(min=1, max=1024, help="[default: all cores]")] = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace OUTPUT and its sidecar.")] = False,
    json: Annotated[bool, Option("--json", help="Print the sidecar on standard output.")] = False,
) -> None:
    """Remove motion blur and rolling-shutter distortion from one photograph.

    Beside OUTPUT a sidecar <stem>.rsvideo.json records the timing, the motion that was found and the verdict.
    """
    if threads:
        os.environ["NUMBA_NUM_THREADS"] = str(threads)  # read once, when numba is first imported

    from rsvideo.cli import quiet
    from rsvideo.cli.ending import RefusedError
    from rsvideo.cli.progress import bar
    from rsvideo.config.files import UnreadableError, write_whole
    from rsvideo.config.quantity import pixels, seconds
    from rsvideo.physics.shutter import Direction
    from rsvideo.physics.tone import Transfer
    from rsvideo.pipeline.job import Job, prepare

    steering = {"motion": motion, "degree": degree, "start": start, "prior": prior}
    try:
        job = Job(
            source=source,
            output=output,
            exposure=None if exposure is None else seconds("exposure", exposure),
            readout=None if readout is None else seconds("readout", readout),
            row_time=None if row_time is None else seconds("row-time", row_time),
            direction=Direction(direction),
            focal_px=None if focal_px is None else pixels("focal-px", focal_px),
            transfer=Transfer(transfer) if transfer else None,
            trajectory=trajectory,
            steering={name: value for name, value in steering.items() if value is not None},
            overwrite=overwrite,
        )
        with quiet.c_libraries():
            task = prepare(job)

        from rsvideo.config import motion as motion_file  # with what follows, the slow ones: mistakes so far are told at once
        from rsvideo.pipeline import still
        from rsvideo.restoration.blind import Settings

        settings = Settings(**job.steering)
        path = None if trajectory is None else motion_file.read(trajectory, task.timing, task.camera.intrinsics)
    except UnreadableError:
        raise
    except ValueError as error:
        raise RefusedError(str(error)) from error
    for note in task.notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
    with bar() as show:
        outcome = still.carry_out(task, settings, path, lambda iterate: show(iterate.stage, iterate.fraction))
    write_whole(outcome.files)
    for note in outcome.notes:
        print(f"rsvideo: note: {note}", file=sys.stderr)
    if json:
        print(outcome.sidecar.encode().decode(), end="")
    else:
        record = outcome.sidecar.frames[0]
        print(f"rsvideo: {record.verdict}, {record.seconds:.1f} s: {output}", file=sys.stderr)
