"""Restored chunks where several machines reach them, until the one that keeps the ledger takes them over.

Each chunk has a folder. Files are named by what they hold, and a chunk's record, which lists its files, is written last. So nobody has
to lock or rename anything: two who restore the same chunk disturb each other nowhere, and what is half-written does not have its hash.
"""

import contextlib
import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from rsvideo.batch.places import Folder, Place
from rsvideo.config.files import UnreadableError
from rsvideo.config.sidecar import Mark
from rsvideo.pipeline import fingerprint
from rsvideo.pipeline.pieces import Chunk, ChunkRecord

FOLDER = "store"  # within the folder that a job works in
_RECORD = re.compile(r"([0-9a-f]{64})\.json")
_DIGEST = re.compile(r"[0-9a-f]{64}")
_MOST_BYTES = 10_000_000  # of a record


class _Kept(BaseModel):
    """What a record's file holds."""

    model_config = ConfigDict(extra="forbid", frozen=True)

    chunk: Chunk
    record: ChunkRecord


@dataclass(frozen=True, kw_only=True)
class Store:
    """The chunks of one photograph or clip, as it is restored with one set of settings."""

    place: Place

    @classmethod
    def of(cls, stores: Place, output: str, mark: Mark) -> "Store":
        """Of a result, in the place that its job has for stores."""
        return cls(place=stores.within(fingerprint.of_values({"output": output, **mark.model_dump()})[:16]))

    @property
    def name(self) -> str:
        """Tells it from the others of its job."""
        return Path(self.place.at()).name

    @property
    def working(self) -> Path | None:
        """The folder that the job works in; None where machines share none."""
        return self.place.path.parents[1] if isinstance(self.place, Folder) else None

    def make(self) -> None:
        """Open it; only who takes the chunks over does, so that who comes too late leaves nothing behind."""
        self.place.make()

    def there(self) -> bool:
        """Whether somebody will take chunks over."""
        return self.place.there()

    def put(self, chunk: Chunk, record: str, made_in: Path) -> None:
        """Copy a chunk's files into the store, and then its record (JSON); raises OSError."""
        kept = _Kept(chunk=chunk, record=ChunkRecord.model_validate_json(record))
        for name, digest in kept.record.sha256.items():
            self.place.put(f"{chunk.index}/{digest}", digest, made_in / name)
        text = kept.model_dump_json().encode()
        digest = hashlib.sha256(text).hexdigest()
        self.place.put(f"{chunk.index}/{digest}.json", digest, text)

    def record(self, chunk: Chunk) -> str | None:
        """The record (JSON) of a chunk that is whole."""
        for name in self.place.within(str(chunk.index)).names():
            kept = self._kept(f"{chunk.index}/{name}", found[1]) if (found := _RECORD.fullmatch(name)) else None
            if kept and kept.chunk == chunk and self._whole(chunk, kept.record):
                return kept.record.model_dump_json()
        return None

    def fetch(self, chunk: Chunk, record: str, folder: Path) -> bool:
        """Bring a chunk's files into a folder under their names, if they are whole."""
        kept = ChunkRecord.model_validate_json(record)
        if not self._whole(chunk, kept):
            return False
        folder.mkdir(parents=True, exist_ok=True)
        whole = [self.place.fetch(f"{chunk.index}/{digest}", digest, folder / name) for name, digest in kept.sha256.items()]
        return all(whole)  # after each was tried, since a place may remove what is not

    def remove(self) -> None:
        """Forget all, once the result is complete."""
        self.place.remove()

    def _kept(self, name: str, digest: str) -> _Kept | None:
        with contextlib.suppress(UnreadableError, ValueError, RecursionError):
            data = self.place.read(name, most=_MOST_BYTES)
            if hashlib.sha256(data).hexdigest() == digest:
                return _Kept.model_validate_json(data)
        return None

    def _whole(self, chunk: Chunk, record: ChunkRecord) -> bool:
        """Whether a chunk's files are there and hold what its record says."""
        return all(
            Path(name).name == name
            and name.strip(".")
            and _DIGEST.fullmatch(digest)
            and self.place.holds(f"{chunk.index}/{digest}", digest)
            for name, digest in record.sha256.items()
        )


def in_use(working: Path) -> bool:
    """Whether something is stored for a job in the folder that it works in."""
    return any((working / FOLDER).rglob("*.json"))
