"""The command with a core that gives the photograph back, after DAWDLE seconds."""

import os
import time
from types import SimpleNamespace

import numpy as np

from rsvideo.cli import main
from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics.trajectory import still as at_rest
from rsvideo.restoration import single_frame


def restore(frame, timing, intrinsics, settings, *, timing_source, trajectory, start, observe) -> FrameResult:
    """Nothing is restored, but everything around it is real."""
    print("working", flush=True)
    observe(SimpleNamespace(stage="half way", fraction=0.5))
    time.sleep(float(os.environ.get("DAWDLE", "0")))
    return FrameResult(
        frame=frame,
        timing=timing,
        timing_source=timing_source,
        trajectory=trajectory or start or at_rest(timing.interval, degree=settings.degree, axes=3),
        latent=np.clip(2 * frame.pixels, 0, 1),
        verdict=Verdict.RESTORED,
        seconds=0.25,
    )


single_frame.restore = restore  # in the workers too, which import this file by its path

if __name__ == "__main__":
    main()
