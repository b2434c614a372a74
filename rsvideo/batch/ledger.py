"""What is done, kept on disk so that a job goes on after whatever ended it; and one run a job at a time.

Every row carries a checksum. What cannot be believed is not used: a row that is damaged is left out, and a file that is no ledger of
this version is moved aside for one that is. Such a ledger is `recovered`: results that it does not name may be the job's own.
"""

import contextlib
import errno
import hashlib
import json
import os
import re
import shutil
import sqlite3
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict

from rsvideo.batch import store
from rsvideo.config.files import sha256
from rsvideo.config.lock import BusyError, locked
from rsvideo.pipeline.pieces import Chunk, ChunkRecord

_VERSION = 3
_TABLES = (
    "CREATE TABLE clip (output BLOB PRIMARY KEY, entry TEXT NOT NULL, checksum TEXT NOT NULL)",
    "CREATE TABLE chunk (output BLOB NOT NULL, number INTEGER NOT NULL, record TEXT NOT NULL, checksum TEXT NOT NULL,"
    " PRIMARY KEY (output, number))",
    "CREATE TABLE recovered (because TEXT NOT NULL)",
)
_PLACE = re.compile(r"[0-9a-f]{16}")  # names of folders that keep chunks
_Model = TypeVar("_Model", bound=BaseModel)


class Entry(BaseModel):
    """What the ledger holds of a photograph or clip."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    input: str  # as in the mark of its job
    settings: str | None  # fingerprints; None: nothing is kept but what follows
    source: str | None
    ours: tuple[str, ...] = ()  # SHA-256 of all that was written under the result's names, or was about to be
    chunks: tuple[Chunk, ...] | None = None  # where the clip is cut, once that is found
    result: dict[str, Any] | None = None  # once the output is complete
    stamps: dict[str, tuple[int, int]] = {}  # of the files that belong to it: size and time of the last change


@dataclass(frozen=True, kw_only=True, eq=False)
class Ledger:
    """An open ledger. As long as it is open nobody else can open it; every change is on the disk when its method returns."""

    folder: Path
    database: sqlite3.Connection
    fresh: bool = False  # what was done is to be done again

    def place(self, output: str) -> Path:
        """The folder that keeps a clip's chunks."""
        return self.folder / hashlib.sha256(_key(output)).hexdigest()[:16]

    def entry(self, output: str) -> Entry | None:
        """What is kept of a source."""
        found = self._do("SELECT entry, checksum FROM clip WHERE output = ?", _key(output))
        return _believed(Entry, found[0][0], found[0][1], _key(output)) if found else None

    def entries(self) -> dict[bytes, Entry]:
        """What is kept of all sources, by their keys."""
        rows = self._do("SELECT output, entry, checksum FROM clip")
        believed = {output: _believed(Entry, text, checksum, output) for output, text, checksum in rows}
        return {output: entry for output, entry in believed.items() if entry is not None}

    def records(self, output: str) -> dict[int, str]:
        """The records of those chunks whose files are there and hold what was written into them."""
        found = self._do("SELECT number, record, checksum FROM chunk WHERE output = ?", _key(output))
        believed = {number: _believed(ChunkRecord, text, checksum, _key(output), number) for number, text, checksum in found}
        return {number: record.model_dump_json() for number, record in believed.items() if record and _holds(self.place(output), record)}

    def begin(self, output: str, entry: Entry) -> None:
        """Forget the chunks that are kept of a source, and begin anew."""
        shutil.rmtree(self.place(output), ignore_errors=True)
        self._do("DELETE FROM chunk WHERE output = ?", _key(output))
        self._put(output, entry)

    def cut(self, output: str, chunks: Sequence[Chunk]) -> None:
        """Note where a clip is cut."""
        self._change(output, chunks=tuple(chunks))

    def keep(self, output: str, number: int, record: str, made_in: Path) -> None:
        """Take over a chunk's files from the folder they were made in, and note its record."""
        for name in json.loads(record)["sha256"]:
            (made_in / name).replace(self.place(output) / name)
        checksum = row_checksum(_key(output), number, record)
        self._do("INSERT OR REPLACE INTO chunk VALUES (?, ?, ?, ?)", _key(output), number, record, checksum)

    def intend(self, output: str, sha256: Sequence[str]) -> None:
        """Note the hashes of files that are about to get their names: from now on they are ours, whatever ends the run."""
        entry = self.entry(output)
        self._change(output, ours=tuple(dict.fromkeys((*(entry.ours if entry else ()), *sha256))))

    def done(self, output: str, result: dict[str, Any], stamps: dict[str, tuple[int, int]]) -> None:
        """Note that a clip is complete; its chunks are not needed any more."""
        self._change(output, result=result, stamps=stamps)
        shutil.rmtree(self.place(output), ignore_errors=True)

    def counts(self) -> tuple[int, int]:
        """How many clips and how many chunks are kept."""
        done = {output: entry.result is not None for output, entry in self.entries().items()}
        chunks = self._do("SELECT output FROM chunk")
        return sum(done.values()), sum(not done.get(output, True) for (output,) in chunks)

    @property
    def recovered(self) -> bool:
        """Whether an earlier ledger was lost, wholly or in part: what it named is recognised by the sidecars."""
        return bool(self._do("SELECT 1 FROM recovered"))

    @property
    def empty(self) -> bool:
        """Whether nothing would be lost without it."""
        kept = any(entry.ours or entry.result for entry in self.entries().values())
        return not (kept or self.recovered or self._do("SELECT 1 FROM chunk") or store.in_use(self.folder))

    def remove(self) -> None:
        """The job is done: nothing needs to be kept."""
        with contextlib.suppress(OSError):  # what is not ours stays, and its folder with it
            for each in self.folder.iterdir():
                if _PLACE.fullmatch(each.name) or each.name == store.FOLDER:
                    shutil.rmtree(each, ignore_errors=True)
                elif each.name.startswith("ledger."):
                    each.unlink()
            self.folder.rmdir()

    def _change(self, output: str, **changes: object) -> None:
        entry = self.entry(output)
        assert entry is not None, "begin comes first"
        self._put(output, entry.model_copy(update=changes))

    def _put(self, output: str, entry: Entry) -> None:
        text = json.dumps(entry.model_dump())  # with names that are no text escaped
        self._do("INSERT OR REPLACE INTO clip VALUES (?, ?, ?)", _key(output), text, row_checksum(_key(output), text))

    def _do(self, command: str, *values: object) -> list[tuple]:
        try:
            return self.database.execute(command, values).fetchall()
        except sqlite3.DatabaseError as error:
            raise _not_written(error, _file(self.folder)) from error


