"""The scene between two frames of a clip that were each taken in an instant: by dense optical flow, in both directions.

At u, from 0 at the one frame to 1 at the other, a pixel shows what both frames have at the places from which the flow brings it there,
(1 - u) parts of the one and u parts of the other; at u = 0 and u = 1 a frame is itself. The flow of an instant between is put together from
those of its two neighbours, after Jiang et al., Super SloMo (CVPR 2018), Eq. 4.

With the frames before and after these two, a point moves along the cubic through its places in all four (Catmull and Rom's), so that its
velocity does not jump from frame to frame as no hand's does: beyond even motion, by -u (1 - u) / 2 ((1 - u) a + u a'), where a and a' are
the second differences of its places about both frames.
"""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import no_type_check

import cv2
import numpy as np
from jaxtyping import Float, Float32, Int

from rsvideo.physics import tone
from rsvideo.physics.luminance import luminance
from rsvideo.physics.resampling import add_sample
from rsvideo.physics.tone import Transfer
from rsvideo.threads import loop, spread

SMALLEST = 16  # px of rows and columns, of which the flow can be found
STEP = 0.5  # px of motion from one time sample to the next, at most; farther apart they show as a comb
SMOOTH = 20.0  # px, of the Gaussian under which second differences are smoothed: flow errs, and a camera's acceleration is alike all over
MOST_ASTRAY = 0.25  # of a pair's points; beyond, it does not tell how the scene accelerates, as across a cut
_FAST = 0.99  # of all pixels move at most as fast as the motion by which samples are counted
_MOST_SAMPLES = 512  # of a scanline between two frames; a flow that demands more is no motion
_ASTRAY = 1.0  # px by which a point may miss its place when it is followed to the other frame and back

Light = Float32[np.ndarray, "rows cols channels"]
Flow = Float32[np.ndarray, "rows cols 2"]


