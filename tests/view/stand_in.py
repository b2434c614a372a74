"""The command, and its page, with a core that costs nothing: frames come back as bright as their exposure is long, PACE seconds each."""

import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics.trajectory import still as at_rest
from rsvideo.pipeline import methods, preview
from rsvideo.progress import Progress
from rsvideo.restoration.movement import Movement

PACE = float(os.environ.get("PACE", "0"))
BRIGHT = 0.02  # seconds, an exposure at which a frame stays as it is


def movement(_, frames, begins, observe) -> Movement:
    """Nothing moves."""
    return Movement.unfollowed(len(list(frames)), 3)


def run(treatment, frames, moving, observe) -> Iterator[FrameResult]:
    """Brighter frames, with a word on each."""
    timing = treatment.camera.timing
    for frame in frames:
        observe(Progress(stage="restoring", fraction=0.5, frame=frame.index))
        time.sleep(PACE)
        yield FrameResult(
            frame=frame,
            timing=timing,
            trajectory=at_rest(timing.interval, degree=1, axes=3),
            latent=np.clip(frame.pixels * np.float32(timing.exposure / BRIGHT), 0, 1),
            verdict=Verdict.RESTORED,
            seconds=0.1,
        )


methods.movement, methods.run = movement, run  # in the workers too, which import this file by its path
preview._movement = lambda shown, _, frames, *__: movement(shown, frames, None, None)

if __name__ == "__main__":
    if sys.argv[1] == "view":
        from rsvideo.view import server
        from rsvideo.view.opened import Opened

        folders = [Path(word) for word in sys.argv[2:]]
        server.serve(
            Opened.of(*folders),
            port=0,
            ready=lambda address: print(address, flush=True),
            command=(sys.executable, __file__),
        )
    else:
        from rsvideo.cli import main

        main()