@contextlib.contextmanager
def opened(folder: Path, *, fresh: bool = False) -> Iterator[tuple[Ledger, tuple[str, ...]]]:
    """The ledger in a folder, made if there is none, and what the user should know of it.

    `fresh` forgets what was done, but not which results are the job's own. Raises BusyError; FileExistsError where something else stands
    in its place. The folder goes when there is nothing in it worth keeping.
    """
    file = _file(folder)
    for path, right in ((folder, folder.is_dir()), (file, file.is_file() or not os.path.lexists(file))):
        if os.path.lexists(path) and (path.is_symlink() or not right):
            raise FileExistsError(f"{path} exists already and is not what rsvideo keeps there between two runs; move it out of its place")
    folder.mkdir(parents=True, exist_ok=True)
    with locked(folder):
        database, notes = _database(file)
        with contextlib.closing(database):
            ledger = Ledger(folder=folder, database=database, fresh=fresh)
            if fresh:
                _forget(ledger)
            _tidy(ledger)
            try:
                yield ledger, notes
            finally:
                with contextlib.suppress(OSError):
                    if ledger.empty:
                        ledger.remove()


def _database(path: Path) -> tuple[sqlite3.Connection, tuple[str, ...]]:
    """The ledger in a file as far as it can be believed, and what to say of the rest."""
    if not path.exists():
        return _new(path), ()
    try:
        with contextlib.ExitStack() as stack:
            database = stack.enter_context(contextlib.closing(_connected(path)))
            fault = _fault(database)
            if fault is None:
                lost = _lost_rows(database)
                stack.pop_all()
                return database, (_words(path, f"{lost} of its rows are damaged"),) if lost else ()
    except sqlite3.DatabaseError as error:
        if not _is_damage(error):
            raise _not_written(error, path) from error
        fault = str(error)
    for part in (path, path.with_name(path.name + "-journal")):
        if part.exists():
            part.replace(part.with_name(part.name.replace("sqlite", "damaged")))
    return _new(path, because=fault), (_words(path, fault),)


def _words(path: Path, fault: str) -> str:
    return (
        f"the ledger in {path.parent} is damaged or of another version ({fault}); finished results are recognised by their sidecars,"
        " the rest is done anew"
    )


def _connected(path: Path) -> sqlite3.Connection:
    database = sqlite3.connect(path, timeout=0, isolation_level=None)
    try:
        for command in ("trusted_schema = OFF", "locking_mode = EXCLUSIVE", "journal_mode = DELETE", "synchronous = FULL"):
            database.execute(f"PRAGMA {command}")
        database.execute("BEGIN EXCLUSIVE")
        database.execute("COMMIT")  # the lock stays, that is what the locking mode means
    except BaseException as error:
        database.close()
        if isinstance(error, sqlite3.OperationalError) and error.sqlite_errorcode == sqlite3.SQLITE_BUSY:
            raise BusyError(path) from error
        raise
    return database


