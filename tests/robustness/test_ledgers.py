"""Ledgers that are damaged, empty, foreign or of another version: the job goes on to the same bytes, or says clearly why it does not."""

import random
import sqlite3
import string
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.robustness import jobs

COUNT = 60

Damage = Callable[[Path, random.Random], None]


def rewritten(path: Path, change: Callable[[sqlite3.Connection], object]) -> None:
    with sqlite3.connect(path) as database:
        change(database)
    database.close()


def digits(path: Path, chance: random.Random) -> None:
    """One digit of one row changes, as when a bit is lost."""

    def change(database: sqlite3.Connection) -> None:
        table, column = chance.choice([("clip", "entry"), ("chunk", "record")])
        row, text = chance.choice(database.execute(f"SELECT rowid, {column} FROM {table}").fetchall())
        at = chance.choice([k for k, letter in enumerate(text) if letter.isdigit()])
        other = chance.choice([digit for digit in string.digits if digit != text[at]])
        database.execute(f"UPDATE {table} SET {column} = ? WHERE rowid = ?", (text[:at] + other + text[at + 1 :], row))

    rewritten(path, change)


def rows(path: Path, chance: random.Random) -> None:
    """Rows are removed, exchanged or moved to another clip."""
    commands = (
        "DELETE FROM clip WHERE rowid = (SELECT max(rowid) FROM clip)",
        "DELETE FROM clip",
        "DELETE FROM chunk WHERE number = 0",
        "UPDATE chunk SET number = number + 10",
        "UPDATE clip SET output = CAST('other.mp4' AS BLOB) WHERE rowid = 1",
        "UPDATE clip SET entry = (SELECT entry FROM clip ORDER BY rowid DESC LIMIT 1)",
        "UPDATE clip SET entry = '{}'",
        "UPDATE clip SET entry = x'00ff' WHERE rowid = 1",
        "UPDATE chunk SET record = ''",
    )
    rewritten(path, lambda database: database.execute(chance.choice(commands)))


def cut_short(path: Path, chance: random.Random) -> None:
    data = path.read_bytes()
    path.write_bytes(data[: chance.randrange(1, len(data))])


def bytes_changed(path: Path, chance: random.Random) -> None:
    data = bytearray(path.read_bytes())
    for _ in range(chance.randrange(1, 30)):
        data[chance.randrange(len(data))] = chance.randrange(256)
    path.write_bytes(data)


def empty(path: Path, chance: random.Random) -> None:
    path.write_bytes(b"")


def noise(path: Path, chance: random.Random) -> None:
    path.write_bytes(chance.randbytes(chance.randrange(1, 20_000)))


def foreign(path: Path, chance: random.Random) -> None:
    """A database of another program's."""
    path.unlink()
    version = chance.choice([0, 2, 3, 7])
    rewritten(
        path, lambda d: d.executescript(f"CREATE TABLE clip (a, b, c); INSERT INTO clip VALUES (1, 2, 3); PRAGMA user_version = {version}")
    )


def tables(path: Path, chance: random.Random) -> None:
    """A table is gone, or has another column, or does something of its own."""
    commands = (
        "DROP TABLE chunk",
        "ALTER TABLE clip ADD COLUMN more TEXT",
        "ALTER TABLE clip RENAME COLUMN entry TO other",
        "CREATE TRIGGER t AFTER UPDATE ON clip BEGIN DELETE FROM clip; END",
    )
    rewritten(path, lambda database: database.execute(chance.choice(commands)))


def version(path: Path, chance: random.Random) -> None:
    rewritten(path, lambda database: database.execute(f"PRAGMA user_version = {chance.choice([1, 2, 4, 99])}"))


KINDS: tuple[Damage, ...] = (digits, rows, cut_short, bytes_changed, empty, noise, foreign, tables, version)


def goes_on(job: Path, whole: jobs.Files, damage: Damage, chance: random.Random) -> str:
    """How a job ends whose ledger is damaged when one of its clips is unfinished."""
    before = jobs.results(job)
    (ledger,) = job.parent.rglob("ledger.sqlite")
    damage(ledger, chance)
    words = ["--fresh"] if chance.random() < 0.3 else []
    done = jobs.run(job, *words)
    jobs.check_pairs(job, whole)
    assert before.keys() <= jobs.results(job).keys()
    if done.returncode == 0:
        assert jobs.results(job) == whole
        assert not jobs.left_behind(job)
        return "the same bytes"
    jobs.check_one_line(done)
    return "one clear line"


def test_a_job_goes_on_after_damage_to_its_ledger(tmp_path: Path, halted: Path, whole: jobs.Files) -> None:
    assert goes_on(jobs.copied(halted, tmp_path / "job"), whole, digits, random.Random(1)) == "the same bytes"


@pytest.mark.long
@pytest.mark.parametrize("seed", range(COUNT))
def test_ledgers_that_are_damaged_at_random(
    tmp_path: Path, halted: Path, whole: jobs.Files, seed: int, record_property: Callable[[str, object], None]
) -> None:
    damage = KINDS[seed % len(KINDS)]
    record_property("ends", goes_on(jobs.copied(halted, tmp_path / "job"), whole, damage, random.Random(seed)))
