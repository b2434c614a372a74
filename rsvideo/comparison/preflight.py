"""What can be refused before methods work for minutes: requests that cannot be met, truths and crops that do not fit the input."""

from collections.abc import Sequence
from pathlib import Path

from rsvideo.comparison import decoded, method_run
from rsvideo.comparison.decoded import Source
from rsvideo.config.files import UnreadableError
from rsvideo.config.media import is_pattern
from rsvideo.config.request import Request
from rsvideo.stills import still
from rsvideo.video import decode

Box = tuple[int, int, int, int]  # x, y, width and height in pixels of the picture as it is shown
_SMALLEST_CROP = 8  # px a side; less cannot be recognised


def settled(requests: Sequence[Request], truth: Path | None, crops: Sequence[Box]) -> list[Request]:
    """The requests, with every question answered before the work; raises ValueError or UnreadableError for what cannot be."""
    first = requests[0]
    if not first.source.exists() and not is_pattern(first.source):
        raise UnreadableError(f"{first.source} does not exist; is its name mistyped?")
    answered, found = list[Request](), None
    for request in requests:
        answered.append(method_run.settled(request.replaced(measured=found)))
        found = answered[-1].measured
    answered = [request.replaced(measured=found) for request in answered]  # so that methods differ, and not shutters
    if truth is not None or crops:
        source = decoded.source(first)
        if truth is not None:
            _check_truth(first, source, truth)
        _check_crops(crops, source)
    return answered


def _check_truth(request: Request, source: Source, truth: Path) -> None:
    """Refuse a truth that is of another size or length than the input."""
    rows, cols = source.stored
    if request.is_clip:
        stream = decode.probe(truth, request.input.frame_rate)
        their_rows, their_cols, frames = stream.rows, stream.cols, stream.frames
    else:
        (their_rows, their_cols), frames = still.read(truth, request.camera.transfer).pixels.shape[:2], 1
    if (rows, cols) != (their_rows, their_cols):
        raise ValueError(f"the truth must be of the input's size, {cols} x {rows}, {truth} is {their_cols} x {their_rows}")
    if frames not in (source.frames, source.last - source.first):
        raise ValueError(f"the truth must have as many frames as the input, {source.frames}, {truth} has {frames}")


def _check_crops(crops: Sequence[Box], source: Source) -> None:
    """Refuse crops that reach beyond the picture as it is shown."""
    for x, y, w, h in crops:
        if min(w, h) < _SMALLEST_CROP or min(x, y) < 0 or x + w > source.cols or y + h > source.rows:
            raise ValueError(
                f"crop must lie within the picture of {source.cols} x {source.rows} px and be {_SMALLEST_CROP} px or more a side,"
                f" got {x},{y},{w},{h}"
            )
