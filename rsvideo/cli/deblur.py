"""rsvideo deblur: one blurred photograph or clip in, a sharp one out."""

import os
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Option

from rsvideo.cli import asked, options
from rsvideo.config.method import Method


def deblur(
    source: Annotated[
        Path, typer.Argument(metavar="INPUT", help="A photograph (PNG, TIFF, JPEG, raw), a clip (MP4, MOV, MKV), or a folder of pictures.")
    ],
    output: Annotated[Path, Option("-o", "--output", metavar="OUTPUT", help="Where to write; the ending names the format.")],
    exposure: options.Exposure = None,
    readout: options.Readout = None,
    row_time: options.RowTime = None,
    direction: options.ReadoutDirection = None,
    focal_px: options.FocalPx = None,
    motion: options.Motion = None,
    degree: options.Degree = None,
    start: options.Start = None,
    refinement: options.Refinement = None,
    prior: options.Prior = None,
    transfer: options.Transfer = None,
    trajectory: options.GivenMotion = None,
    gyro: options.Gyro = None,
    gyro_offset: options.GyroOffset = None,
    gyro_axes: options.GyroAxes = None,
    shutter_angle: options.ShutterAngle = None,
    scanlines_total: options.ScanlinesTotal = None,
    camera: options.Camera = None,
    method: Annotated[
        Method, Option(help="This project's, or one that it is compared with; none decodes and encodes only.")
    ] = Method.RSVIDEO,
    block_rows: options.BlockRows = None,
    frames: options.Frames = None,
    path: options.OutputPath = "keep",
    part: options.Range = None,
    side_by_side: options.SideBySide = False,
    codec: Annotated[
        Literal["same", "h264", "hevc", "prores", "dnxhr", "ffv1", "png", "tiff", "exr"] | None, Option(help="Of a clip. [default: same]")
    ] = None,
    quality: options.Quality = None,
    pixel_format: options.PixelFormat = None,
    on_damage: options.OnDamage = "fail",
    rate: options.Rate = None,
    force: options.Force = False,
    threads: Annotated[int | None, Option(min=1, max=1024, help="[default: all cores]")] = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace OUTPUT and its sidecar.")] = False,
    json: Annotated[bool, Option("--json", help="Print the sidecar on standard output.")] = False,
) -> None:
    """Remove motion blur and rolling-shutter distortion from one photograph or clip.

    Beside OUTPUT a sidecar <stem>.rsvideo.json records the timing, the motion that was found and the verdict of each frame;
    of a clip, <stem>.gcsv the motion as a gyroscope's log.
    """
    words = asked.words(locals())
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # threads that spin while they wait starve each other on a busy machine
    if threads:
        os.environ["NUMBA_NUM_THREADS"] = str(threads)  # read once, when numba is first imported

    from rsvideo.cli import in_this_process
    from rsvideo.cli.exit_codes import RefusedError
    from rsvideo.config.files import UnreadableError

    try:
        in_this_process.deblur(asked.job(source, output, words | {"overwrite": overwrite}), json=json)
    except UnreadableError:
        raise
    except ValueError as error:
        raise RefusedError(str(error)) from error
