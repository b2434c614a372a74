"""Previews for the page: one at a time, the newest wins, and those of late are kept, so that a page that comes back finds them."""

import itertools
import secrets
import threading
from dataclasses import dataclass, field
from typing import Any, Literal

from rsvideo.config.request import Measured
from rsvideo.pipeline import processes
from rsvideo.progress import Progress
from rsvideo.view import trial
from rsvideo.view.child import Child, FailedError, ReplacedError, Work
from rsvideo.view.drawing import File
from rsvideo.view.trial import Trial, Tried

SECONDS = 900.0  # that a preview may take
MOST_KEPT = 12
MOST_BYTES = 300_000_000  # of the pictures that are kept
REPLACED = "a newer preview took its place"

State = Literal["waiting", "working", "done", "failed", "replaced"]


@dataclass(kw_only=True, eq=False)
class Preview:
    """One preview, from the wish to its pictures."""

    id: str
    key: object  # equal for equal wishes
    order: Any
    state: State = "waiting"
    stage: str = ""
    fraction: float = 0.0
    error: str = ""
    version: int = 0  # rises with every change
    sizes: dict[str, dict[str, Any]] = field(default_factory=dict)
    pictures: dict[str, File] = field(default_factory=dict)

    def values(self) -> dict[str, Any]:
        """For the page."""
        stated = {"id": self.id, "state": self.state, "stage": self.stage, "fraction": self.fraction, "error": self.error}
        return stated | {"version": self.version, "sizes": self.sizes, "pictures": sorted(self.pictures)}


class Desk:
    """Takes wishes, and has one process carry out the newest."""

    def __init__(self, work: Work = trial.carry_out) -> None:
        self._child = Child(work, threads=processes.cores())
        self._changed = threading.Condition()
        self._kept: dict[str, Preview] = {}  # the latest last
        self._next: Preview | None = None
        self._measured: dict[object, Measured] = {}
        self._closed = False
        self._thread = threading.Thread(target=self._live, daemon=True)
        self._thread.start()

    def warm(self) -> None:
        """Start the process, so that the first preview need not wait for its libraries."""
        threading.Thread(target=self._child.warm, daemon=True).start()

    def want(self, key: object, order: Any) -> Preview:
        """A preview for a wish: one that is there or being made, or a new one, which takes the place of any other."""
        with self._changed:
            for preview in self._kept.values():
                if preview.key == key and preview.state in ("waiting", "working", "done"):
                    if preview.state == "waiting":
                        self._next = preview
                    return preview
            preview = Preview(id=secrets.token_hex(8), key=key, order=order)
            if self._next is not None:
                self._change(self._next, state="replaced", error=REPLACED)
            self._next = preview
            self._kept[preview.id] = preview
            self._forget()
            self._changed.notify_all()
            return preview

    def get(self, id: str) -> Preview:
        """One that is kept; KeyError."""
        return self._kept[id]

    def wait(self, preview: Preview, version: int, seconds: float) -> dict[str, Any]:
        """Its values once they are newer than a version, or as they are after a while."""
        with self._changed:
            self._changed.wait_for(lambda: preview.version > version, timeout=seconds)
            return preview.values()

    def measured(self, key: object) -> Measured | None:
        """What was measured for an earlier preview."""
        return self._measured.get(key)

    def close(self) -> None:
        """End the process."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()
        self._child.close()

    def _live(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._next is not None or self._closed)
                if self._closed or self._next is None:
                    return
                preview, self._next = self._next, None
                self._change(preview, state="working")
            try:
                self._carry_out(preview)
                self._end(preview, "done", "")
            except ReplacedError:
                self._end(preview, "replaced", REPLACED)
            except FailedError as error:
                self._end(preview, "failed", str(error))
            except Exception as error:  # the page gets the words, and the next wish is taken
                self._end(preview, "failed", f"failed while working: {type(error).__name__}")

    def _carry_out(self, preview: Preview) -> None:
        order = preview.order
        for answer in self._child.answers(order, seconds=SECONDS, wanted=lambda: self._next is None and not self._closed):
            with self._changed:
                if isinstance(answer, Progress):
                    self._change(preview, stage=answer.stage, fraction=answer.fraction)
                elif isinstance(answer, Tried):
                    preview.sizes[answer.size] = answer.facts
                    preview.pictures |= {f"{answer.size}-{name}": picture for name, picture in answer.pictures.items()}
                    if isinstance(order, Trial) and answer.measured is not None:
                        self._measured[order.measured_key] = answer.measured
                    self._change(preview)

    def _end(self, preview: Preview, state: State, error: str) -> None:
        with self._changed:
            self._change(preview, state=state, error=error)

    def _change(self, preview: Preview, **changes: Any) -> None:
        """Note changes, and wake whoever waits for them; the lock is held."""
        for name, value in changes.items():
            setattr(preview, name, value)
        preview.version += 1
        self._changed.notify_all()

    def _forget(self) -> None:
        """Keep the latest ones only."""
        ended = [each for each in self._kept.values() if each.state in ("done", "failed", "replaced")]
        size = {each.id: sum(len(data) for _, data in each.pictures.values()) for each in self._kept.values()}
        for each in ended:
            if len(self._kept) <= MOST_KEPT and sum(itertools.compress(size.values(), [n in self._kept for n in size])) <= MOST_BYTES:
                return
            del self._kept[each.id]
