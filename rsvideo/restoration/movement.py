"""How a camera moves through a run of frames: within each of them, and from each to the next."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from jaxtyping import Float, Int

from rsvideo.physics.camera import Camera
from rsvideo.physics.shutter import Direction, ShutterTiming
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.scanlines import path_along_scanlines, path_in_image

SAMPLE = 1e-3  # s, of a path joined over all frames
_SHORTEST_BLEND = 1e-9  # s, of a ramp from one frame's path to the next one's: interpolation needs rising times
_LEAST_WEIGHT = 1e-9  # of the frames at an instant; where none reaches, the sum is divided by this


@dataclass(frozen=True, kw_only=True, eq=False)
class Evidence:
    """What points and blur tell of a frame beside its path."""

    flow: Flow | None  # of points beyond the path, along the scanlines always
    error: float  # px by which the blur of one exposure may depart from path and flow
    share: float  # of a restoration, 0 to 1: whether the blur of the run bears its path out, and how surely the frame's is as the path says
    certainty: float  # 0 to 1: how surely its scanlines are displaced as the path says, and so how far it is straightened
    blur_certainty: float = 1.0  # 0 to 1: how surely its blur is as the path says
    exposure_shown: bool = False  # whether the clip's blur has shown its exposure
    seeming: float | None = None  # s, the exposure that its blur shows, softness included, which `focused` covers; None: its own
    focused: Trajectory | None = None  # along the scanlines always: the path that its focus led to, and is judged along; None: its own


@dataclass(frozen=True, kw_only=True, eq=False)
class Movement:
    """How the camera moved within each frame of a run, and from each to the next; in image axes wherever it is handed on."""

    within: list[Trajectory | None]  # None where no point could be followed: such a frame stands alone
    steps: Float[np.ndarray, "frames axes"]  # from the pose at the middle of a frame's interval to that of the next
    tied: list[bool]  # whether the next frame's points were followed; else its step is 0
    evidence: list[Evidence] = field(default_factory=list)  # of each frame; none where the motion was given, and is followed as it is
    exposures: list[float] = field(default_factory=list)  # s, of each frame; none where all have their camera's

    @property
    def beside(self) -> Sequence[Evidence | None]:
        """The evidence of each frame, None where the motion was given."""
        return self.evidence or [None] * len(self.within)

    def cameras(self, camera: Camera) -> list[Camera]:
        """That of each frame, which differ in their exposure only."""
        return [camera.exposed(exposure) for exposure in self.exposures] or [camera] * len(self.within)

    @classmethod
    def unfollowed(cls, frames: int, axes: int) -> "Movement":
        """That of frames of which none could be followed."""
        return cls(within=[None] * frames, steps=np.zeros((frames, axes)), tied=[False] * frames)

    def part(self, first: int, last: int) -> "Movement":
        """That of frames first, ..., last - 1."""
        return Movement(
            within=self.within[first:last],
            steps=self.steps[first:last],
            tied=self.tied[first:last],
            evidence=self.evidence[first:last],
            exposures=self.exposures[first:last],
        )

    def of_pictures(self, pictures: Int[np.ndarray, " pictures"]) -> "Movement":
        """That of pictures, each of which shows one of the frames: the pose stays where a picture shows the same as the next one."""
        again = np.append(pictures[1:] == pictures[:-1], [False] * min(len(pictures), 1))
        return Movement(
            within=[self.within[k] for k in pictures],
            steps=np.where(again[:, None], 0.0, self.steps[pictures]),
            tied=[bool(still) or self.tied[k] for k, still in zip(pictures, again, strict=True)],
            evidence=[self.evidence[k] for k in pictures if self.evidence],
            exposures=[self.exposures[k] for k in pictures if self.exposures],
        )

    def along_scanlines(self, direction: Direction) -> "Movement":
        """The same along the scanlines, for one in image axes."""
        within = [path and path_along_scanlines(path, direction) for path in self.within]
        return replace(self, within=within, steps=direction.poses_along_scanlines(self.steps))

    def in_image(self, direction: Direction) -> "Movement":
        """The same in image axes, for one along the scanlines."""
        within = [path and path_in_image(path, direction) for path in self.within]
        return replace(self, within=within, steps=direction.poses_in_image(self.steps))


def groups(tied: Sequence[bool]) -> Int[np.ndarray, " frames"]:
    """The number of the group that each frame is in: within it, points lead from frame to frame. `tied` is `Movement`'s."""
    return np.cumsum([0, *(not followed for followed in tied[:-1])])


def joined(
    begins: Float[np.ndarray, " frames"],
    within: Sequence[tuple[Float[np.ndarray, " _"], Float[np.ndarray, "_ axes"]]],  # samples, as many as each exposure has
    steps: Float[np.ndarray, "frames axes"],
    timing: ShutterTiming,
) -> tuple[Float[np.ndarray, " n"], Float[np.ndarray, "n axes"]]:
    """One path over all frames, from the motion within each and from each to the next: neighbours fade into each other."""
    at = np.vstack([np.zeros((1, steps.shape[1])), np.cumsum(steps[:-1], axis=0)])
    t = np.arange(begins[0], begins[-1] + timing.interval[1], SAMPLE)
    ends = begins + timing.interval[1]
    total, poses = np.zeros(len(t)), np.zeros((len(t), steps.shape[1]))
    for k, (times, path) in enumerate(within):
        # from where the frame before has ended, or this one begins, to where the next one begins, or this one ends; and across gaps
        rise = sorted((ends[k - 1], begins[k])) if k else (t[0] - 1, t[0] - 0.5)
        fall = sorted((ends[k], begins[k + 1])) if k + 1 < len(begins) else (t[-1] + 0.5, t[-1] + 1)
        weight = np.interp(t, [rise[0], rise[1] + _SHORTEST_BLEND, fall[0], fall[1] + _SHORTEST_BLEND], [0, 1, 1, 0])
        near = np.flatnonzero(weight)
        total[near] += weight[near]
        for a in range(steps.shape[1]):
            poses[near, a] += weight[near] * (at[k, a] + np.interp(t[near] - begins[k], times, path[:, a]))
    return t, poses / np.maximum(total, _LEAST_WEIGHT)[:, None]
