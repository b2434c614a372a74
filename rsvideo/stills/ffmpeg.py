"""The errors that FFmpeg reports while it works, and planes of its frames as arrays."""

import contextlib
from collections.abc import Iterator, Sequence

import av.logging
import numpy as np
from av.video.frame import VideoFrame


@contextlib.contextmanager
def watched() -> Iterator[list[str]]:
    """The errors that FFmpeg reports meanwhile, and what it conceals, one line each; complete at the end."""
    before, repeated = av.logging.get_level(), av.logging.get_skip_repeated()
    av.logging.set_level(av.logging.INFO)
    av.logging.set_skip_repeated(False)
    errors: list[str] = []
    try:
        with av.logging.Capture() as log:
            try:
                yield errors
            finally:
                errors.extend(line.strip() for level, _, line in log if level <= av.logging.ERROR or line.startswith("concealing"))
    finally:
        av.logging.set_level(before)
        av.logging.set_skip_repeated(repeated)


def arrays(frame: VideoFrame, kind: np.dtype, count: int) -> tuple[np.ndarray, ...]:
    """The first planes of a frame, copied."""
    planes = []
    for plane in frame.planes[:count]:
        lines = np.frombuffer(memoryview(plane), np.uint8).reshape(-1, plane.line_size)[: plane.height]
        planes.append(np.ascontiguousarray(lines[:, : plane.width * kind.itemsize]).view(kind))
    return tuple(planes)


def fill(frame: VideoFrame, planes: Sequence[np.ndarray]) -> None:
    """Copy arrays into the planes of a frame that was just made."""
    for target, plane in zip(frame.planes, planes, strict=True):
        lines = np.frombuffer(memoryview(target), np.uint8).reshape(-1, target.line_size)
        data = np.ascontiguousarray(plane).view(np.uint8)
        lines[: data.shape[0], : data.shape[1]] = data
