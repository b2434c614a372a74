"""Pieces of work on a photograph or a clip, and what comes of them."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from pydantic import BaseModel

from rsvideo.config.files import UnreadableError, opened
from rsvideo.config.placing import Made
from rsvideo.config.sidecar import FrameRecord, Mark, Written
from rsvideo.frame import Verdict
from rsvideo.progress import Progress


@dataclass(frozen=True, kw_only=True)
class Chunk:
    """Frames first to last, both included, restored with `warm_up` frames before them in view."""

    index: int
    first: int
    last: int
    warm_up: int

    @property
    def frames(self) -> int:
        """How many are restored."""
        return self.last - self.first + 1

    def done(self, at: Progress) -> float:
        """How many of its frames are done, while one of them is worked on; none while it warms up."""
        return max(0.0, (self.first if at.frame is None else at.frame) - self.first + at.fraction)


class ChunkRecord(BaseModel):
    """A chunk that was restored: the files that hold its frames, and a line on what became of each."""

    pictures: str
    frames: str
    sha256: dict[str, str]  # of both, by their names
    left_out: tuple[int, ...] = ()  # frames that could not be decoded and were to be skipped
    notes: tuple[str, ...] = ()  # what the pictures could not keep


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """What became of a photograph or a clip."""

    notes: tuple[str, ...]
    restored: int = 0
    left: int = 0
    straightened: int = 0  # of those that are left: not deblurred, but straightened
    failed: int = 0  # frames that could not be decoded as they were meant
    seconds: float
    verdict: Verdict | None = None  # of a photograph

    @property
    def summary(self) -> str:
        """In words."""
        if self.verdict is not None:
            return f"{self.verdict}, {self.seconds:.1f} s"
        straightened = f"{self.straightened} only straightened, " if self.straightened else ""
        untouched = f"{self.left - self.straightened} left as they were"
        return f"{self.restored} frames restored, {straightened}{untouched}, {self.failed} failed, {self.seconds:.0f} s"


@dataclass(frozen=True, kw_only=True)
class Finished:
    """A result that is complete but for its names, the sidecar last among what was made."""

    outcome: Outcome
    made: tuple[Made, ...]


def stated(outcome: Outcome, made: Iterable[Made], mark: Mark | None) -> Written:
    """What the sidecar is to say of the files that were made with it."""
    return Written(
        sha256={each.path.name: each.sha256 for each in made},
        restored=outcome.restored,
        left=outcome.left,
        failed=outcome.failed,
        seconds=outcome.seconds,
        notes=outcome.notes,
        mark=mark,
    )


def check_cover(indices: Iterable[int], first: int, last: int, source: Path) -> None:
    """Refuse pieces that do not hold the frames first to last - 1 of a source, each once; ValueError."""
    held = sorted(indices)
    if held != list(range(first, last)):
        raise ValueError(f"the pieces of {source} must hold its frames {first} to {last - 1}, each once; they hold {len(held)} frames")


def frame_records(records: Iterable[ChunkRecord], folder: Path) -> Iterator[FrameRecord]:
    """What became of the frames, one after the other; raises UnreadableError."""
    for record in records:
        path = folder / record.frames
        try:
            with opened(path) as file:
                for line in file:
                    yield FrameRecord.model_validate_json(line)
        except (OSError, ValueError) as error:
            raise UnreadableError(f"{path} is damaged: {error}") from error
