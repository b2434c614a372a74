"""Which results are a job's own: those that its ledger names, and those whose sidecar states the job, the input and the content."""

import contextlib
import os
from collections.abc import Iterable
from pathlib import Path

from rsvideo.batch.ledger import Entry, Ledger
from rsvideo.config import sidecar
from rsvideo.config.files import digest
from rsvideo.config.placing import real
from rsvideo.config.printable import in_unicode
from rsvideo.config.request import Request
from rsvideo.config.sidecar import Mark, Written


def relative(path: Path, folder: Path) -> str:
    """The path from a folder to a file: the same when both are moved together."""
    return in_unicode(os.path.relpath(real(path), real(folder)))


def owned(request: Request, job: str, ledger: Ledger) -> Entry | None:
    """What the ledger holds of a request, if it is of the same input; of a ledger that was recovered, what the sidecar states."""
    source = relative(request.source, request.output.parent)
    if (entry := ledger.entry(request.output.name)) is not None:
        return entry if entry.input == source else None
    if not ledger.recovered or (stated := _stated(request, job, source)) is None:
        return None
    ours = (*stated.sha256.values(), *digests([request.record]))
    return Entry(input=source, settings=None, source=None, ours=ours)


def may_replace(request: Request, job: str, ledger: Ledger) -> bool:
    """Whether all that stands under a request's names was written by the job from this input."""
    entry = owned(request, job, ledger)
    return entry is not None and all(_is_ours(path, entry) for path in request.files if os.path.lexists(path))


def finished(request: Request, mark: Mark) -> Written | None:
    """What the sidecar states of a result, if it is the one that a mark is of, and all of it is there."""
    found = _stated(request, mark.job, mark.input)
    names = {in_unicode(path.name): path for path in request.files}
    if (
        found is None
        or found.mark != mark
        or in_unicode(request.output.name) not in found.sha256
        or not found.sha256.keys() <= names.keys()
    ):
        return None
    there = all(not names[name].is_symlink() and digests([names[name]]) == (held,) for name, held in found.sha256.items())
    return found if there else None


def stamps(paths: Iterable[Path]) -> dict[str, tuple[int, int]]:
    """Sizes and times of the last change of files that exist: while they are the same, nobody has touched them."""
    found = {}
    for path in paths:
        with contextlib.suppress(OSError):
            stat = path.lstat()
            found[path.name] = (stat.st_size, stat.st_mtime_ns)
    return found


def digests(paths: Iterable[Path]) -> tuple[str, ...]:
    """Of what can be read."""
    found = []
    for path in paths:
        with contextlib.suppress(OSError):
            found.append(digest(path))
    return tuple(found)


def _stated(request: Request, job: str, source: str) -> Written | None:
    """What the sidecar states, if it says that this job made it from this input."""
    found = sidecar.written(request.record)
    return found if found and found.mark and (found.mark.job, found.mark.input) == (job, source) else None


def _is_ours(path: Path, entry: Entry) -> bool:
    if path.is_symlink():
        return False
    (stamp,) = stamps([path]).values() or (None,)
    return entry.stamps.get(path.name) == stamp or any(each in entry.ours for each in digests([path]))
