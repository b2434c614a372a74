"""What a clip is to be written as: its codec, and a layout of pixels that this holds."""

from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np

from rsvideo.config.media import CLIP_SUFFIXES, SEQUENCES, Codec, Pipe, is_pipe
from rsvideo.physics.tone import Transfer
from rsvideo.video import sequence
from rsvideo.video.part import Part
from rsvideo.video.pipe import BARE, PACKED, Y4M
from rsvideo.video.stream import Colour, Matrix, Stream, planar

ENCODERS = {"h264": "libx264", "hevc": "libx265", "prores": "prores_ks", "dnxhr": "dnxhd", "ffv1": "ffv1"}
_SAME = {"h264": "h264", "hevc": "hevc", "prores": "prores", "dnxhd": "dnxhr", "ffv1": "ffv1", "png": "png", "tiff": "tiff", "exr": "exr"}
_NAMES = {"h264": "H.264", "hevc": "HEVC", "prores": "ProRes", "dnxhr": "DNxHR", "ffv1": "FFV1", "y4m": "y4m", "rawvideo": "bare pixels"}
CONTAINERS = {
    ".mp4": ("mp4", ("h264", "hevc")),
    ".mov": ("mov", ("h264", "hevc", "prores", "dnxhr")),
    ".mkv": ("matroska", tuple(ENCODERS)),
}
MILLISECOND = Fraction(1, 1000)  # Matroska's time base, as FFmpeg writes it


@dataclass(frozen=True, kw_only=True)
class Encoding:
    """How a clip is to be written."""

    codec: Codec | Pipe = "same"
    crf: float | None = None  # constant rate factor of H.264 and HEVC; None is visually lossless
    pixel_format: str = "same"  # FFmpeg's name
    threads: int = 2


def check_times(path: Path, part: Part) -> None:
    """ValueError where the container would round times of the pictures together."""
    if path.suffix.lower() == ".mkv" and (np.diff(part.times(MILLISECOND)) <= 0).any():
        raise ValueError(
            f"{path} must keep pictures apart that are less than a millisecond apart, Matroska cannot; write .mp4 or .mov,"
            " as H.264, HEVC or ProRes"
        )


def chosen(path: Path, stream: Stream, encoding: Encoding) -> tuple[str, Colour, tuple[str, ...]]:
    """The codec and the layout that `encoding` comes to for a stream, and what that changes; ValueError where it cannot be."""
    codec, notes = encoding.codec, ()
    if is_pipe(path):
        return codec, *_held(codec, PACKED.get(encoding.pixel_format, encoding.pixel_format), stream.colour)
    if codec == "same":
        codec = _SAME.get(stream.codec, "hevc" if stream.colour.depth > 8 else "h264")
        if stream.codec not in _SAME:
            notes = (f"{stream.codec} is not written; the clip is encoded as {_NAMES.get(codec, codec)}",)
    if codec in SEQUENCES:
        if path.suffix.lower() in CLIP_SUFFIXES:
            raise ValueError(f"{path} must be the name of a folder, {codec} writes pictures; a --codec such as ffv1 writes a clip")
        target = sequence.layout(codec, stream.colour)
        if not stream.colour.full_range and codec != "exr":
            notes += ("codes above white are clipped: such a picture holds none",)
        if stream.variable or stream.tracks:
            notes += ("a sequence of pictures holds neither their times nor other tracks",)
        return codec, target, notes
    suffix = path.suffix.lower()
    if suffix not in CONTAINERS:
        raise ValueError(f"{path} must end in .mp4, .mov or .mkv for {_NAMES[codec]}, it ends in {path.suffix!r}")
    if codec not in CONTAINERS[suffix][1]:
        fitting = " or ".join(name for name, (_, codecs) in CONTAINERS.items() if codec in codecs)
        raise ValueError(f"{_NAMES[codec]} must be written to {fitting}, {path} ends in {path.suffix!r}")
    target, note = _held(codec, encoding.pixel_format, stream.colour)
    return codec, target, notes + note


def _held(codec: str, wanted: str, colour: Colour) -> tuple[Colour, tuple[str, ...]]:
    """The layout of a codec that holds a colour: the same, or else the least that loses nothing."""
    layouts = _layouts(codec)
    plain = colour.pixel_format.replace("yuvj", "yuv")
    if wanted in ("same", plain) and plain in layouts:
        return colour, ()
    if wanted == "same":
        wanted = min(
            (name for name in layouts if _holds(name, plain)),
            key=lambda name: (name.startswith("gbr") != plain.startswith("gbr"), planar(name)[0], sum(4 - s for s in planar(name)[2])),  # pyright: ignore[reportOptionalSubscript]
            default="",
        )
    if not wanted and codec == "prores" and plain == "yuv444p12le":
        wanted = "yuv444p10le"  # all that its encoder takes
    if wanted.replace("yuvj", "yuv") not in layouts or (facts := planar(wanted)) is None:
        named = (
            f"{wanted} pixels" if wanted else f"{colour.depth} bit {colour.subsampling} {'RGB' if colour.matrix is Matrix.RGB else 'YUV'}"
        )
        raise ValueError(
            f"{_NAMES[codec]} must be given a layout that it holds ({', '.join(sorted(layouts))}), not {named};"
            f" {'--format rawvideo' if codec == 'y4m' else 'FFV1'} holds all of them"
        )
    rgb = wanted.startswith("gbr")
    target = replace(colour, depth=facts[0], subsampling=facts[1], chroma_shift=facts[2], pixel_format=wanted)
    if rgb:
        target = replace(target, matrix=Matrix.RGB, full_range=True, h273=(*colour.h273[:2], 0, 2))
    elif colour.matrix is Matrix.RGB:
        target = replace(target, matrix=Matrix.BT709, full_range=False, h273=(colour.h273[0], colour.h273[1], 1, 1))
    elif wanted.startswith("yuvj"):
        target = replace(target, full_range=True, h273=(*colour.h273[:3], 2))
    if colour.transfer is Transfer.LINEAR and facts[0] < 16:
        target = replace(target, transfer=Transfer.BT709, h273=(1, 1, *target.h273[2:]))
    return target, (f"{_NAMES[codec]} stores {wanted}; the codes are converted from {colour.pixel_format}",)


def _layouts(codec: str) -> set[str]:
    if codec not in ENCODERS:
        return {*(Y4M if codec == "y4m" else BARE)}
    found = {layout.name for layout in av.Codec(ENCODERS[codec], "w").video_formats or ()}
    if codec == "ffv1":
        found |= {"gbrp"}  # as bgr0
    return {name for name in found if planar(name) and not name.startswith("yuvj") and "f32" not in name}  # which FFV1's version 3 lacks


def _holds(larger: str, smaller: str) -> bool:
    (depth, _, shift), (least, chroma, most) = planar(larger) or (0, "", (9, 9)), planar(smaller) or (99, "", (0, 0))
    if larger.startswith("gray") and chroma != "4:0:0":
        return False
    if larger.startswith("gbr") and not smaller.startswith("gbr"):
        return False
    exact = depth >= min(least, 10) and depth <= 16 if smaller.startswith("gbr") and not larger.startswith("gbr") else depth >= least
    return exact and (chroma == "4:0:0" or (shift[0] <= most[0] and shift[1] <= most[1]))