@dataclass(frozen=True, kw_only=True, eq=False)
class SceneBetween:
    """Two successive frames in linear light, and the flow between them."""

    before: Light
    after: Light
    forward: Float32[np.ndarray, "rows cols 2"]  # px, x and y, from a point of `before` to where it is in `after`
    backward: Float32[np.ndarray, "rows cols 2"]
    accelerations: tuple[Flow, Flow] | None = None  # px, about both frames; None: points move evenly

    @classmethod
    def of(cls, before: Light, after: Light) -> "SceneBetween":
        """The flow is found by dense inverse search (Kroeger et al., ECCV 2016), on codes as eyes see them: dark parts move, too."""
        one, other = (np.rint(255 * tone.encode(Transfer.SRGB, luminance(each))).astype(np.uint8) for each in (before, after))
        search = cv2.DISOpticalFlow.create(cv2.DISOPTICAL_FLOW_PRESET_MEDIUM)
        forward, backward = (search.calc(*pair, np.zeros((*one.shape, 2), np.float32)) for pair in ((one, other), (other, one)))
        return cls(before=before, after=after, forward=forward, backward=backward)

    def beside(self, earlier: "SceneBetween | None", later: "SceneBetween | None") -> "SceneBetween":
        """The same, accelerated as the pairs before and after it show."""
        none = np.zeros_like(self.forward)
        first = _smoothed(self.forward + earlier.backward) if earlier and earlier.astray <= MOST_ASTRAY else none
        last = _smoothed(later.forward + self.backward) if later and later.astray <= MOST_ASTRAY else none
        return replace(self, accelerations=(first, last))

    def usual_motion(self, opens: float, closes: float) -> float:
        """Px that the middle one of all pixels moves from one u to another."""
        moved = (closes - opens) * self.forward
        if self.accelerations:
            moved = moved + sum(b * a for a, b in zip(self.accelerations, _bend(closes) - _bend(opens), strict=True))
        return float(np.median(np.linalg.norm(moved, axis=2)))

    @cached_property
    def largest_motion(self) -> float:
        """Px that nearly all pixels move at most in the time from frame to frame, if they keep their highest speed."""
        speed = np.linalg.norm(self.forward, axis=2)
        for acceleration in self.accelerations or ():
            speed = speed + np.linalg.norm(acceleration, axis=2) / 2
        return float(np.quantile(speed, _FAST))

    @cached_property
    def astray(self) -> float:
        """The share of points that the flow does not bring back to their place: what is covered, and where it is not to be trusted."""
        rows, cols = self.forward.shape[:2]
        x, y = np.meshgrid(np.arange(cols, dtype=np.float32), np.arange(rows, dtype=np.float32))
        x, y = x + self.forward[..., 0], y + self.forward[..., 1]
        back = cv2.remap(self.backward, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        inside = (x >= 0) & (x <= cols - 1) & (y >= 0) & (y <= rows - 1)
        missed = np.linalg.norm(self.forward + back, axis=2) > _ASTRAY
        return float((missed & inside).sum() / max(inside.sum(), 1))

    def at(self, u: float) -> Light:
        """The scene at one instant."""
        return self.exposed(np.array([u]), np.array([u]), np.zeros(self.before.shape[:2], np.intp))

    def exposed(
        self, opens: Float[np.ndarray, " scanlines"], closes: Float[np.ndarray, " scanlines"], scanline: Int[np.ndarray, "rows cols"]
    ) -> Light:
        """The mean light of each pixel from the u at which its scanline opens to the u at which it closes; 0 where it closes earlier."""
        samples = np.ceil((closes - opens) * self.largest_motion / STEP).clip(1, _MOST_SAMPLES).astype(np.intp)
        samples[closes < opens] = 0
        result = np.empty(self.before.shape, np.float32)
        scene = self.before, self.after, self.forward, self.backward, *(self.accelerations or (np.zeros_like(self.forward),) * 2)
        spread(_means, len(result), *scene, opens, closes, samples, scanline, result)
        return result


def _smoothed(second: Flow) -> Flow:
    return np.asarray(cv2.GaussianBlur(second, (0, 0), SMOOTH), np.float32)


def _bend(u: float) -> Float[np.ndarray, "2"]:
    """How far both accelerations have bent a point's course by then."""
    return -0.5 * u * (1 - u) * np.array([1 - u, u])


@no_type_check
@loop(fastmath=False)
def _means(first, last, before, after, forward, backward, soon, late, opens, closes, samples, scanline, result):
    rows, cols, channels = before.shape
    for y in range(first, last):
        total = np.empty(channels)
        for x in range(cols):
            total[:] = 0.0
            i = scanline[y, x]
            n = samples[i]
            for j in range(n):
                u = opens[i] + (closes[i] - opens[i]) * (j + 0.5) / n
                v = 1.0 - u
                bent_x = -0.5 * u * v * (v * soon[y, x, 0] + u * late[y, x, 0])
                bent_y = -0.5 * u * v * (v * soon[y, x, 1] + u * late[y, x, 1])
                x0 = x - bent_x - v * u * forward[y, x, 0] + u * u * backward[y, x, 0]
                y0 = y - bent_y - v * u * forward[y, x, 1] + u * u * backward[y, x, 1]
                x1 = x - bent_x + v * v * forward[y, x, 0] - u * v * backward[y, x, 0]
                y1 = y - bent_y + v * v * forward[y, x, 1] - u * v * backward[y, x, 1]
                first = 0.0 <= x0 <= cols - 1 and 0.0 <= y0 <= rows - 1
                second = 0.0 <= x1 <= cols - 1 and 0.0 <= y1 <= rows - 1
                part = u if first == second else 1.0 if second else 0.0  # what left the frame is taken from the one that has it
                if part < 1.0:
                    add_sample(total, before, x0, y0, 1.0 - part)
                if part > 0.0:
                    add_sample(total, after, x1, y1, part)
            for q in range(channels):
                result[y, x, q] = max(total[q] / n, 0.0) if n else 0.0
