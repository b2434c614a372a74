"""Sequences of pictures in a folder, read as a clip and written as one."""

from collections.abc import Iterator
from fractions import Fraction
from pathlib import Path

from rsvideo.config.files import UnreadableError
from rsvideo.video.clip import Colour, Picture, Stream


def is_sequence(path: Path) -> bool:
    """Whether a path names a sequence rather than one file."""
    return path.is_dir()


def probe(path: Path, rate: Fraction | None) -> Stream:  # noqa: ARG001
    """What a folder or a pattern holds."""
    raise UnreadableError(f"{path} is a folder; sequences are not read yet")


def pictures(stream: Stream, first: int, last: int) -> Iterator[Picture]:  # noqa: ARG001
    """The pictures first, ..., last - 1."""
    raise UnreadableError(f"{stream.path} is a folder; sequences are not read yet")


def layout(codec: str, colour: Colour) -> Colour:  # noqa: ARG001
    """The layout in which a sequence's files hold a colour."""
    raise ValueError(f"{codec} sequences are not written yet")


def write(folder: Path, codec: str, picture: Picture, number: int, colour: Colour) -> None:  # noqa: ARG001
    """One picture as the file of its number."""
    raise ValueError(f"{codec} sequences are not written yet")
