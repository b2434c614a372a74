"""Which sidecars tell how the frames of a clip were judged: its own, those of its restorations, and what was tracked for the page."""

import json
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from hashlib import sha256
from pathlib import Path

from rsvideo.config import sidecar
from rsvideo.config.placing import real
from rsvideo.view.opened import SIDECAR, Opened

_MOST_OPENED = 400
_LONGEST_HEAD = 200_000  # bytes of a sidecar in which its input stands


@dataclass(frozen=True, kw_only=True)
class Found:
    """A sidecar, and what it tells of a clip."""

    path: Path
    what: str
    result: Path | None = None  # the restored clip beside it


def of(clip: Path, opened: Opened, tracks: Path) -> list[Found]:
    """What there is of a clip."""
    found = []
    own = clip.with_name((clip.name if clip.is_dir() else clip.stem) + SIDECAR)
    if own.is_file():
        found.append(Found(path=own, what="how this clip was restored"))
    if (tracked := track_file(clip, tracks)).is_file():
        found.append(Found(path=tracked, what="its motion, found for this page"))
    return [*found, *(each for each in _elsewhere(clip, opened) if each.path != own)]


def track_file(clip: Path, tracks: Path) -> Path:
    """Where the motion of a clip is kept that was found for the page: another one once the clip has changed."""
    stat = clip.stat()
    key = f"{real(clip)} {stat.st_size} {stat.st_mtime_ns}".encode("utf-8", "surrogateescape")
    return tracks / f"{sha256(key).hexdigest()[:24]}{SIDECAR}"


def _elsewhere(clip: Path, opened: Opened) -> Iterator[Found]:
    left = _MOST_OPENED
    for path in opened.below():
        if path.name.endswith(SIDECAR) and path.is_file() and left:
            left -= 1
            if _input(path, clip):
                result = _result(path)
                what = f"of {result.name}" if result else f"of {path.name}"
                yield Found(path=path, what=f"how it was restored, {what}" if result else what, result=result)


def _input(path: Path, clip: Path) -> bool:
    """Whether a sidecar is of a clip: by what its job notes, else by the name of its input."""
    with suppress(OSError, ValueError, RecursionError):
        if (written := sidecar.written(path)) and written.mark:
            return real(path.parent / written.mark.input) == clip
        with path.open("rb") as file:
            head = file.read(_LONGEST_HEAD)
        begin = head.index(b'"input":') + len(b'"input":')
        name, _ = json.JSONDecoder().raw_decode(head[begin:].decode("utf-8", "ignore").lstrip())
        return isinstance(name, str) and Path(name).name == clip.name
    return False


def _result(path: Path) -> Path | None:
    """The clip or photograph that stands beside its sidecar."""
    written = sidecar.written(path)
    for name in written.sha256 if written else ():
        beside = path.parent / name
        if Path(name).name == name and not name.endswith(".gcsv") and beside.exists():
            return beside
    return None
