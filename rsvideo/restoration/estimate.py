"""What a search for a frame's trajectory answers."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.evidence import Evidence
from rsvideo.restoration.scene import Scene
from rsvideo.restoration.settings import Settings

ESTIMATED = 0.75  # of a frame's work is done when its trajectory is found


@dataclass(frozen=True, kw_only=True, eq=False)
class Estimate:
    """A state of the search."""

    stage: str
    fraction: float  # of the frame's work, 0 to 1
    trajectory: Trajectory
    values: tuple[float, ...] = ()  # of the objective, step by step
    evidence: Evidence | None = None  # where the spectra led there


Estimator = Callable[[Scene, Settings], Iterator[Estimate]]  # the last estimate is the answer
