"""The process of a cluster's worker that restores: `python -m rsvideo.batch.errands THREADS [quiet]`.

It reads pickled orders from its parent, which is the only one that can write to it, and answers each with a line of JSON. It ends when
its parent does.
"""

import json
import os
import pickle
import queue
import shutil
import sys
import tempfile
import threading
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

from rsvideo.batch import cache, farm
from rsvideo.batch.workers import Crew, Failed, Restore, failed
from rsvideo.config import placing
from rsvideo.threads import cores


def answered(text: bytes) -> str | Failed:
    """What an answer says: the record of a chunk that is in the store (JSON), or why there is none."""
    stated = json.loads(text)
    if isinstance(stated, str):
        return stated
    disk = stated.pop("disk")
    return Failed(**stated, disk=None if disk is None else tuple(disk))


def main() -> None:
    """Carry orders out until there is nobody left to give one."""
    threads, quiet = min(int(sys.argv[1]), cores()), "quiet" in sys.argv[2:]
    answers = os.fdopen(os.dup(1), "wb", buffering=0)
    os.dup2(2, 1)  # nothing else gets in between the answers
    orders: queue.SimpleQueue[Restore] = queue.SimpleQueue()
    with placing.aside(Path(tempfile.gettempdir())) as folder:
        threading.Thread(target=_listen, args=(orders, folder), daemon=True).start()
        crew = Crew(most=1, threads=threads, quiet=quiet)
        while True:
            answers.write(json.dumps(_answer(orders.get(), crew, folder)).encode() + b"\n")


def _answer(order: Restore, crew: Crew, folder: Path) -> str | dict[str, Any] | None:
    """A chunk's record, once it is in the store, or what went wrong."""
    try:
        if (record := order.store.record(order.chunk)) is not None:
            return record
        request = order.request.replaced(output=folder / order.request.output.name)  # nothing is written there
        if request.origin:
            request = request.replaced(source=cache.bring(request.origin))
        ((_, fault),) = farm.restored({0: replace(order, request=request)}, crew, folder)
        return asdict(fault) if fault else order.store.record(order.chunk)
    except (OSError, ValueError) as error:
        return asdict(failed(error))


def _listen(orders: "queue.SimpleQueue[Restore]", folder: Path) -> None:
    try:
        while True:
            orders.put(pickle.load(sys.stdin.buffer))
    except (EOFError, OSError, pickle.UnpicklingError):
        shutil.rmtree(folder, ignore_errors=True)
        os._exit(0)  # which ends the crew too, whatever it is doing


if __name__ == "__main__":
    main()
