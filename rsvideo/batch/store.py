"""Restored chunks on a disk that several machines share, until the one that keeps the ledger takes them over.

Each chunk has a folder. Files are named by what they hold, and a chunk's record, which lists its files, is written last. So nobody has
to lock or rename anything: two who restore the same chunk disturb each other nowhere, and what is half-written does not have its hash.
"""

import contextlib
import hashlib
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from rsvideo.config.files import naming, read_whole, sha256
from rsvideo.config.sidecar import Mark
from rsvideo.pipeline import fingerprint
from rsvideo.pipeline.pieces import Chunk, ChunkRecord

FOLDER = "store"  # within the folder that a job works in
_RECORD = re.compile(r"([0-9a-f]{64})\.json")
_DIGEST = re.compile(r"[0-9a-f]{64}")
_MOST_BYTES = 10_000_000  # of a record
_BLOCK = 1 << 20


class _Kept(BaseModel):
    """What a record's file holds."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    chunk: Chunk
    record: ChunkRecord


@dataclass(frozen=True, kw_only=True)
class Store:
    """The chunks of one photograph or clip, as it is restored with one set of settings."""

    folder: Path

    @classmethod
    def of(cls, working: Path, output: str, mark: Mark) -> "Store":
        """Of a result, in the folder that its job works in."""
        return cls(folder=working / FOLDER / fingerprint.of_values({"output": output, **mark.model_dump()})[:16])

    @property
    def working(self) -> Path:
        """The folder that the job works in."""
        return self.folder.parents[1]

    def make(self) -> None:
        """Make the folder; only who takes the chunks over does, so that who comes too late leaves nothing behind."""
        self.folder.mkdir(parents=True, exist_ok=True)

    def put(self, chunk: Chunk, record: str, made_in: Path) -> None:
        """Copy a chunk's files into the store, and then its record (JSON); raises OSError."""
        kept, folder = _Kept(chunk=chunk, record=ChunkRecord.model_validate_json(record)), self._of(chunk)
        folder.mkdir(exist_ok=True)
        for name, digest in kept.record.sha256.items():
            _write(folder / digest, digest, _blocks(made_in / name))
        text = kept.model_dump_json().encode()
        digest = hashlib.sha256(text).hexdigest()
        _write(folder / f"{digest}.json", digest, [text])

    def record(self, chunk: Chunk) -> str | None:
        """The record (JSON) of a chunk that is whole."""
        with contextlib.suppress(FileNotFoundError):
            for path in sorted(self._of(chunk).iterdir()):
                with contextlib.suppress(OSError, ValueError, RecursionError):
                    if (name := _RECORD.fullmatch(path.name)) and _holds(path, name[1]):
                        kept = _Kept.model_validate_json(read_whole(path, most=_MOST_BYTES))
                        if kept.chunk == chunk and self._whole(chunk, kept.record):
                            return kept.record.model_dump_json()
        return None

    def fetch(self, chunk: Chunk, record: str, folder: Path) -> bool:
        """Bring a chunk's files into a folder under their names, if they are whole."""
        kept = ChunkRecord.model_validate_json(record)
        if not self._whole(chunk, kept):
            return False
        folder.mkdir(parents=True, exist_ok=True)
        for name, digest in kept.sha256.items():
            at, held = folder / name, self._of(chunk) / digest
            at.unlink(missing_ok=True)
            try:
                at.hardlink_to(held)
            except OSError:  # another file system, or one without second names
                with naming(at):
                    shutil.copyfile(held, at)
        return True

    def remove(self) -> None:
        """Forget all, once the result is complete."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _of(self, chunk: Chunk) -> Path:
        return self.folder / str(chunk.index)

    def _whole(self, chunk: Chunk, record: ChunkRecord) -> bool:
        """Whether a chunk's files are there and hold what its record says."""
        return all(
            Path(name).name == name and name.strip(".") and _DIGEST.fullmatch(digest) and _holds(self._of(chunk) / digest, digest)
            for name, digest in record.sha256.items()
        )


def in_use(working: Path) -> bool:
    """Whether something is stored for a job."""
    return any((working / FOLDER).rglob("*.json"))


def _write(path: Path, digest: str, blocks: Iterable[bytes]) -> None:
    """Write a file named by its content in its place, never cutting it short: others may be writing the same into it, or reading."""
    if _holds(path, digest):
        return
    with naming(path), os.fdopen(os.open(path, os.O_WRONLY | os.O_CREAT | getattr(os, "O_BINARY", 0), 0o666), "wb") as file:
        for block in blocks:
            file.write(block)
        file.truncate()
        file.flush()
        os.fsync(file.fileno())


def _holds(path: Path, digest: str) -> bool:
    try:
        return path.is_file() and sha256(path) == digest
    except OSError:
        return False


def _blocks(path: Path) -> Iterator[bytes]:
    with path.open("rb") as file:
        while block := file.read(_BLOCK):
            yield block
