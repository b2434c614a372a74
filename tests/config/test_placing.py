import errno
import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from rsvideo.config import placing
from rsvideo.config.placing import Made, aside, place


def made(folder: Path, path: Path, data: bytes) -> Made:
    (folder / path.name).write_bytes(data)
    return Made(at=folder / path.name, path=path)


def content(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_all_get_their_names_or_what_stood_there_stays(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"older")
    (tmp_path / "c").mkdir()
    with aside(tmp_path) as folder:
        several = [made(folder, tmp_path / name, b"new") for name in ("a", "b", "c")]
        with pytest.raises(OSError, match="directory") as caught:
            place(several)
    assert caught.value.filename == str(tmp_path / "c")
    assert content(tmp_path) == {"a": b"older"}
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "c"]


def test_where_files_have_one_name_only_what_stood_there_stays_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refused(*_: object, **__: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "link", refused)
    test_all_get_their_names_or_what_stood_there_stays(tmp_path)


def test_a_link_is_replaced_and_not_what_it_leads_to(tmp_path: Path) -> None:
    (tmp_path / "mine").write_bytes(b"mine")
    (tmp_path / "out").symlink_to(tmp_path / "mine")
    with aside(tmp_path) as folder:
        place([made(folder, tmp_path / "out", b"new")])
    assert content(tmp_path) == {"mine": b"mine", "out": b"new"}
    assert not (tmp_path / "out").is_symlink()


def test_a_folder_takes_the_place_of_the_files_it_replaces_and_leaves_others(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    for name in ("1", "2", "3", "other"):
        (tmp_path / "out" / name).write_bytes(b"older")
    with aside(tmp_path) as folder:
        (folder / "out").mkdir()
        (folder / "out" / "1").write_bytes(b"new")
        place([Made(at=folder / "out", path=tmp_path / "out", replaced=tuple(tmp_path / "out" / name for name in "123"))])
    assert content(tmp_path) == {"out/1": b"new", "out/other": b"older"}


@pytest.mark.parametrize("sent", placing.SIGNALS)
def test_a_signal_comes_before_or_after_all_names(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sent: signal.Signals) -> None:
    class StoppedError(Exception):
        pass

    def stop(*_: object) -> None:
        raise StoppedError

    rename = Path.rename

    def interrupted(self: Path, target: Path) -> Path:
        os.kill(os.getpid(), sent)
        return rename(self, target)

    before = signal.signal(sent, stop)
    try:
        with aside(tmp_path) as folder:
            several = [made(folder, tmp_path / name, b"new") for name in ("a", "b")]
            monkeypatch.setattr(Path, "rename", interrupted)
            with pytest.raises(StoppedError) as caught:
                place(several)
    finally:
        signal.signal(sent, before)
    assert content(tmp_path) == {"a": b"new", "b": b"new"}
    assert caught.value.__notes__ == ["the result is complete"]


def test_a_signal_is_not_lost_where_names_cannot_be_had(tmp_path: Path) -> None:
    def stop(*_: object) -> None:
        raise KeyboardInterrupt

    def interrupted() -> None:
        with placing.uninterrupted():
            signal.raise_signal(signal.SIGTERM)
            raise OSError

    before = signal.signal(signal.SIGTERM, stop)
    try:
        with pytest.raises(KeyboardInterrupt) as caught:
            interrupted()
    finally:
        signal.signal(signal.SIGTERM, before)
    assert not hasattr(caught.value, "__notes__")


@pytest.mark.parametrize("how", ["name", "link", "hard link", "folder"])
def test_what_is_read_is_not_written(tmp_path: Path, how: str) -> None:
    (tmp_path / "take").mkdir()
    read, written = tmp_path / "take" / "in", tmp_path / "out"
    read.write_bytes(b"mine")
    if how == "link":
        written.symlink_to(read)
    elif how == "hard link":
        written.hardlink_to(read)
    else:
        written = read if how == "name" else read.parent
    with pytest.raises(ValueError, match="which is read"):
        placing.check([written], [read], overwrite=True)


def test_names_must_be_free_apart_and_of_files(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    with pytest.raises(ValueError, match="pipe"):
        placing.check([tmp_path / "pipe"], [], overwrite=True)
    with pytest.raises(ValueError, match="a name of its own"):
        placing.check([tmp_path / "a", tmp_path / "a"], [], overwrite=True)
    (tmp_path / "b").touch()
    with pytest.raises(FileExistsError, match="--overwrite"):
        placing.check([tmp_path / "a", tmp_path / "b"], [], overwrite=False)
    placing.check([tmp_path / "a", tmp_path / "b"], [], overwrite=True)


KILLED = """
import os, signal, sys
from pathlib import Path
from rsvideo.config.placing import aside

with aside(Path(sys.argv[1])) as own:
    (own / "half").write_bytes(b"half")
    for name in sys.argv[2:]:
        (own / name).mkdir()
    os.kill(os.getpid(), signal.SIGKILL)
"""


def died(folder: Path, *keeping: str) -> Path:
    """What a process that was killed while it made something has left."""
    assert subprocess.run([sys.executable, "-c", KILLED, str(folder), *keeping], check=False).returncode == -signal.SIGKILL
    (left,) = folder.glob(".rsvideo-*")
    return left


def test_what_a_killed_process_left_goes_when_the_next_thing_is_made(tmp_path: Path) -> None:
    left = died(tmp_path)
    with aside(tmp_path) as folder:
        assert list(tmp_path.iterdir()) == [folder]
        assert not left.exists()
    assert not list(tmp_path.iterdir())


def test_what_a_process_still_works_on_stays(tmp_path: Path) -> None:
    with aside(tmp_path) as folder:
        with aside(tmp_path):
            pass
        assert folder.exists()


@pytest.mark.parametrize("how", ["somebody's", "an older result", "no locks"])
def test_only_what_is_certainly_dead_and_ours_is_cleared_away(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, how: str) -> None:
    left = died(tmp_path, *([".older"] if how == "an older result" else []))
    match how:
        case "somebody's":
            left.rename(tmp_path / "renamed")
            left.mkdir()
            (left / "half").write_bytes(b"half")
        case "no locks":

            def refused(*_: object) -> None:
                raise OSError(errno.ENOLCK, "no locks")

            monkeypatch.setattr("fcntl.flock", refused)
    with aside(tmp_path):
        pass
    assert (left / "half").read_bytes() == b"half"
