"""Where files lie by name: a folder of this machine or of a shared disk, or object storage (`objects.py`)."""

import contextlib
import os
import shutil
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

from rsvideo.config import address, files, placing
from rsvideo.config.files import naming, read_whole, sha256, write_whole
from rsvideo.config.placing import Made

_BLOCK = 1 << 20


@runtime_checkable
class Place(Protocol):
    """Files under names. Names may lead through folders: `3/pictures`. All raise OSError where the disk, or the network, fails."""

    @property
    def at_once(self) -> bool:
        """Whether files get their names in no time, so that a signal can wait."""
        ...

    def at(self, name: str = "") -> str:
        """What people call the place, or a file in it."""
        ...

    def within(self, name: str) -> "Place":
        """A place in this one."""
        ...

    def check_writable(self) -> None:
        """Raises UnreachableError where nothing can be written."""
        ...

    def make(self) -> None:
        """Open the place: only then files can be put."""
        ...

    def there(self) -> bool:
        """Whether the place was made, and not removed."""
        ...

    def remove(self) -> None:
        """Remove the place and all that is in it."""
        ...

    def names(self) -> list[str]:
        """Of the files directly in the place; none where there is no such place."""
        ...

    def stamp(self, name: str) -> tuple[int, int] | None:
        """What changes when a file does, its size first; None where there is none."""
        ...

    def digest(self, name: str) -> str | None:
        """SHA-256 of a file, or of a folder's files; None where there is none that can be read."""
        ...

    def holds(self, name: str, digest: str) -> bool:
        """Whether a file is whole that was put under its hash, as far as it can be found out without moving it."""
        ...

    def put(self, name: str, digest: str, content: Path | bytes) -> None:
        """Write a file that holds what its name says; others may be writing the same, or reading, at this time."""
        ...

    def fetch(self, name: str, digest: str, path: Path) -> bool:
        """Bring a file to this machine under another name, if it has this hash."""
        ...

    def on_disk(self, name: str, *, most: int) -> contextlib.AbstractContextManager[Path]:
        """A path on this machine under which a file of at most `most` bytes can be read; nothing is there if there is none such."""
        ...

    def read(self, name: str, *, most: int) -> bytes:
        """All bytes of a small file; UnreadableError where there is none, or a larger one."""
        ...

    def state(self, name: str, data: bytes) -> None:
        """Write a small file, whole or not at all, over the one that is there."""
        ...

    def publish(self, made: Sequence[Made]) -> None:
        """Give files their names, in this order, the last of which states the hashes of the others."""
        ...


@dataclass(frozen=True, kw_only=True)
class Folder:
    """A folder of a disk."""

    path: Path

    @property
    def at_once(self) -> bool:
        """They are moved, not copied."""
        return True

    def at(self, name: str = "") -> str:
        """The path."""
        return str(self.path / name)

    def within(self, name: str) -> "Folder":
        """A folder in it."""
        return Folder(path=self.path / name)

    def check_writable(self) -> None:
        """The system says so when it is tried."""

    def make(self) -> None:
        """Make the folder."""
        self.path.mkdir(parents=True, exist_ok=True)

    def there(self) -> bool:
        """Whether it is a folder."""
        return self.path.is_dir()

    def remove(self) -> None:
        """Remove it and all that is in it, as far as the system lets us."""
        shutil.rmtree(self.path, ignore_errors=True)

    def names(self) -> list[str]:
        """Of all that is in it."""
        with contextlib.suppress(FileNotFoundError):
            return sorted(each.name for each in self.path.iterdir())
        return []

    def stamp(self, name: str) -> tuple[int, int] | None:
        """Size and time of the last change; links are never what was written, so theirs is no file's."""
        try:
            stat, link = (self.path / name).lstat(), (self.path / name).is_symlink()
        except OSError:
            return (-1, 0) if os.path.lexists(self.path / name) else None
        return (-1 if link else stat.st_size, stat.st_mtime_ns)

    def digest(self, name: str) -> str | None:
        """Not of links."""
        with contextlib.suppress(OSError):
            return None if (self.path / name).is_symlink() else files.digest(self.path / name)
        return None

    def holds(self, name: str, digest: str) -> bool:
        """Reads it: others may be writing it."""
        with contextlib.suppress(OSError):
            return (self.path / name).is_file() and sha256(self.path / name) == digest
        return False

    def put(self, name: str, digest: str, content: Path | bytes) -> None:
        """Write it in its place, never cutting it short; of the folders only the last is made, so that what was removed stays away."""
        path = self.path / name
        if self.holds(name, digest):
            return
        path.parent.mkdir(exist_ok=True)
        with naming(path), os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "wb") as file:
            for block in _blocks(content):
                file.write(block)
            file.truncate()
            file.flush()
            os.fsync(file.fileno())

    def fetch(self, name: str, digest: str, path: Path) -> bool:
        """As a second name of the file, where the disk has such."""
        if not self.holds(name, digest):
            return False
        path.unlink(missing_ok=True)
        try:
            path.hardlink_to(self.path / name)
        except OSError:  # another file system, or one without second names
            with naming(path):
                shutil.copyfile(self.path / name, path)
        return True

    @contextlib.contextmanager
    def on_disk(self, name: str, *, most: int) -> Iterator[Path]:  # noqa: ARG002 # it is not moved
        """Where it is."""
        yield self.path / name

    def read(self, name: str, *, most: int) -> bytes:
        """All bytes."""
        return read_whole(self.path / name, most=most)

    def state(self, name: str, data: bytes) -> None:
        """Under its name when it is complete."""
        self.make()
        write_whole({self.path / name: data})

    def publish(self, made: Sequence[Made]) -> None:
        """All of them or none, as `rsvideo.config.placing.place` does it."""
        placing.place(made)


def key(text: str) -> str:
    """What two names of one file, or of one object, have in common."""
    return text if address.is_address(text) else str(placing.real(Path(text)))


def _blocks(content: Path | bytes) -> Iterator[bytes]:
    if isinstance(content, bytes):
        yield content
        return
    with content.open("rb") as file:
        while block := file.read(_BLOCK):
            yield block
