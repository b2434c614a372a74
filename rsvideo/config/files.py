"""How files are read, bounded, and how they appear under their names: whole or not at all."""

import contextlib
import errno
import hashlib
import os
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path

from rsvideo.config.placing import Made, aside, place

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


def digest(path: Path) -> str:
    """SHA-256 of a file, or of a folder's files with their names; raises OSError for what is neither, or cannot be read."""
    if path.is_dir():
        held = [f"{sha256(file)} {file.name}\n" for file in sorted(path.iterdir()) if file.is_file()]
        return hashlib.sha256("".join(held).encode("utf-8", "surrogateescape")).hexdigest()
    if not path.is_file():
        raise OSError(errno.EINVAL, os.strerror(errno.EINVAL), str(path))
    return sha256(path)


def write_whole(contents: Mapping[Path, bytes | Iterable[bytes]]) -> None:
    """Write several files, given whole or piece by piece, so that each appears complete, and none at all if one cannot be written."""
    with contextlib.ExitStack() as stack:
        folders: dict[Path, Path] = {}
        made = []
        for path, data in contents.items():
            with naming(path):
                if path.parent not in folders:
                    folders[path.parent] = stack.enter_context(aside(path.parent))
            made.append(made_within(folders[path.parent], path, data))
        place(made)


def made_within(folder: Path, path: Path, data: bytes | Iterable[bytes]) -> Made:
    """A file, given whole or piece by piece, in a folder of our own; it is to have the name `path`."""
    at, digest = folder / path.name, hashlib.sha256()
    with naming(path), at.open("xb") as file:
        for piece in [data] if isinstance(data, bytes) else data:
            digest.update(piece)
            file.write(piece)
        file.flush()
        os.fsync(file.fileno())
    return Made(at=at, path=path, sha256=digest.hexdigest())


@contextlib.contextmanager
def naming(path: Path) -> Iterator[None]:
    """Errors of the system get the name of a file: a failed write does not say of which, and one that is made aside has another."""
    try:
        yield
    except OSError as error:
        raise OSError(error.errno, error.strerror, str(path)) from error
