"""Readers that are not the project's, to check that what it wrote is whole: FFmpeg alone for clips, Pillow for pictures."""

import contextlib
from pathlib import Path

import av
import av.error
import PIL.Image
import tifffile

from tests.robustness.case import Case


def incomplete(case: Case, folder: Path) -> str | None:
    """Why the result of a case is not whole; None where it is."""
    assert case.output is not None
    output = folder / case.output
    if not output.exists():
        return f"there is no {case.output}"
    if output.suffix in (".mkv", ".mp4", ".mov"):
        return _clip(case, folder, output)
    if output.suffix == ".png":
        return _picture(case, folder, output)
    return None if output.stat().st_size else "it is empty"


def _clip(case: Case, folder: Path, output: Path) -> str | None:
    written = _decoded(output)
    wanted = case.frames if case.frames is not None or case.source is None else _packets(folder / case.source)
    if not written:
        return "its result holds no picture"
    return None if wanted is None or written == wanted else f"{wanted} pictures came in, {written} went out"


def _decoded(path: Path) -> int:
    with av.open(str(path)) as file:
        return sum(1 for _ in file.decode(video=0))


def _packets(path: Path) -> int | None:
    """Pictures that a clip's file lists; None where this reader cannot tell."""
    if path.is_dir():
        return sum(1 for _ in path.iterdir())
    try:
        with av.open(str(path), metadata_errors="replace") as file:
            return sum(1 for packet in file.demux(video=0) if packet.size and not packet.is_discard)
    except (av.error.FFmpegError, ValueError, IndexError):
        return None


def _picture(case: Case, folder: Path, output: Path) -> str | None:
    with PIL.Image.open(output) as picture:
        picture.load()
        size = picture.size
    if case.source is None:
        return None
    with contextlib.suppress(PIL.UnidentifiedImageError, tifffile.TiffFileError), PIL.Image.open(folder / case.source) as source:
        if source.size != size and source.format != "TIFF":  # of a raw picture, Pillow reads a thumbnail
            return f"it is {source.size}, its result is {size}"
        try:
            source.load()
        except OSError as error:
            if "truncated" in str(error):
                return f"it was restored, but {error}"
    return None
