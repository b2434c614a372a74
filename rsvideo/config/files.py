"""How files are read, bounded, and how they appear under their names: whole or not at all."""

import contextlib
import hashlib
import os
from collections.abc import Iterable, Mapping
from pathlib import Path

_BLOCK = 1 << 20  # bytes that are hashed at a time: memory does not grow with the file


class UnreadableError(ValueError):
    """A file that is missing, damaged, or not of the kind it was taken for."""


def read_whole(path: Path, *, most: int) -> bytes:
    """All bytes of a file of at most `most` bytes."""
    try:
        if not path.is_file():
            raise UnreadableError(f"{path} {'is a folder, not a file' if path.is_dir() else 'does not exist or is not a file'}")
        if (size := path.stat().st_size) > most:
            raise UnreadableError(f"{path} must hold at most {most / 1e6:g} MB, it holds {size / 1e6:.0f} MB; is it the right file?")
        if size == 0:
            raise UnreadableError(f"{path} is empty")
        return path.read_bytes()
    except OSError as error:
        raise UnreadableError(f"{path} cannot be read: {error.strerror}") from error


def sha256(*paths: Path) -> str:
    """SHA-256 of all bytes of files, one after the other, in hexadecimal digits; raises OSError where one cannot be read."""
    digest = hashlib.sha256()
    for path in paths:
        with path.open("rb") as file:
            while block := file.read(_BLOCK):
                digest.update(block)
    return digest.hexdigest()


def part_of(path: Path) -> Path:
    """Where a file is written before it appears under its name: beside it, so that moving it there is one step."""
    return path.with_name(path.name + ".part")


def write_whole(contents: Mapping[Path, bytes | Iterable[bytes]]) -> None:
    """Write several files, given whole or piece by piece, so that each appears complete, and none at all if one cannot be written."""
    parts = {path: part_of(path) for path in contents}
    at = None
    try:
        for at, data in contents.items():
            with parts[at].open("wb") as file:
                file.writelines([data] if isinstance(data, bytes) else data)
                file.flush()
                os.fsync(file.fileno())
        for path, part in parts.items():
            part.replace(path)
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(at)) from error  # a failed write does not say of which file
    finally:
        for part in parts.values():
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
