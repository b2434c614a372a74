"""What the entries of a job mean by their sources: files, patterns, and addresses of object storage."""

import glob
import os
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from rsvideo.batch import cache, objects
from rsvideo.config import address, patterns
from rsvideo.config.address import Origin
from rsvideo.config.files import UnreadableError
from rsvideo.config.yaml import ConfigError, Key, Positions, shown

MOST_SOURCES = 10_000


@dataclass(frozen=True, kw_only=True)
class Source:
    """A photograph or clip that an entry means."""

    path: Path  # of an object, where it will be on this machine
    origin: Origin | None = None
    named: bool  # itself, not only by a pattern

    @property
    def parts(self) -> dict[str, str]:
        """Of its name, as patterns for results' names take them."""
        whole = self.path.is_dir()
        stem, ext = (self.path.name, "") if whole else (self.path.stem, self.path.suffix)
        return {"stem": stem, "ext": ext, "folder": self.origin.folder if self.origin else self.path.absolute().parent.name}


def meant(pattern: str, place: Key, positions: Positions) -> Iterator[Source]:
    """The sources that a name or pattern stands for; ConfigError where it cannot be meant, UnreadableError where nothing is there."""
    if not pattern.strip() or "\0" in pattern:
        raise ConfigError(positions.fault(place, f"must name a clip or a photograph, got {shown(pattern)}"))
    found = _objects if address.is_address(pattern) else _files
    try:
        sources = list(islice(found(pattern, positions.path.parent), MOST_SOURCES + 1))
    except UnreadableError as error:
        raise UnreadableError(positions.fault(place, str(error))) from error
    except ValueError as error:
        raise ConfigError(positions.fault(place, str(error))) from error
    if len(sources) > MOST_SOURCES:
        raise ConfigError(positions.fault(place, f"{shown(pattern)} must match at most {MOST_SOURCES} files"))
    yield from sources


def _files(pattern: str, folder: Path) -> Iterator[Source]:
    path = folder / pattern
    if os.path.exists(path):  # noqa: PTH110 # Path.exists raises on a name that is too long
        yield Source(path=path, named=True)
    elif not glob.has_magic(pattern):
        raise UnreadableError(f"{path} does not exist; names are relative to the folder of the job's file")
    else:
        found = sorted(set(islice(patterns.matching(pattern, folder), MOST_SOURCES + 1)))
        if not found:
            raise ValueError(f"nothing in {folder.absolute()} matches {shown(pattern)}")
        for each in found:
            yield Source(path=each, named=False)


def _objects(pattern: str, _: Path) -> Iterator[Source]:
    at = address.parsed(pattern)
    if not at.key:
        raise ValueError(f"{at} must name an object, as in {at}/clip.mp4, or a pattern, as in {at}/*.mp4")
    if (origin := objects.origin(at)) is not None:
        yield Source(path=cache.place_of(origin), origin=origin, named=True)
    elif not glob.has_magic(at.key):
        raise UnreadableError(f"{at} does not exist; folders of pictures are no sources there")
    else:
        found = objects.matching(at, most=MOST_SOURCES)
        if not found:
            raise ValueError(f"nothing matches {shown(pattern)}")
        for origin in found:
            yield Source(path=cache.place_of(origin), origin=origin, named=False)
