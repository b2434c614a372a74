"""How far a restoration is to be followed: only where the blur is long enough, and where the path is in focus.

s, the focus along the path (restoration.focus), scatters about 0 along a wrong path, or one cut to a wrong exposure, and is positive
along a true one. It is measured over the frames of a run, whose path was found without blur, and about each pixel. Last, what the
neighbours show counts: where none of them explains the frame (restoration.fusion), its restoration is not shown.
"""

from collections.abc import Sequence

import cv2
import numpy as np
from jaxtyping import Bool, Float

from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.focus import focus_map
from rsvideo.restoration.predicted_blur import Confirmed
from rsvideo.restoration.scene import Scene, reduced

SHORT, LONG = 1.5, 3.0  # px of blur within an exposure: up to the first, deblurring gains nothing; from the second on it is done in full
OUT_OF_FOCUS, IN_FOCUS = -0.002, 0.003  # s of a region; origin: by trial on real scenes
FRAME_DOUBT = 1.5e-3  # s of a whole frame, by which it may be below 0 before it is not restored at all
SURELY, DOUBT = 5.0, 2.0  # standard errors that s of a whole frame must be above 0 along a path that nothing makes certain, and by how many
# it may be below that before it is not restored at all; all three chosen on scenes of several depths
APART, AGREED = 0.1, 0.5  # how well the best of the neighbours explains the frame about a pixel; chosen on real scenes (docs/results.md)
AGREEMENT = 15  # px over which that is averaged
UNSEEN = 0.5  # of the restoration, which counts at most where no neighbour shows the place; chosen on scenes of several depths
MISSING, CONFIRMED = 0.3, 0.5  # of the blur that the path predicts, that a frame shows about a pixel
FRAME_MISSING, FRAME_CONFIRMED = 0.4, 0.6  # the same of the whole frame; all four chosen on 51 clips (docs/method.md, (18))
UNSURE = 1.0  # times how unsure the frame's blur is, by which these two are higher; no frame of 0.9 on changes much by it
UNCHECKED, CHECKED = 2.0, 3.0  # px of blur: shorter blur is hardly longer than what neighbours are off by
UNOBSERVED, OBSERVED = 0.3, 0.7  # of a latent pixel's light: beside the borders and in clipped lamps there is less; origin: by trial
CREDIT_BLUR, CREDIT_REGION, CREDIT_FRAME = 0.5, 3.5e-3, 5e-4  # px; s of a region; s of a frame: by so much all three may be less where the
# clip's blur has shown its exposure; chosen on scenes of several depths and real ones
REGION = 0.25  # of the frame's shorter side: the region about a pixel over which s is measured
FULL_VOTE = 0.005  # s of a frame, beyond which it hardly counts more, so that no frame outweighs many; origin: by trial
BETTER = 0.5  # standard deviations of a run's focus, by which what is not believed must be better than what is
SCATTER = 0.0065  # s of a single frame that counts as one standard deviation: twice that along wrong paths, whose tails are long
CHANCE, CERTAIN = 1.3, 1.7  # standard deviations of a sum of votes that scatter about 0: up to the first, a run's focus may be chance
BLUR_VAGUE, BLUR_SURE = 0.5, 0.7  # how surely a frame's blur is as its path says; chosen on clips of choosing halves (docs/results.md)
_LEAST_VOTE = 1e-12  # where no frame votes, the sum is divided by this


def run_share(votes: Sequence[float]) -> float:
    """The share of restorations, 0 to 1, that s of a run's blurred frames grants together."""
    return float(ramp(deviations(votes), CHANCE, CERTAIN))


def blur_share(certainties: Float[np.ndarray, " frames"]) -> Float[np.ndarray, " frames"]:
    """The share of each frame's restoration that the certainty of its blur grants, 0 to 1."""
    return ramp(certainties, BLUR_VAGUE, BLUR_SURE)


