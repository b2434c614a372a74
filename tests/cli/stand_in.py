"""The command with a core that gives a photograph back after DAWDLE seconds, and a clip's frames that many seconds late each."""

import os
import time
from collections.abc import Iterator

import numpy as np

from rsvideo.cli import main
from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics.trajectory import still as at_rest
from rsvideo.progress import Progress
from rsvideo.restoration import multi_frame, single_frame

DAWDLE = float(os.environ.get("DAWDLE", "0"))
restored = multi_frame.restored


def restore(view, settings, *, trajectory, start, observe, **_) -> FrameResult:
    """Nothing is restored, but everything around it is real."""
    print("working", flush=True)
    observe(Progress(stage="half way", fraction=0.5))
    time.sleep(DAWDLE)
    frame, timing = view.source, view.source_camera.timing
    return FrameResult(
        frame=frame,
        timing=timing,
        trajectory=trajectory or start or at_rest(timing.interval, degree=settings.degree, axes=3),
        latent=np.clip(2 * frame.pixels, 0, 1),
        verdict=Verdict.RESTORED,
        seconds=0.25,
    )


def late(*given, **named) -> Iterator[FrameResult]:
    """What becomes of a clip's frames, in no hurry."""
    for result in restored(*given, **named):
        time.sleep(DAWDLE)
        yield result


single_frame.restore, multi_frame.restored = restore, late  # in the workers too, which import this file by its path

if __name__ == "__main__":
    main()
