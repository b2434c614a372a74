"""The files that a camera is measured on: clips, photographs, and folders of them."""

from collections.abc import Sequence
from pathlib import Path

from rsvideo.config.media import CLIP_SUFFIXES

_PHOTOGRAPH_ENDINGS = {".png", ".jpg", ".jpeg", ".tif", ".tiff", ".dng", ".cr2", ".cr3", ".nef", ".arw", ".raf", ".rw2", ".orf"}


def paths(files: Path | str | Sequence[Path | str]) -> tuple[Path, ...]:
    """One file or several, as paths."""
    return (Path(files),) if isinstance(files, Path | str) else tuple(Path(file) for file in files)


def is_clip(path: Path) -> bool:
    """Whether a file is taken for a clip, not for a photograph."""
    return path.suffix.lower() in CLIP_SUFFIXES


def photographs(files: Sequence[Path]) -> tuple[Path, ...]:
    """The files, and the photographs in each folder among them."""
    found = [sorted(f for f in p.iterdir() if f.suffix.lower() in _PHOTOGRAPH_ENDINGS) if p.is_dir() else [p] for p in files]
    return tuple(path for some in found for path in some)


def by_name(files: Sequence[Path]) -> dict[str, Path]:
    """Files by their names, or by their whole paths where names repeat."""
    names = [path.name for path in files]
    return {path.name if names.count(path.name) == 1 else str(path): path for path in files}