def _new(path: Path, *, because: str | None = None) -> sqlite3.Connection:
    """An empty ledger, in place of one that was lost `because`."""
    try:
        with contextlib.ExitStack() as stack:
            database = stack.enter_context(contextlib.closing(_connected(path)))
            database.execute("BEGIN EXCLUSIVE")
            for command in _TABLES:
                database.execute(command)
            if because is not None:
                database.execute("INSERT INTO recovered VALUES (?)", (because,))
            database.execute(f"PRAGMA user_version = {_VERSION}")
            database.execute("COMMIT")
            stack.pop_all()
            return database
    except sqlite3.DatabaseError as error:
        raise _not_written(error, path) from error


def _is_damage(error: sqlite3.DatabaseError) -> bool:
    """Whether an error is the file's, not the disk's or the system's."""
    kinds = (sqlite3.SQLITE_ERROR, sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB, sqlite3.SQLITE_FORMAT, sqlite3.SQLITE_SCHEMA)
    return getattr(error, "sqlite_errorcode", sqlite3.SQLITE_ERROR) & 0xFF in kinds  # the rest says more of the same


def _fault(database: sqlite3.Connection) -> str | None:
    """Why a database is no ledger of this version, if it is none."""
    ((version,),) = database.execute("PRAGMA user_version")
    tables = {text for (text,) in database.execute("SELECT sql FROM sqlite_master WHERE sql IS NOT NULL")}
    if version == 0 and not tables:
        return "it is empty"
    if version != _VERSION:
        return f"its version is {version}, not {_VERSION}"
    if tables != set(_TABLES):
        return "its tables are others"
    checked = database.execute("PRAGMA integrity_check").fetchall()
    return None if checked == [("ok",)] else str(checked[0][0]).splitlines()[-1]


def _lost_rows(database: sqlite3.Connection) -> int:
    """Remove what cannot be believed; how many rows there were of that."""
    clips = database.execute("SELECT output, entry, checksum FROM clip").fetchall()
    chunks = database.execute("SELECT output, number, record, checksum FROM chunk").fetchall()
    good = {output for output, text, checksum in clips if _believed(Entry, text, checksum, output)}
    bad_clips = [output for output, _, _ in clips if output not in good]
    bad_chunks = [
        (output, number)
        for output, number, text, checksum in chunks
        if output not in good or not _believed(ChunkRecord, text, checksum, output, number)
    ]
    if bad_clips or bad_chunks:
        database.execute("BEGIN EXCLUSIVE")
        database.executemany("DELETE FROM clip WHERE output IS ?", [(output,) for output in bad_clips])
        database.executemany("DELETE FROM chunk WHERE output IS ? AND number IS ?", bad_chunks)
        database.execute("INSERT INTO recovered VALUES ('rows')")
        database.execute("COMMIT")
    return len(bad_clips) + len(bad_chunks)


def _forget(ledger: Ledger) -> None:
    """Forget all but which results are ours."""
    shutil.rmtree(ledger.folder / store.FOLDER, ignore_errors=True)
    for output, entry in ledger.entries().items():
        ledger.begin(_name(output), Entry(input=entry.input, settings=None, source=None, ours=entry.ours, stamps=entry.stamps))


def _tidy(ledger: Ledger) -> None:
    """Remove what a run has left that was ended, perhaps while it worked."""
    ours = {ledger.place(_name(output)) for output in ledger.entries()}
    for left in [each for each in ledger.folder.iterdir() if _PLACE.fullmatch(each.name)]:
        for unfinished in left.glob("run-*") if left in ours else [left]:
            shutil.rmtree(unfinished, ignore_errors=True)


def _believed(kind: type[_Model], text: object, checksum: object, *key: object) -> _Model | None:
    """What a row holds, if its checksum agrees and it can be understood."""
    if not (isinstance(text, str) and isinstance(key[0], bytes) and checksum == row_checksum(*key, text)):
        return None
    try:
        return kind.model_validate(json.loads(text))
    except (ValueError, RecursionError):
        return None


def row_checksum(*values: object) -> str:
    """Of a row: its key and what it holds."""
    return hashlib.sha256(repr(values).encode("utf-8", "surrogatepass")).hexdigest()


def _not_written(error: sqlite3.DatabaseError, path: Path) -> OSError:
    code = errno.ENOSPC if getattr(error, "sqlite_errorcode", None) == sqlite3.SQLITE_FULL else errno.EIO
    return OSError(code, os.strerror(code) if code == errno.ENOSPC else str(error), str(path))


def _holds(place: Path, record: ChunkRecord) -> bool:
    try:
        return all(
            Path(name).name == name and (place / name).is_file() and sha256(place / name) == held for name, held in record.sha256.items()
        )
    except OSError:
        return False


def _file(folder: Path) -> Path:
    return folder / "ledger.sqlite"


def _key(output: str) -> bytes:
    return output.encode("utf-8", "surrogateescape")  # a file's name may be no text


def _name(key: bytes) -> str:
    return key.decode("utf-8", "surrogateescape")
