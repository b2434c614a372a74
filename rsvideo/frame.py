"""A frame as decoded, and what became of it."""

import enum
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from rsvideo.physics.shutter import ShutterTiming
from rsvideo.physics.trajectory import Trajectory

SMALLEST = 32  # px a side; a smaller picture has nothing to measure motion by


class Verdict(enum.StrEnum):
    """What became of a frame; the values are the sentences a person reads."""

    RESTORED = "restored"
    UNDIRECTED = "deblurred, not straightened: its blur does not tell which way the camera moved"
    DOUBTFUL = "restored in part: little speaks for the motion that its blur shows"
    STRAIGHTENED = "straightened, not deblurred: it has too little blur, or blur that its motion does not explain"
    DISAGREES = "straightened, not deblurred: the blur of its neighbours and its own does not show the exposure that is assumed"
    LEFT = "left as it was: it has too little blur, or blur that its motion does not explain; and no readout"
    SHARP = "left as it was: the frame is sharp already"
    NO_TEXTURE = "left as it was: the frame has no texture to measure motion by"
    UNTOUCHED = "left as it was: no restoration was asked for"
    DAMAGED = "left as it was: it could not be decoded as it was meant"
    UNEXPLAINED = "left as it was: one camera motion does not explain its blur"

    @property
    def changed(self) -> bool:
        """Whether the latent image is shown, and not the frame as it came."""
        return self.deblurred or self.straightened

    @property
    def deblurred(self) -> bool:
        """Whether the frame's blur is undone, or a part of it, and, unless its direction is open, the displacement of its scanlines too."""
        return self in (Verdict.RESTORED, Verdict.DOUBTFUL, Verdict.UNDIRECTED)

    @property
    def straightened(self) -> bool:
        """Whether the frame is rectified, and as blurred as before."""
        return self in (Verdict.STRAIGHTENED, Verdict.DISAGREES)


@dataclass(frozen=True, kw_only=True, eq=False)
class Frame:
    """One frame in sensor order, in linear light."""

    pixels: Float[np.ndarray, "rows cols channels"]  # linear light in [0, 1], float32
    clipped: Bool[np.ndarray, "rows cols channels"]  # codes at the sensor's or the file's upper limit
    time: float = 0.0  # seconds, when row 0 opens
    index: int = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class FrameResult:
    """All that a writer and a report need of one restored frame."""

    frame: Frame
    timing: ShutterTiming
    trajectory: Trajectory  # in image axes; at(timing.middle) is the origin
    latent: Float[np.ndarray, "rows cols channels"]  # linear light; the frame's own pixels where it was left as it was
    verdict: Verdict
    seconds: float
    convergence: tuple[float, ...] = ()  # the objective after each step towards the trajectory
    psfs: Float[np.ndarray, "down across k k"] | None = None  # over a grid of the frame, where no trajectory implies them
    timing_source: str = "explicit"  # where the timing comes from; solvers do not ask
    overlaid: float = 0.0  # of the picture, which graphics cover that are left as they were
