import contextlib
import hashlib
import os
import resource
from collections.abc import Iterator
from pathlib import Path

import pytest

from rsvideo.config.files import UnreadableError, lines, read_whole, reading, sha256, write_whole


@contextlib.contextmanager
def files_of_at_most_1000_bytes() -> Iterator[None]:
    """A disk that is full, as far as this process can tell; not a fixture, since pytest too may write into a file."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    write_whole({tmp_path / "a": b"one", tmp_path / "b": b"two"})
    assert read_whole(tmp_path / "a", most=10) == b"one"
    assert read_whole(tmp_path / "b", most=10) == b"two"
    assert len(list(tmp_path.iterdir())) == 2


def test_files_are_hashed_one_after_the_other_as_one(tmp_path: Path) -> None:
    for name, data in (("a", b"one"), ("b", b"two"), ("c", b"onetwo")):
        (tmp_path / name).write_bytes(data)
    assert sha256(tmp_path / "a", tmp_path / "b") == sha256(tmp_path / "c") == hashlib.sha256(b"onetwo").hexdigest()


def test_if_one_file_cannot_be_written_none_appears(tmp_path: Path) -> None:
    with files_of_at_most_1000_bytes(), pytest.raises(OSError, match="large") as caught:
        write_whole({tmp_path / "small": b"x", tmp_path / "large": b"x" * 100_000})
    assert caught.value.filename == str(tmp_path / "large")
    assert not list(tmp_path.iterdir())


def test_a_file_may_come_piece_by_piece_and_appears_whole_or_not_at_all(tmp_path: Path) -> None:
    write_whole({tmp_path / "a": iter([b"one ", b"two"])})
    assert (tmp_path / "a").read_bytes() == b"one two"

    def broken() -> Iterator[bytes]:
        yield b"one"
        raise UnreadableError("the rest is damaged")

    with pytest.raises(UnreadableError, match="the rest"):
        write_whole({tmp_path / "b": b"whole", tmp_path / "c": broken()})
    assert [path.name for path in tmp_path.iterdir()] == ["a"]


def test_a_failed_write_leaves_the_older_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "picture"
    path.write_bytes(b"older")
    with files_of_at_most_1000_bytes(), pytest.raises(OSError, match="picture"):
        write_whole({path: b"x" * 100_000})
    assert path.read_bytes() == b"older"
    assert [p.name for p in tmp_path.iterdir()] == ["picture"]


def test_files_that_cannot_be_read_say_why(tmp_path: Path) -> None:
    (tmp_path / "empty").touch()
    (tmp_path / "long").write_bytes(b"x" * 11)
    for name, why in (("absent", "does not exist"), ("empty", "is empty"), ("long", "at most"), ("", "is a folder")):
        with pytest.raises(UnreadableError, match=why):
            read_whole(tmp_path / name, most=10)


def test_what_has_no_end_or_cannot_be_reached_is_refused_without_waiting(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "circle").symlink_to("circle")
    for name, why in (("pipe", "not a file"), ("circle", "symbolic links"), ("x" * 300, "too long"), ("a\0b", "null")):
        with pytest.raises(UnreadableError, match=why):
            read_whole(tmp_path / name, most=10)
    with pytest.raises(UnreadableError, match="not a file"):
        read_whole(Path("/dev/zero"), most=10)
    with pytest.raises(OSError, match="pipe"):
        sha256(tmp_path / "pipe")


def test_lines_come_one_after_the_other_and_are_bounded(tmp_path: Path) -> None:
    path = tmp_path / "log"
    path.write_bytes(b"\xef\xbb\xbfone\r\n\ntwo \xff")
    assert list(lines(path, most=100)) == ["one", "", "two \ufffd"]
    with pytest.raises(UnreadableError, match="at most 1e-05 MB"):
        list(lines(path, most=10))
    path.write_bytes(b"x" * 200_000)
    with pytest.raises(UnreadableError, match=r"log:1: must be at most"):
        list(lines(path, most=10**9))
    path.write_bytes(b"")
    with pytest.raises(UnreadableError, match="is empty"):
        list(lines(path, most=100))


@pytest.mark.parametrize(
    ("raised", "words"),
    [
        (ValueError("must be grey"), "a.png must be grey"),
        (OverflowError("too large"), "a.png is damaged: OverflowError: too large"),
        (AttributeError("no height"), "a.png is damaged: AttributeError"),
        (RecursionError("deep"), "a.png is damaged: RecursionError"),
        (OSError(5, "Input/output error"), "a.png cannot be read: input/output error"),
        (MemoryError(), "a.png needs more memory than there is"),
        (UnreadableError("b.png is empty"), "b.png is empty"),
    ],
)
def test_whatever_a_decoder_raises_is_a_fault_of_its_file(raised: Exception, words: str) -> None:
    with pytest.raises(UnreadableError, match=words), reading(Path("a.png")):
        raise raised
