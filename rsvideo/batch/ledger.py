"""What is done, kept on disk so that a job goes on after whatever ended it; and one run a job at a time."""

import contextlib
import errno
import hashlib
import json
import os
import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from rsvideo.config.files import sha256
from rsvideo.pipeline.pieces import Chunk

_VERSION = 2
_TABLES = """
CREATE TABLE clip (output TEXT PRIMARY KEY, settings TEXT NOT NULL, source TEXT NOT NULL, chunks TEXT, result TEXT, ends TEXT);
CREATE TABLE chunk (output TEXT NOT NULL, number INTEGER NOT NULL, record TEXT NOT NULL, PRIMARY KEY (output, number));
"""


class BusyError(Exception):
    """Another run works on this job."""


@dataclass(frozen=True, kw_only=True)
class Entry:
    """What the ledger holds of a photograph or clip."""

    settings: str  # fingerprints
    source: str
    chunks: tuple[Chunk, ...] | None  # where the clip is cut, once that is found
    publishing: bool  # the output was about to appear, or has
    result: dict[str, Any] | None  # once the output is complete


@dataclass(frozen=True, kw_only=True, eq=False)
class Ledger:
    """An open ledger. As long as it is open nobody else can open it; every change is on the disk when its method returns."""

    folder: Path
    database: sqlite3.Connection

    def place(self, output: str) -> Path:
        """The folder that keeps a clip's chunks."""
        return self.folder / hashlib.sha256(output.encode("utf-8", "surrogateescape")).hexdigest()[:16]

    def entry(self, output: str) -> Entry | None:
        """What is kept of a source."""
        found = self._do("SELECT settings, source, chunks, ends, result FROM clip WHERE output = ?", _key(output))
        if not found:
            return None
        settings, source, chunks, ends, result = found[0]
        return Entry(
            settings=settings,
            source=source,
            chunks=None if chunks is None else tuple(Chunk(**chunk) for chunk in json.loads(chunks)),
            publishing=ends is not None,
            result=None if result is None else json.loads(result),
        )

    def ours(self, output: str) -> bool:
        """Whether an output of that name was written by this job."""
        return (entry := self.entry(output)) is not None and entry.publishing

    def records(self, output: str) -> dict[int, str]:
        """The records of those chunks whose files are there and hold what was written into them."""
        found = self._do("SELECT number, record FROM chunk WHERE output = ?", _key(output))
        return {number: record for number, record in found if _holds(self.place(output), json.loads(record))}

    def begin(self, output: str, settings: str, source: str) -> None:
        """Forget what is kept of a source, and begin anew."""
        shutil.rmtree(self.place(output), ignore_errors=True)
        self._do("DELETE FROM chunk WHERE output = ?", _key(output))
        self._do(
            "INSERT INTO clip (output, settings, source) VALUES (?, ?, ?) ON CONFLICT (output)"
            " DO UPDATE SET settings = excluded.settings, source = excluded.source, chunks = NULL, result = NULL",
            _key(output), settings, source,
        )  # fmt: skip

    def cut(self, output: str, chunks: Sequence[Chunk]) -> None:
        """Note where a clip is cut."""
        self._do("UPDATE clip SET chunks = ? WHERE output = ?", json.dumps([asdict(chunk) for chunk in chunks]), _key(output))

    def keep(self, output: str, number: int, record: str, made_in: Path) -> None:
        """Take over a chunk's files from the folder they were made in, and note its record."""
        for name in json.loads(record)["sha256"]:
            (made_in / name).replace(self.place(output) / name)
        self._do("INSERT OR REPLACE INTO chunk VALUES (?, ?, ?)", _key(output), number, record)

    def publishing(self, output: str) -> None:
        """Note that an output under this name will be ours."""
        self._do("UPDATE clip SET ends = 'ours' WHERE output = ?", _key(output))

    def done(self, output: str, result: dict[str, Any]) -> None:
        """Note that a clip is complete; its chunks are not needed any more."""
        self._do("UPDATE clip SET result = ? WHERE output = ?", json.dumps(result), _key(output))
        shutil.rmtree(self.place(output), ignore_errors=True)

    def counts(self) -> tuple[int, int]:
        """How many clips and how many chunks are kept."""
        ((clips,),) = self._do("SELECT count(*) FROM clip WHERE result IS NOT NULL")
        ((chunks,),) = self._do("SELECT count(*) FROM chunk JOIN clip USING (output) WHERE result IS NULL")
        return clips, chunks

    @property
    def empty(self) -> bool:
        """Whether nothing would be lost without it."""
        return not self._do("SELECT 1 FROM clip WHERE ends IS NOT NULL UNION SELECT 1 FROM chunk")

    def remove(self) -> None:
        """The job is done: nothing needs to be kept."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _do(self, command: str, *values: object) -> list[tuple]:
        try:
            return self.database.execute(command, values).fetchall()
        except sqlite3.OperationalError as error:
            raise _not_written(error, _file(self.folder)) from error


@contextlib.contextmanager
def opened(folder: Path, *, fresh: bool = False) -> Iterator[tuple[Ledger, tuple[str, ...]]]:
    """The ledger in a folder, made if there is none, and what the user should know of it.

    A ledger that is damaged or of another version is begun anew, `fresh` begins anew in any case. Raises BusyError.
    The folder goes when there is nothing in it worth keeping.
    """
    folder.mkdir(parents=True, exist_ok=True)
    notes: tuple[str, ...] = ()
    try:
        database = _locked(_file(folder), fresh=fresh)
    except sqlite3.DatabaseError as error:
        notes = (f"the ledger in {folder} is damaged ({error}); all its clips are done anew",)
        for part in (_file(folder), _file(folder).with_name(_file(folder).name + "-journal")):
            part.unlink(missing_ok=True)
        database = _locked(_file(folder), fresh=True)
    with contextlib.closing(database):
        ledger = Ledger(folder=folder, database=database)
        ours = {ledger.place(output.decode("utf-8", "surrogateescape")) for (output,) in database.execute("SELECT output FROM clip")}
        for left in [each for each in folder.iterdir() if each.is_dir()]:  # by a run that was ended, perhaps while it worked
            for unfinished in left.glob("run-*") if left in ours else [left]:
                shutil.rmtree(unfinished, ignore_errors=True)
        try:
            yield ledger, notes
        finally:
            with contextlib.suppress(OSError):
                if ledger.empty:
                    ledger.remove()


def _locked(path: Path, *, fresh: bool) -> sqlite3.Connection:
    database = sqlite3.connect(path, timeout=0, isolation_level=None)
    try:
        database.execute("PRAGMA locking_mode = EXCLUSIVE")
        database.execute("PRAGMA journal_mode = DELETE")
        database.execute("PRAGMA synchronous = FULL")
        database.execute("BEGIN EXCLUSIVE")
        ((version,),) = database.execute("PRAGMA user_version")
        if version not in (0, _VERSION) or database.execute("PRAGMA quick_check").fetchall() != [("ok",)]:
            raise sqlite3.DatabaseError(f"its version is {version}")
        if fresh or version == 0:
            for name in ("clip", "chunk"):
                database.execute(f"DROP TABLE IF EXISTS {name}")
            for command in filter(str.strip, _TABLES.split(";")):
                database.execute(command)
            database.execute(f"PRAGMA user_version = {_VERSION}")
        database.execute("COMMIT")  # the lock stays, that is what the locking mode means
    except BaseException as error:
        database.close()
        if isinstance(error, sqlite3.OperationalError):
            if error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
                raise BusyError(f"another run works on this job already (it holds {path}); wait for it, or stop it first") from error
            raise _not_written(error, path) from error
        raise
    return database


def _not_written(error: sqlite3.OperationalError, path: Path) -> OSError:
    code = errno.ENOSPC if error.sqlite_errorcode == sqlite3.SQLITE_FULL else errno.EIO
    return OSError(code, os.strerror(code) if code == errno.ENOSPC else str(error), str(path))


def _holds(place: Path, record: dict[str, Any]) -> bool:
    try:
        return all(Path(name).name == name and sha256(place / name) == held for name, held in record["sha256"].items())
    except OSError:
        return False


def _file(folder: Path) -> Path:
    return folder / "ledger.sqlite"


def _key(output: str) -> bytes:
    return output.encode("utf-8", "surrogateescape")  # a file's name may be no text