def deviations(votes: Sequence[float]) -> float:
    """How many standard deviations the sum of s of several frames is above the 0 that it scatters about along a wrong path.

    The scatter is the frames' own, by how far they agree, or the usual one: a single frame agrees with itself.
    """
    sharp = np.array(votes)
    each = np.tanh(sharp / FULL_VOTE)
    agreed = each.sum() / max(np.sqrt((each**2).sum()), _LEAST_VOTE)
    return float(max(agreed, sharp.sum() / (SCATTER * np.sqrt(max(len(sharp), 1)))))


def trust(scene: Scene, path: Trajectory, length: float, certainty: float, exposure_shown: bool = False) -> Float[np.ndarray, "rows cols"]:
    """The share of the restoration along a path whose blur is `length` px long, 0 to 1, smooth over the frame.

    `certainty`, 0 to 1, says how surely the scanlines are displaced as the path says. Where the clip's blur has shown its exposure, s
    about a pixel hardly tells more: it counts only where it is plainly against the path. Shorter blur is restored there, too, as far as
    the path is certain.
    """
    rows, cols = scene.frame.shape
    credit = float(exposure_shown)
    if (credited := length + credit * certainty * CREDIT_BLUR) <= SHORT:
        return np.zeros((rows, cols), np.float32)
    scene = reduced(scene, length)
    focus = focus_map(scene, path, REGION * min(scene.frame.shape))
    share = ramp(focus.about + credit * CREDIT_REGION, OUT_OF_FOCUS, IN_FOCUS) * ramp(credited, SHORT, LONG)
    share *= ramp(focus.whole + credit * CREDIT_FRAME, -FRAME_DOUBT, 0) * ramp(focus.surely - SURELY * (1 - certainty), -DOUBT, 0)
    return cv2.resize(share.astype(np.float32), (cols, rows), interpolation=cv2.INTER_LINEAR)


def observed(covered: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
    """The share of a restoration that the frame's own data grant, 0 to 1; `covered` is `BlurredFrame`'s."""
    return ramp(covered, UNOBSERVED, OBSERVED).astype(np.float32)


def agreement(
    explained: Float[np.ndarray, "rows cols"],
    shown: Bool[np.ndarray, "rows cols"],
    astray: Bool[np.ndarray, "rows cols"],
    certainty: float,
) -> Float[np.ndarray, "rows cols"]:
    """The share of a restoration that its neighbours grant, 0 to 1, and none where the path has gone astray; the former three are
    `fusion.Fused`'s.

    Where no neighbour shows the place, the `certainty` of the path has to grant it, and grants a part only.
    """
    share = ramp(np.where(shown, explained, certainty), APART, AGREED) * np.where(shown, 1, UNSEEN) * ~astray
    return cv2.blur(share.astype(np.float32), (AGREEMENT, AGREEMENT))


def confirmation(predicted: Confirmed, length: float, certainty: float = 1.0) -> Float[np.ndarray, "rows cols"]:
    """The share of a restoration that the frame's own blur grants, 0 to 1, along a path whose blur is `length` px long.

    The less surely the blur is as the path says, by its `certainty`, the more of it the frame has to show.
    """
    unsure = min(UNSURE * (1 - certainty), 1 - FRAME_CONFIRMED)  # all of the blur is enough
    about = ramp(predicted.about, MISSING, CONFIRMED) * ramp(predicted.whole, FRAME_MISSING + unsure, FRAME_CONFIRMED + unsure)
    return cv2.blur(_checked(about, length).astype(np.float32), (AGREEMENT, AGREEMENT))


def borne_out(predicted: Confirmed, length: float) -> float:
    """How far the same frame's blur bears out where its path leads, 0 to 1, in a clip whose blur has shown its exposure."""
    return float(_checked(ramp(predicted.whole, FRAME_MISSING, FRAME_CONFIRMED), length))


def _checked(share: np.ndarray, length: float) -> np.ndarray:
    """A share that counts the more, the longer the blur is."""
    return np.asarray(1 - ramp(length, UNCHECKED, CHECKED) * (1 - share))


def ramp(value: np.ndarray | float, none: float, whole: float) -> np.ndarray:
    """The share, 0 to 1, that rises from `none` to `whole`."""
    return np.asarray(np.clip((value - none) / (whole - none), 0, 1))
