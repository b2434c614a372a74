"""A clip's file as FFmpeg opens it: that file and no other, whatever its name or what it holds asks for."""

from pathlib import Path

import av
from av.container import InputContainer

_ONLY = "file"  # of FFmpeg's protocols


def address(path: Path) -> str:
    """A file's name for FFmpeg, which takes `concat:a.mp4` and `http:b.mp4` for more than names."""
    return f"{_ONLY}:{path}"


def opened(path: Path, family: str) -> InputContainer:
    """The file, read as a container of this family; playlists and references to other files lead nowhere."""
    return av.open(address(path), "r", format=family, metadata_errors="replace", container_options={"protocol_whitelist": _ONLY})
