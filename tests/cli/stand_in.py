"""The command with a core that gives the photograph back, after DAWDLE seconds."""

import os
import time

import numpy as np

from rsvideo.cli import main
from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics.trajectory import still as at_rest
from rsvideo.progress import Progress
from rsvideo.restoration import single_frame


def restore(view, settings, *, trajectory, start, observe, **_) -> FrameResult:
    """Nothing is restored, but everything around it is real."""
    print("working", flush=True)
    observe(Progress(stage="half way", fraction=0.5))
    time.sleep(float(os.environ.get("DAWDLE", "0")))
    frame, timing = view.source, view.source_camera.timing
    return FrameResult(
        frame=frame,
        timing=timing,
        trajectory=trajectory or start or at_rest(timing.interval, degree=settings.degree, axes=3),
        latent=np.clip(2 * frame.pixels, 0, 1),
        verdict=Verdict.RESTORED,
        seconds=0.25,
    )


single_frame.restore = restore  # in the workers too, which import this file by its path

if __name__ == "__main__":
    main()
