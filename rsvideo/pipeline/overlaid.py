"""Frames with graphics over them: the scene is worked on as if they were not there, and they are laid over the result as they were."""

from collections.abc import Callable, Iterable, Iterator, Sequence

from rsvideo.config.method import Method
from rsvideo.frame import Frame, FrameResult
from rsvideo.pipeline import clip_frames
from rsvideo.pipeline.methods import Treatment
from rsvideo.restoration.overlay import Lifted, Overlay, spread
from rsvideo.video.stream import Colour, Picture


def found(treatment: Treatment, pictures: Sequence[Picture], meaning: Colour) -> Overlay | None:
    """The graphics over pictures in view; None where there are none, or where nothing is done to the scene."""
    if treatment.method is Method.NONE:
        return None
    whole = [picture for picture in pictures if not picture.damaged]
    return Overlay.of(clip_frames.frame(meaning, whole[k]) for k in spread(len(whole))) if whole else None


def cleared(frames: Iterable[Frame], overlay: Overlay | None) -> Iterator[Frame]:
    """The frames without graphics."""
    return iter(frames) if overlay is None else map(overlay.cleared, frames)


def treated(
    frames: Iterable[Frame], overlay: Overlay | None, treat: Callable[[Iterable[Frame]], Iterator[FrameResult]]
) -> Iterator[FrameResult]:
    """What becomes of frames that are treated without their graphics, with these over it."""
    if overlay is None:
        yield from treat(frames)
        return
    lifted: dict[int, Lifted] = {}

    def taken_off() -> Iterator[Frame]:
        for frame in frames:
            lifted[frame.index] = overlay.lifted(frame)
            yield overlay.cleared(frame)

    for result in treat(taken_off()):
        yield overlay.over(result, lifted.pop(result.frame.index))
