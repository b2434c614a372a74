"""The folders that were opened, and what stands in them: nothing outside of them is shown, read for a page, or written."""

import contextlib
import os
import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Literal

from rsvideo.config import media
from rsvideo.config.files import UnreadableError
from rsvideo.config.placing import real
from rsvideo.config.printable import printable

MOST_LISTED = 5000  # names of a folder
DEEPEST = 3  # folders within each other in which jobs and reports are looked for
MOST_SEARCHED = 20_000  # names that are passed in that search
PHOTOGRAPHS = (".png", ".tif", ".tiff", ".jpg", ".jpeg", ".dng", ".nef", ".cr2", ".cr3", ".arw", ".raf", ".orf", ".rw2", ".pef", ".srw")
JOBS = (".yaml", ".yml")
SIDECAR = ".rsvideo.json"
_PLAIN = re.compile(r"[^\x00-\x1f/\\:*?\"<>|.][^\x00-\x1f/\\:*?\"<>|]{0,120}")

Kind = Literal["folder", "clip", "photograph", "sequence", "job", "report"]


class OutsideError(Exception):
    """A path leads out of the folders that were opened."""


@dataclass(frozen=True, kw_only=True)
class Name:
    """Something in a folder that a page leads to."""

    kind: Kind
    name: str
    at: str  # as `Opened.path` takes it
    bytes: int = 0
    changed: float = 0.0  # seconds since 1970
    result: bool = False  # whether it was made by rsvideo: its sidecar stands beside it


@dataclass(frozen=True, kw_only=True)
class Opened:
    """Folders, by their numbers. A place in one is written `NUMBER/path/within/it`."""

    folders: tuple[Path, ...]  # without links
    start: str  # the place whose page is opened first

    @classmethod
    def of(cls, *folders: Path, later: tuple[Path, ...] = (), start: Path | None = None) -> "Opened":
        """Folders that exist, and some that may come `later`, each once; `start` lies in one of them."""
        for folder in folders:
            if not folder.is_dir():
                raise UnreadableError(f"{folder} is no folder; give a folder with clips, or a job's file")
        reals = list(dict.fromkeys(real(folder) for folder in (*folders, *later)))
        kept = tuple(each for each in reals if not any(other in each.parents for other in reals))
        opened = cls(folders=kept, start="0/")
        return opened if start is None else cls(folders=kept, start=opened.at(start))

    def path(self, at: str) -> Path:
        """The path of a place; OutsideError where it is none in these folders, by `..` or by a link."""
        number, _, rest = at.partition("/")
        if not (number.isascii() and number.isdecimal() and len(number) < 4 and int(number) < len(self.folders)) or "\0" in rest:
            raise OutsideError("this address names no folder that was opened; go back to the list of clips")
        folder = self.folders[int(number)]
        path = real(folder / rest.lstrip("/"))
        if path != folder and folder not in path.parents:
            raise OutsideError("this lies outside of the folders that were opened; open its own folder with rsvideo view FOLDER")
        return path

    def at(self, path: Path) -> str:
        """The place of a path; OutsideError where it lies elsewhere."""
        path = real(path)
        for number, folder in enumerate(self.folders):
            if path == folder:
                return f"{number}/"
            if folder in path.parents:
                return f"{number}/{path.relative_to(folder).as_posix()}"
        raise OutsideError(f"{path.name} lies outside of the folders that were opened; open its own folder with rsvideo view FOLDER")

    def holds(self, path: Path) -> bool:
        """Whether a path lies in these folders."""
        with contextlib.suppress(OutsideError):
            self.at(path)
            return True
        return False

    def listed(self, at: str) -> tuple[list[Name], bool]:
        """What stands in a folder, and whether names were left out; nothing is opened for it."""
        folder = self.path(at)
        if not folder.is_dir():
            raise UnreadableError(f"{folder.name} is no folder; go back to the list of clips")
        prefix = self.at(folder).rstrip("/")
        with os.scandir(folder) as entries:
            found = list(islice(entries, MOST_LISTED + 1))
        sidecars = {entry.name.removesuffix(SIDECAR) for entry in found if entry.name.endswith(SIDECAR)}
        names = [name for entry in found[:MOST_LISTED] if (name := self._named(entry, prefix, sidecars))]
        order = {"job": 0, "report": 1, "folder": 2}
        return sorted(names, key=lambda name: (order.get(name.kind, 3), name.name.casefold())), len(found) > MOST_LISTED

    def _named(self, entry: os.DirEntry[str], prefix: str, sidecars: set[str]) -> Name | None:
        if entry.name.startswith(".") or not _is_text(entry.name):
            return None
        path = Path(entry.path)
        try:
            if entry.is_symlink() and not self.holds(path):
                return None
            stat, is_folder = entry.stat(), entry.is_dir()
        except OSError:
            return None
        kind = _kind_of_folder(path) if is_folder else _kind_of_file(path)
        if kind is None:
            return None
        made = (entry.name if is_folder else path.stem) in sidecars
        return Name(kind=kind, name=entry.name, at=f"{prefix}/{entry.name}", bytes=stat.st_size, changed=stat.st_mtime, result=made)

    def below(self, *, deepest: int = DEEPEST) -> Iterator[Path]:
        """Files and folders within the folders, nearest first, as far as they are searched; hidden folders are given, not entered."""
        left, level = MOST_SEARCHED, list(self.folders)
        for _ in range(deepest):
            deeper: list[Path] = []
            for folder in level:
                with contextlib.suppress(OSError), os.scandir(folder) as entries:
                    for entry in islice(entries, max(0, left)):
                        left -= 1
                        if not entry.is_symlink() and _is_text(entry.name):
                            yield Path(entry.path)
                            if entry.is_dir() and not entry.name.startswith("."):
                                deeper.append(Path(entry.path))
            level = deeper


def _kind_of_folder(path: Path) -> Kind:
    if (path / "index.html").is_file() and (path / "report.json").is_file():
        return "report"
    with contextlib.suppress(OSError), os.scandir(path) as entries:
        for entry in islice(entries, 3):
            if Path(entry.name).suffix.lower() in (".dng", ".exr"):
                return "sequence"
    return "folder"


def _kind_of_file(path: Path) -> Kind | None:
    suffix = path.suffix.lower()
    if suffix in media.CLIP_SUFFIXES:
        return "clip"
    if suffix in PHOTOGRAPHS:
        return "photograph"
    return "job" if suffix in JOBS else None


def is_plain(name: str) -> bool:
    """Whether a file may get this name from a page: no system and no reader takes it for anything else."""
    return printable(name) == name and _PLAIN.fullmatch(name) is not None


def _is_text(name: str) -> bool:
    """Whether a name can stand in an address: its bytes are text."""
    return not any("\ud800" <= letter <= "\udfff" for letter in name)
