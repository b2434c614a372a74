"""How files are read, bounded, and how they appear under their names: whole or not at all."""

import contextlib
import errno
import hashlib
import os
import stat
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import BinaryIO

from rsvideo.config.placing import Made, aside, place

_BLOCK = 1 << 20  # bytes that are hashed at a time: memory does not grow with the file
_LONGEST_LINE = 100_000  # bytes of a line of a text file


class UnreadableError(ValueError):
    """A file that is missing, damaged, or not of the kind it was taken for."""


class UnreachableError(OSError):
    """Object storage that does not answer, or lets nobody in; `filename` is the address, `strerror` says why."""


@contextlib.contextmanager
def reading(path: Path) -> Iterator[None]:
    """Whatever a decoder raises on a file's content is a fault of the file: UnreadableError, which names it.

    The one place where that is decided. Decoders of strangers' files raise whatever the damage leads them to.
    """
    try:
        yield
    except UnreadableError:
        raise
    except MemoryError as error:
        raise UnreadableError(f"{path} needs more memory than there is; is its header damaged, or is it too large for here?") from error
    except Exception as error:
        if words := getattr(error, "strerror", None):  # of the system, and of FFmpeg, whose own text repeats the path
            raise UnreadableError(f"{path} cannot be read: {words.lower()}; is it damaged or cut short?") from error
        if type(error) is ValueError:  # our own words, which say what the file must be
            raise UnreadableError(f"{path} {error}") from error
        raise UnreadableError(f"{path} is damaged: {type(error).__name__}: {error}") from error


@contextlib.contextmanager
def opened(path: Path) -> Iterator[BinaryIO]:
    """A file opened for reading; UnreadableError where there is none, or none that ends: a folder, a device, a pipe."""
    try:
        file = _regular(path)
    except (FileNotFoundError, NotADirectoryError) as error:
        raise UnreadableError(f"{path} does not exist or is not a file") from error
    except IsADirectoryError as error:
        raise UnreadableError(f"{path} is a folder, not a file") from error
    except (OSError, ValueError) as error:  # the latter from a name with a zero byte
        raise UnreadableError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}") from error
    with file:
        try:
            yield file
        except OSError as error:
            raise UnreadableError(f"{path} cannot be read: {error.strerror or error}") from error


def read_whole(path: Path, *, most: int) -> bytes:
    """All bytes of a file of at most `most` bytes."""
    with opened(path) as file:
        data = file.read(size + 1) if (size := os.fstat(file.fileno()).st_size) <= most else b""
        if (size := max(size, len(data))) > most:
            raise UnreadableError(f"{path} must hold at most {most / 1e6:g} MB, it holds {size / 1e6:.0f} MB; is it the right file?")
    if not data:
        raise UnreadableError(f"{path} is empty")
    return data


def lines(path: Path, *, most: int) -> Iterator[str]:
    """The lines of a text file of at most `most` bytes, one after the other, without their ends: the file is never held whole."""
    left = most
    with opened(path) as file:
        for number, line in enumerate(iter(lambda: file.readline(_LONGEST_LINE + 1), b""), 1):
            if (left := left - len(line)) < 0:
                raise UnreadableError(f"{path} must hold at most {most / 1e6:g} MB; is it the right file?")
            if len(line) > _LONGEST_LINE:
                raise UnreadableError(f"{path}:{number}: must be at most {_LONGEST_LINE} bytes long; is it text?")
            yield line.decode("utf-8-sig" if number == 1 else "utf-8", "replace").rstrip("\r\n")
        if left == most:
            raise UnreadableError(f"{path} is empty")


def sha256(*paths: Path) -> str:
    """SHA-256 of all bytes of files, one after the other, in hexadecimal digits; raises OSError where one cannot be read."""
    digest = hashlib.sha256()
    for path in paths:
        with _regular(path) as file:
            while block := file.read(_BLOCK):
                digest.update(block)
    return digest.hexdigest()


def digest(path: Path) -> str:
    """SHA-256 of a file, or of a folder's files with their names; raises OSError for what is neither, or cannot be read."""
    if not path.is_dir():
        return sha256(path)
    held = [f"{sha256(file)} {file.name}\n" for file in sorted(path.iterdir()) if file.is_file()]
    return hashlib.sha256("".join(held).encode("utf-8", "surrogateescape")).hexdigest()


def _regular(path: Path) -> BinaryIO:
    """A file that has an end, opened without waiting for anybody to write into it; OSError for all else."""
    descriptor = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0) | getattr(os, "O_BINARY", 0))
    try:
        mode = os.fstat(descriptor).st_mode
        if stat.S_ISDIR(mode):
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
        if not stat.S_ISREG(mode):
            raise FileNotFoundError(errno.EINVAL, "it is a device or a pipe, not a file", str(path))
    except OSError:
        os.close(descriptor)
        raise
    return os.fdopen(descriptor, "rb")


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
