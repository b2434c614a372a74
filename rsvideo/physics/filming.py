"""Films a clip anew as a rolling-shutter camera would: the frames of a sharp clip, each taken in an instant, become blurred ones.

Time runs evenly through the sharp clip, `speed` of its frames to a period of the camera's: the scene between two of them is
interpolated (physics.scene_between). Each scanline averages the linear light of its own exposure. Automatic exposure changes how long
that is by the same factor from frame to frame; sensors then open earlier or later, and close at an even pace. A few sharp frames are held
at a time, and those of the camera's frames that are open between them, however long the clip.
"""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, pairwise

import numpy as np
from jaxtyping import Int

from rsvideo.physics.noise import Noise
from rsvideo.physics.scene_between import Light, SceneBetween
from rsvideo.physics.shutter import ShutterTiming

LEAST_SPEED, MOST_SPEED = 0.01, 100.0  # sharp frames a frame; nobody means less or more
_ROUNDING = 1e-9  # of a sharp frame's period


@dataclass(frozen=True, kw_only=True)
class Pace:
    """How the camera's frames lie in the time of the sharp clip, which counts its frames: the first one is at 0."""

    timing: ShutterTiming  # of the first frame
    period: float  # s from one frame of the camera to the next
    speed: float  # sharp frames in a period
    growth: float = 1.0  # of the exposure from frame to frame

    def __post_init__(self) -> None:
        if not LEAST_SPEED <= self.speed <= MOST_SPEED:
            raise ValueError(
                f"speed must lie in [{LEAST_SPEED:g}, {MOST_SPEED:g}] source frames a frame, got {self.speed:g};"
                " 1 keeps the source's motion, 2 doubles it"
            )

    def shutter(self, frame: int) -> ShutterTiming:
        """The timing of one frame."""
        return replace(self.timing, exposure=self.timing.exposure * self.growth**frame)

    def opens(self, frame: int) -> float:
        """When a frame's first scanline opens."""
        earlier = self.shutter(frame).exposure - self.timing.exposure
        return (frame - earlier / self.period) * self.speed

    def closes(self, frame: int) -> float:
        """When a frame's last scanline closes."""
        return (frame + self.timing.interval[1] / self.period) * self.speed

    def needed(self, frames: int) -> int:
        """Sharp frames that so many frames need."""
        return math.ceil(self.closes(frames - 1) - _ROUNDING) + 1

    def frames(self, sharp: int) -> int:
        """Frames that so many sharp ones suffice for."""
        return max(0, math.floor((sharp - 1 - self.closes(0) + _ROUNDING) / self.speed) + 1)


@dataclass(frozen=True, kw_only=True, eq=False)
class Shot:
    """One frame as the camera wrote it, and what it should have been."""

    blurred: Light  # in [0, 1]
    truth: Light  # the scene at the middle of the frame's interval, without noise
    blur: float  # px that the middle one of all pixels moves while the middle scanline is open
    astray: float  # the largest share of points that were not found again, of all sharp frames that were interpolated


class _Open:
    """A frame of the camera while the sharp frames go by."""

    def __init__(self, pace: Pace, frame: int, shape: tuple[int, ...]) -> None:
        timing, scale = pace.shutter(frame), pace.speed / pace.period
        self.opens = pace.opens(frame) + scale * timing.row_start()
        self.closes = self.opens + scale * timing.exposure
        self.ends = pace.closes(frame)
        self.middle = 0.5 * (pace.opens(frame) + self.ends)
        self.total, self.truth = np.zeros(shape, np.float32), None
        self.blur = self.astray = 0.0

    def pass_by(self, between: SceneBetween, index: int, scanline: Int[np.ndarray, "rows cols"]) -> None:
        """Collect the light from the sharp frame `index` to the next."""
        opens, closes = np.clip(self.opens, index, None), np.clip(self.closes, None, index + 1)
        share = np.clip(closes - opens, 0, None) / (self.closes - self.opens)
        closes = np.where(share > 0, closes, opens - 1)
        self.total += between.exposed(opens - index, closes - index, scanline) * share[scanline][..., None].astype(np.float32)
        if self.truth is None and self.middle <= index + 1:
            self.truth = between.at(self.middle - index)
        middle = len(share) // 2
        if share[middle]:
            self.blur += between.usual_motion(float(opens[middle]) - index, float(closes[middle]) - index)
        self.astray = max(self.astray, between.astray)

    def shot(self, noise: Noise, rng: np.random.Generator) -> Shot:
        """The frame, once its last scanline has closed."""
        assert self.truth is not None
        blurred = np.clip(noise.added_to(self.total, rng), 0, 1).astype(np.float32)
        return Shot(blurred=blurred, truth=np.clip(self.truth, 0, 1), blur=self.blur, astray=self.astray)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Pair:
    """Two successive sharp frames, whose flow is found once it is needed."""

    before: Light
    after: Light

    @cached_property
    def between(self) -> SceneBetween:
        return SceneBetween.of(self.before, self.after)


def _surrounded(pairs: Iterable[_Pair]) -> Iterator[tuple[_Pair | None, _Pair, _Pair | None]]:
    """Each pair with the one before and the one after it, where there are such."""
    earlier, here = None, None
    for later in chain(pairs, [None]):
        if here:
            yield earlier, here, later
        earlier, here = here, later


def filmed(sharp: Iterable[Light], pace: Pace, *, frames: int, noise: Noise, rng: np.random.Generator) -> Iterator[Shot]:
    """So many frames of the camera; ValueError where the sharp ones, all of one size, do not suffice for them."""
    left: list[_Open] = []
    begun = done = 0
    pairs = (_Pair(before=before, after=after) for before, after in pairwise(sharp))
    for index, (earlier, here, later) in enumerate(_surrounded(pairs)):
        first = begun
        while begun < frames and pace.opens(begun) < index + 1:
            begun += 1
        if left or begun > first:
            between = here.between.beside(earlier and earlier.between, later and later.between)
            scanline = _scanlines(pace.timing, here.before.shape[:2])
            passed, left = left, []
            for each in chain(passed, (_Open(pace, frame, here.before.shape) for frame in range(first, begun))):
                each.pass_by(between, index, scanline)
                if each.ends > index + 1 + _ROUNDING:
                    left.append(each)
                    continue
                done += 1
                yield each.shot(noise, rng)
        if done == frames:
            return
    raise ValueError(f"{frames} frames need {pace.needed(frames)} sharp ones, they end after {done}")


def _scanlines(timing: ShutterTiming, shape: tuple[int, int]) -> Int[np.ndarray, "rows cols"]:
    """The scanline of each pixel."""
    scanlines = np.empty(shape, np.intp)
    along = timing.direction.scanlines(scanlines)
    if len(along) != timing.rows:
        raise ValueError(f"the shutter reads {timing.rows} scanlines, the frame has {len(along)} {timing.direction.value}")
    along[:] = np.arange(timing.rows)[:, None]
    return scanlines
