"""Cases as the benchmarks read them: folders with what is true of a clip or a photograph, and the pictures of clips."""

import json
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
from av.video.frame import VideoFrame
from av.video.stream import VideoStream

from rsvideo.video.colour import relaid
from rsvideo.video.decode import pictures, probe


def cases_of(folder: Path, only: Sequence[str] | None = None) -> list[Path]:
    """The cases of a folder, all or `only` some; ends the program where there are none."""
    found = sorted(f.parent for f in folder.glob("*/case.json") if not only or f.parent.name in only)
    if not found:
        sys.exit(f"{folder} must hold cases, NAME/case.json")
    return found


def facts_of(case: Path) -> dict:
    """What is true of a case."""
    return json.loads((case / "case.json").read_text())


def luma(path: Path) -> list[np.ndarray]:
    """Every picture's Y in [0, 1], (rows, columns, 1)."""
    stream = probe(path)
    return [p.planes[0][..., None].astype(np.float32) / stream.colour.top for p in pictures(stream)]


def encoded_anew(
    source: Path,
    output: Path,
    change: Callable[[int, Sequence[np.ndarray]], Sequence[np.ndarray]],
    options: Mapping[str, str],
    encoder: str = "libx264",
) -> None:
    """The clip with planes that are made of each picture's number and its planes, in 8 bits and 4:2:0; by an encoder with these options, at
    one rate."""
    stream = probe(source)
    written = replace(stream.colour, depth=8, subsampling="4:2:0", chroma_shift=(1, 1), pixel_format="yuv420p")
    with av.open(str(output), "w") as file:
        video = file.add_stream(encoder, rate=Fraction(stream.rate), options=dict(options))
        assert isinstance(video, VideoStream)
        video.width, video.height, video.pix_fmt = stream.cols, stream.rows, "yuv420p"
        context = video.codec_context
        context.color_primaries, context.color_trc, context.colorspace, context.color_range = stream.colour.h273
        for k, picture in enumerate(pictures(stream)):
            laid = relaid(replace(picture, planes=tuple(change(k, picture.planes))), stream.colour, written)
            stacked = np.concatenate([plane.ravel() for plane in laid.planes]).reshape(-1, stream.cols)
            frame = VideoFrame.from_ndarray(stacked, format="yuv420p")
            frame.pts, frame.time_base, frame.color_range = k, 1 / Fraction(stream.rate), stream.colour.h273[3]
            file.mux(video.encode(frame))
        file.mux(video.encode(None))
