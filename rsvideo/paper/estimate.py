"""The trajectory of one frame as in the paper, wholly or in part."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import islice

from rsvideo.paper.alternation import PaperSettings, alternate
from rsvideo.paper.tracing import trace
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration import kernel_search
from rsvideo.restoration.estimate import ESTIMATED, Estimate
from rsvideo.restoration.scene import Scene
from rsvideo.restoration.settings import Settings

STARTED = 0.15  # of a frame's work is done when the first trajectory is found


def chosen(settings: Settings) -> bool:
    """Whether a step of the paper's takes the place of the project's."""
    return settings.start == "tracing" or settings.refinement == "alternation"


def estimate(scene: Scene, settings: Settings) -> Iterator[Estimate]:
    """The trajectory from tracing or from a fit of the strips' kernels, by alternation or by the race; the last estimate is the answer."""
    first = yield from kernel_search.first_paths(scene, settings)
    if first is None:
        return
    if settings.start == "tracing":
        traced = trace(first.strips, scene.camera.timing, degree=settings.degree)
        first = replace(first, candidates=[replace(first.candidates[0], trajectory=traced)])
    if settings.refinement == "alternation":
        yield from alternated(first.part, first.candidates[0].trajectory, settings)
    else:
        yield from kernel_search.race(scene, first, settings)


def alternated(scene: Scene, start: Trajectory, settings: Settings) -> Iterator[Estimate]:
    """Algorithm 1 from `start`, until mu has come down to its last value."""
    paper = PaperSettings(K=settings.samples, mu_0=settings.mu, tau=settings.mu_factor, mu_min=settings.mu_last)
    rounds = 1 + math.ceil(math.log(settings.mu_last / settings.mu) / math.log(settings.mu_factor))
    for step, state in enumerate(islice(alternate(scene.frame, camera=scene.camera, start=start, settings=paper), rounds)):
        fraction = min(STARTED + (ESTIMATED - STARTED) * (step + 1) / rounds, ESTIMATED)
        yield Estimate(stage="alternation", fraction=fraction, trajectory=state.trajectory)
