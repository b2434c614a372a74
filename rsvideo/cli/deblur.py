"""rsvideo deblur: one blurred photograph or clip in, a sharp one out."""

import os
from pathlib import Path
from typing import Annotated, Literal

import typer
from typer import Option

from rsvideo.config.method import GyroFile, Method

Way = Literal["top-to-bottom", "bottom-to-top", "left-to-right", "right-to-left"]


def deblur(
    source: Annotated[
        Path, typer.Argument(metavar="INPUT", help="A photograph (PNG, TIFF, JPEG, raw), a clip (MP4, MOV, MKV), or a folder of pictures.")
    ],
    output: Annotated[Path, Option("-o", "--output", metavar="OUTPUT", help="Where to write; the ending names the format.")],
    exposure: Annotated[
        str | None, Option(metavar="TIME", help="How long each row collects light: 1/50, 20ms, 0.02. [default: from EXIF]")
    ] = None,
    readout: Annotated[
        str | None, Option(metavar="TIME", help="From the first row's opening to the last one's; 0 is a global shutter.")
    ] = None,
    row_time: Annotated[str | None, Option(metavar="TIME", help="From one row's opening to the next one's, instead of --readout.")] = None,
    direction: Annotated[Way | None, Option(help="The way the readout runs over the picture as stored. [default: top-to-bottom]")] = None,
    focal_px: Annotated[str | None, Option(metavar="PX", help="Focal length in pixels. [default: from EXIF's 35 mm equivalent]")] = None,
    motion: Annotated[
        Literal["rotation", "shift"] | None, Option(help="All three angles, or the paper's shift. [default: rotation]")
    ] = None,
    degree: Annotated[int | None, Option(min=1, max=12, help="Of the trajectory's polynomial.")] = None,
    start: Annotated[Literal["kernels", "tracing"] | None, Option(help="How the first trajectory is found.")] = None,
    refinement: Annotated[
        Literal["sparsity", "alternation"] | None, Option(help="Of it: latent image eliminated, or the paper's Algorithm 1.")
    ] = None,
    prior: Annotated[Literal["denoiser", "tv"] | None, Option(help="What a sharp picture is taken to look like.")] = None,
    transfer: Annotated[
        str | None, Option(metavar="CURVE", help="How codes stand for light: srgb, bt709, slog3, ... [default: the clip's tag, or srgb]")
    ] = None,
    trajectory: Annotated[
        Path | None, Option(metavar="FILE", help="Restore with this motion: a sidecar, or CSV of t_s,pitch_rad,yaw_rad,roll_rad.")
    ] = None,
    gyro: Annotated[
        Path | None, Option(metavar="FILE", help="Of the methods gyro: a log (.gcsv, CSV, t_ns wx wy wz). [default: what the clip embeds]")
    ] = None,
    gyro_offset: Annotated[
        float | None, Option(metavar="SECONDS", help="What the clip's time becomes the log's by adding. [default: found]")
    ] = None,
    gyro_axes: Annotated[
        str | None, Option(metavar="XYZ", help="The gyroscope's axes along the camera's right, down, forward. [default: found]")
    ] = None,
    shutter_angle: Annotated[float | None, Option(metavar="DEGREES", help="Of a clip, instead of --exposure.")] = None,
    scanlines_total: Annotated[int | None, Option(metavar="N", help="Of a clip: visible and blanking lines, instead of --readout.")] = None,
    camera: Annotated[
        str | None, Option(metavar="NAME", help="A profile by name or file; of a clip, also a camera of the public table.")
    ] = None,
    method: Annotated[
        Method, Option(help="This project's, or one that it is compared with; none decodes and encodes only.")
    ] = Method.RSVIDEO,
    block_rows: Annotated[int | None, Option(min=16, max=100_000, help="Of the method stitch. [default: a third of the frame]")] = None,
    frames: Annotated[
        Literal["together", "alone", "cold"] | None,
        Option(help="Of a clip: restored with their neighbours, along its path only, or each as a still. [default: together]"),
    ] = None,
    path: Annotated[Literal["keep", "smooth"], Option(help="Of a clip: the camera's own path, or a smooth one with a crop.")] = "keep",
    part: Annotated[str | None, Option("--range", metavar="FROM-TO", help="Of a clip: the part to restore, such as 00:10-00:12.")] = None,
    side_by_side: Annotated[bool, Option("--side-by-side", help="Of a clip: the source on the left, the result on the right.")] = False,
    codec: Annotated[
        Literal["same", "h264", "hevc", "prores", "dnxhr", "ffv1", "png", "tiff", "exr"] | None, Option(help="Of a clip. [default: same]")
    ] = None,
    quality: Annotated[float | None, Option(min=0, max=63, help="Constant rate factor of h264 and hevc.")] = None,
    pixel_format: Annotated[str | None, Option(metavar="NAME", help="By FFmpeg's name, such as yuv422p10le.")] = None,
    on_damage: Annotated[Literal["fail", "passthrough", "skip"], Option(help="What to do with damaged frames of a clip.")] = "fail",
    rate: Annotated[str | None, Option(metavar="FPS", help="Of a folder of pictures: frames a second.")] = None,
    force: Annotated[bool, Option("--force", help="Of a clip: take a readout longer than a frame's period.")] = False,
    threads: Annotated[int | None, Option(min=1, max=1024, help="[default: all cores]")] = None,
    overwrite: Annotated[bool, Option("--overwrite", help="Replace OUTPUT and its sidecar.")] = False,
    json: Annotated[bool, Option("--json", help="Print the sidecar on standard output.")] = False,
) -> None:
    """Remove motion blur and rolling-shutter distortion from one photograph or clip.

    Beside OUTPUT a sidecar <stem>.rsvideo.json records the timing, the motion that was found and the verdict of each frame;
    of a clip, <stem>.gcsv the motion as a gyroscope's log.
    """
    os.environ.setdefault("OMP_WAIT_POLICY", "passive")  # threads that spin while they wait starve each other on a busy machine
    if threads:
        os.environ["NUMBA_NUM_THREADS"] = str(threads)  # read once, when numba is first imported

    from rsvideo.cli.ending import RefusedError
    from rsvideo.config.files import UnreadableError

    steering = {"motion": motion, "degree": degree, "start": start, "refinement": refinement, "prior": prior, "frames": frames}
    encoding = {"codec": codec, "quality": quality, "pixel_format": pixel_format}
    words = {
        "exposure": exposure,
        "shutter_angle": shutter_angle,
        "readout": readout,
        "row_time": row_time,
        "scanlines_total": scanlines_total,
        "direction": direction,
        "focal_px": focal_px,
        "camera": camera,
        "transfer": transfer,
        "trajectory": trajectory,
        "method": method,
        "block_rows": block_rows,
        "gyro": GyroFile(path=gyro, offset=gyro_offset, axes=gyro_axes),
        "steering": {name: value for name, value in steering.items() if value is not None},
        "encoding": {name: value for name, value in encoding.items() if value is not None},
        "path": path if path != "keep" else None,
        "span": part,
        "side_by_side": side_by_side or None,
        "on_damage": on_damage if on_damage != "fail" else None,
        "rate": rate,
        "force": force or None,
        "overwrite": overwrite,
    }

    from rsvideo.cli import asked, in_this_process

    try:
        in_this_process.deblur(asked.job(source, output, words), json=json)
    except UnreadableError:
        raise
    except ValueError as error:
        raise RefusedError(str(error)) from error
