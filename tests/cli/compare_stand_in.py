"""The command with methods that are quick: rsvideo brightens, uniform fails, stitch is killed; what is around them is real."""

import os
import signal

import numpy as np

from rsvideo.config.method import Method
from rsvideo.frame import FrameResult, Verdict
from rsvideo.physics.trajectory import Polynomial
from rsvideo.pipeline import methods
from rsvideo.progress import Progress
from rsvideo.restoration.movement import Movement


def treated(asked, frame):
    if asked.method is Method.UNIFORM:
        raise ValueError("no kernel was found")
    if asked.method is Method.STITCH:
        os.kill(os.getpid(), signal.SIGKILL)
    timing = asked.camera.timing
    way = Polynomial(t0=0.0, t1=timing.interval[1], coefficients=np.array([[0.0, 0.0, 0.0], [3.0, 1.0, 0.0]]))
    return FrameResult(
        frame=frame,
        timing=timing,
        timing_source=asked.timing_source,
        trajectory=way,
        latent=np.clip(1.1 * frame.pixels, 0, 1),
        verdict=Verdict.RESTORED,
        seconds=0.25,
    )


def run(asked, frames, moving, observe):
    for frame in frames:
        yield treated(asked, frame)
        observe(Progress(stage="restoring", fraction=1.0, frame=frame.index))


def movement(asked, frames, begins, observe):
    count = len(begins)
    return Movement(within=[None] * count, steps=np.zeros((count, 3)), tied=[False] * count)


methods.run, methods.movement = run, movement

if __name__ == "__main__":  # spawned processes import this file, for the lines above
    from rsvideo.cli import main

    main()
