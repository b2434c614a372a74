"""Which results are a job's own: those that its ledger names, and those whose sidecar states the job, the input and the content."""

import os
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from rsvideo.batch.ledger import Entry, Ledger
from rsvideo.batch.places import Place
from rsvideo.config import sidecar
from rsvideo.config.placing import real
from rsvideo.config.printable import in_unicode
from rsvideo.config.sidecar import Mark, Written

if TYPE_CHECKING:
    from rsvideo.batch.plan import Item


def relative(path: Path, folder: Path) -> str:
    """The path from a folder to a file: the same when both are moved together."""
    return in_unicode(os.path.relpath(real(path), real(folder)))


def owned(item: "Item", job: str, ledger: Ledger) -> Entry | None:
    """What the ledger holds of an item, if it is of the same input; of a ledger that was recovered, what the sidecar states."""
    if (entry := ledger.entry(item.request.output.name)) is not None:
        return entry if entry.input == item.input else None
    if not ledger.recovered or (stated := _stated(item, job)) is None:
        return None
    ours = (*stated.sha256.values(), *digests(item.results, [item.request.record.name]))
    return Entry(input=item.input, settings=None, source=None, ours=ours)


def may_replace(item: "Item", job: str, ledger: Ledger) -> bool:
    """Whether all that stands under an item's names was written by the job from this input."""
    entry = owned(item, job, ledger)
    there = [path.name for path in item.request.files if item.results.stamp(path.name) is not None]
    return entry is not None and all(_is_ours(item.results, name, entry) for name in there)


def finished(item: "Item", mark: Mark) -> Written | None:
    """What the sidecar states of a result, if it is the one that a mark is of, and all of it is there."""
    found = _stated(item, mark.job)
    names = {in_unicode(path.name): path.name for path in item.request.files}
    if (
        found is None
        or found.mark != mark
        or in_unicode(item.request.output.name) not in found.sha256
        or not found.sha256.keys() <= names.keys()
    ):
        return None
    there = all(item.results.digest(names[name]) == held for name, held in found.sha256.items())
    return found if there else None


def stamps(results: Place, names: Iterable[str]) -> dict[str, tuple[int, int]]:
    """Of files that exist: while they are the same, nobody has touched them."""
    found = {name: results.stamp(name) for name in names}
    return {name: stamp for name, stamp in found.items() if stamp is not None}


def digests(results: Place, names: Iterable[str]) -> tuple[str, ...]:
    """Of what can be read."""
    return tuple(digest for name in names if (digest := results.digest(name)) is not None)


def _stated(item: "Item", job: str) -> Written | None:
    """What the sidecar states, if it says that this job made it from the item's input."""
    with item.results.on_disk(item.request.record.name, most=sidecar.MOST_BYTES) as path:
        found = sidecar.written(path)
    return found if found and found.mark and (found.mark.job, found.mark.input) == (job, item.input) else None


def _is_ours(results: Place, name: str, entry: Entry) -> bool:
    return entry.stamps.get(name) == results.stamp(name) or results.digest(name) in entry.ours
