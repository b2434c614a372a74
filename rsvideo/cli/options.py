"""The options that restoring and comparing share."""

from pathlib import Path
from typing import Annotated, Literal

from typer import Option

Way = Literal["top-to-bottom", "bottom-to-top", "left-to-right", "right-to-left"]

Exposure = Annotated[str | None, Option(metavar="TIME", help="How long each row collects light: 1/50, 20ms, 0.02. [default: from EXIF]")]
Readout = Annotated[str | None, Option(metavar="TIME", help="From the first row's opening to the last one's; 0 is a global shutter.")]
RowTime = Annotated[str | None, Option(metavar="TIME", help="From one row's opening to the next one's, instead of --readout.")]
ReadoutDirection = Annotated[Way | None, Option(help="The way the readout runs over the picture as stored. [default: top-to-bottom]")]
FocalPx = Annotated[str | None, Option(metavar="PX", help="Focal length in pixels. [default: from EXIF's 35 mm equivalent]")]
Motion = Annotated[Literal["rotation", "shift"] | None, Option(help="All three angles, or the paper's shift. [default: rotation]")]
Degree = Annotated[int | None, Option(min=1, max=12, help="Of the trajectory's polynomial.")]
Start = Annotated[Literal["kernels", "tracing"] | None, Option(help="How the first trajectory is found.")]
Refinement = Annotated[
    Literal["sparsity", "alternation"] | None, Option(help="Of it: latent image eliminated, or the paper's Algorithm 1.")
]
Prior = Annotated[Literal["denoiser", "tv"] | None, Option(help="What a sharp picture is taken to look like.")]
Transfer = Annotated[
    str | None, Option(metavar="CURVE", help="How codes stand for light: srgb, bt709, slog3, ... [default: the clip's tag, or srgb]")
]
GivenMotion = Annotated[
    Path | None, Option(metavar="FILE", help="Restore with this motion: a sidecar, or CSV of t_s,pitch_rad,yaw_rad,roll_rad.")
]
Gyro = Annotated[
    Path | None, Option(metavar="FILE", help="Of the methods gyro: a log (.gcsv, CSV, t_ns wx wy wz). [default: what the clip embeds]")
]
GyroOffset = Annotated[float | None, Option(metavar="SECONDS", help="What the clip's time becomes the log's by adding. [default: found]")]
GyroAxes = Annotated[
    str | None, Option(metavar="XYZ", help="The gyroscope's axes along the camera's right, down, forward. [default: found]")
]
ShutterAngle = Annotated[float | None, Option(metavar="DEGREES", help="Of a clip, instead of --exposure.")]
ScanlinesTotal = Annotated[int | None, Option(metavar="N", help="Of a clip: visible and blanking lines, instead of --readout.")]
Camera = Annotated[str | None, Option(metavar="NAME", help="A profile by name or file; of a clip, also a camera of the public table.")]
BlockRows = Annotated[int | None, Option(min=16, max=100_000, help="Of the method stitch. [default: a third of the frame]")]
Frames = Annotated[
    Literal["together", "alone", "cold"] | None,
    Option(help="Of a clip: restored with their neighbours, along its path only, or each as a still. [default: together]"),
]
OutputPath = Annotated[Literal["keep", "smooth"], Option(help="Of a clip: the camera's own path, or a smooth one with a crop.")]
Range = Annotated[str | None, Option("--range", metavar="FROM-TO", help="Of a clip: the part to restore, such as 00:10-00:12.")]
SideBySide = Annotated[bool, Option("--side-by-side", help="Of a clip: the source on the left, the result on the right.")]
Quality = Annotated[float | None, Option(min=0, max=63, help="Constant rate factor of h264 and hevc.")]
PixelFormat = Annotated[str | None, Option(metavar="NAME", help="By FFmpeg's name, such as yuv422p10le.")]
OnDamage = Annotated[Literal["fail", "passthrough", "skip"], Option(help="What to do with damaged frames of a clip.")]
Rate = Annotated[str | None, Option(metavar="FPS", help="Of a folder of pictures: frames a second.")]
Force = Annotated[bool, Option("--force", help="Of a clip: take a readout longer than a frame's period.")]
