"""Names of files by a pattern such as clips/**/*.mp4, within bounds: neither a whole disk nor links in a circle are looked through."""

import fnmatch
import glob
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path, PurePath

MOST_LOOKED_AT = 300_000  # names of files and folders, some seconds of work
DEEPEST = 40  # folders within each other


def matching(pattern: str, folder: Path) -> Iterator[Path]:
    """What a pattern, relative to a folder, stands for, as `glob` has it, but links to folders are not followed by `**`.

    The order is the disk's, and a name may come twice. ValueError where too much has to be looked at.
    """
    parts = PurePath(pattern)
    start = Path(parts.anchor) if parts.anchor else folder
    return _Search(pattern=pattern).within(start, parts.parts[bool(parts.anchor) :], 0)


@dataclass(kw_only=True)
class _Search:
    pattern: str
    looked_at: int = 0

    def within(self, folder: Path, parts: tuple[str, ...], depth: int) -> Iterator[Path]:
        """What the rest of the pattern stands for in one folder."""
        if not parts:
            yield folder
            return
        first, *others = parts
        rest = tuple(others)
        if depth > DEEPEST:
            raise ValueError(f"{self.pattern!r} must lead through at most {DEEPEST} folders within each other, {str(folder)[:60]} are more")
        if first == "**":
            yield from self.within(folder, rest, depth)
            for entry in self.entries(folder, "*"):
                if entry.is_dir(follow_symlinks=False):
                    yield from self.within(folder / entry.name, parts, depth + 1)
                elif not rest:
                    yield folder / entry.name
        elif not glob.has_magic(first):
            if os.path.lexists(folder / first):
                yield from self.within(folder / first, rest, depth + 1)
        else:
            for entry in self.entries(folder, first):
                if not rest or entry.is_dir():
                    yield from self.within(folder / entry.name, rest, depth + 1)

    def entries(self, folder: Path, pattern: str) -> Iterator["os.DirEntry[str]"]:
        """What a folder holds under such names; names that begin with a point are hidden, unless the pattern has it."""
        try:
            with os.scandir(folder) as held:
                for entry in held:
                    self.looked_at += 1
                    if self.looked_at > MOST_LOOKED_AT:
                        raise ValueError(f"{self.pattern!r} must have at most {MOST_LOOKED_AT} files to be looked at, there are more")
                    if fnmatch.fnmatch(entry.name, pattern) and (pattern.startswith(".") or not entry.name.startswith(".")):
                        yield entry
        except OSError:  # it is no folder, or not ours to read
            return
