"""Photographs and clips, distinguished by their names."""

import os
from pathlib import Path
from typing import Literal

CLIP_SUFFIXES = (".mp4", ".m4v", ".mov", ".qt", ".mkv", ".webm", ".avi", ".mts", ".m2ts", ".mxf", ".3gp", ".mpg", ".mpeg")
Codec = Literal["same", "h264", "hevc", "prores", "dnxhr", "ffv1", "png", "tiff", "exr"]
Pipe = Literal["y4m", "rawvideo"]  # what pipes carry
SEQUENCES = ("png", "tiff", "exr")  # codecs that write folders of pictures
_NUMBERED = "#%*"  # marks of a pattern that stands for numbered pictures: frame_####.dng, frame_%04d.dng, frame_*.dng


def is_pipe(path: Path) -> bool:
    """Whether a name stands for standard input or output."""
    return path == Path("-")


def is_folder(path: Path) -> bool:
    """Whether a path names a folder; a name that is too long, or a link in a circle, names none."""
    return os.path.isdir(path)  # noqa: PTH112 # Path.is_dir raises on such names


def is_pattern(path: Path) -> bool:
    """Whether a name stands for numbered pictures."""
    return any(mark in path.name for mark in _NUMBERED)


def is_sequence(path: Path) -> bool:
    """Whether the frames are pictures of their own, in a folder or under a pattern."""
    return is_folder(path) or is_pattern(path)


def is_clip(path: Path) -> bool:
    """Whether a source holds frames one after the other; a file that is not what its name says is refused when it is read."""
    return path.suffix.lower() in CLIP_SUFFIXES or is_sequence(path) or is_pipe(path)
