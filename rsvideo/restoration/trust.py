"""How far a restoration is to be followed: only where the blur is long enough, and where the path is in focus.

s, the focus along the path (restoration.focus), scatters about 0 along a wrong path, or one cut to a wrong exposure, and is positive
along a true one. So does d, by how much less of the spectra (restoration.spectrum) the path leaves unexplained than rest does, and than
the same path turned by a right angle. Both are measured over the frames of a run, whose path was found without blur; s also about each
pixel. Last, what the neighbours show counts: where none of them explains the frame (restoration.fusion), its restoration is not shown.
"""

from collections.abc import Sequence
from dataclasses import replace

import cv2
import numpy as np
from jaxtyping import Float

from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration.focus import focus_map, focus_value
from rsvideo.restoration.scene import Scene, reduced
from rsvideo.restoration.spectrum import Patches, Spectrum, patches
from rsvideo.restoration.verdict import across

SHORT, LONG = 1.5, 3.0  # px of blur within an exposure: up to the first, deblurring gains nothing; from the second on it is done in full
OUT_OF_FOCUS, IN_FOCUS = -0.002, 0.003  # s of a region; origin: by trial on real scenes
FRAME_DOUBT = 1e-3  # s of a whole frame: above, it is restored in full, below the opposite not at all; chosen on scenes of several depths
APART, AGREED = 0.1, 0.5  # how well the best of the neighbours explains the frame about a pixel; chosen on real scenes (docs/results.md)
AGREEMENT = 15  # px over which that is averaged
UNOBSERVED, OBSERVED = 0.3, 0.7  # of a latent pixel's light: beside the borders and in clipped lamps there is less; origin: by trial
REGION = 0.25  # of the frame's shorter side: the region about a pixel over which s is measured
FULL_VOTES = 0.005, 0.02  # s and d of a frame, beyond which they hardly count more, so that no frame outweighs many; origin: by trial
CHANCE, CERTAIN = 1.3, 1.7  # standard deviations of a sum of votes that scatter about 0: up to the first, a run's focus may be chance
_LEAST_VOTE = 1e-12  # where no frame votes, the sum is divided by this


def run_share(votes: Sequence[tuple[float, float]]) -> float:
    """The share of restorations, 0 to 1, that s and d of a run's blurred frames grant together; a single one grants a third at most."""
    if not votes:
        return 0.0
    each = np.tanh(np.array(votes) / FULL_VOTES)
    scatter = np.sqrt((each**2).sum(axis=0))
    deviations = float((each.sum(axis=0) / np.maximum(scatter, _LEAST_VOTE)).sum() / np.sqrt(len(FULL_VOTES)))
    return float(np.clip((deviations - CHANCE) / (CERTAIN - CHANCE), 0, 1))


def vote(scene: Scene, path: Trajectory) -> tuple[float, float]:
    """s and d of a frame along a path that was found without its blur."""
    observed = patches(scene)
    if observed is None:
        return focus_value(scene, path), 0.0
    along, turned = misfits(scene, observed, path)
    rest = Spectrum(scene=replace(scene, flow=None), patches=observed, curve=path).value(path.with_coefficients(0 * path.coefficients))
    return focus_value(scene, path), min(rest, turned) - along


def misfits(scene: Scene, observed: Patches, path: Trajectory) -> tuple[float, float]:
    """Of the spectra that were observed: along a path, and along the same path turned by a right angle."""
    turned = replace(scene, flow=scene.flow and scene.flow.across)
    along, beside = (Spectrum(scene=each, patches=observed, curve=path) for each in (scene, turned))
    return along.value(path), beside.value(across(path))


def trust(scene: Scene, path: Trajectory, length: float) -> Float[np.ndarray, "rows cols"]:
    """The share of the restoration along a path whose blur is `length` px long, 0 to 1, smooth over the frame."""
    rows, cols = scene.frame.shape
    if length <= SHORT:
        return np.zeros((rows, cols), np.float32)
    scene = reduced(scene, length)
    focus, whole = focus_map(scene, path, REGION * min(scene.frame.shape))
    share = np.clip((focus - OUT_OF_FOCUS) / (IN_FOCUS - OUT_OF_FOCUS), 0, 1) * min((length - SHORT) / (LONG - SHORT), 1)
    share *= np.clip(0.5 + whole / (2 * FRAME_DOUBT), 0, 1)
    return cv2.resize(share.astype(np.float32), (cols, rows), interpolation=cv2.INTER_LINEAR)


def observed(covered: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
    """The share of a restoration that the frame's own data grant, 0 to 1; `covered` is `BlurredFrame`'s."""
    return np.clip((covered - UNOBSERVED) / (OBSERVED - UNOBSERVED), 0, 1).astype(np.float32)


def agreement(explained: Float[np.ndarray, "rows cols"]) -> Float[np.ndarray, "rows cols"]:
    """The share of a restoration that its neighbours grant, 0 to 1; `explained` is `fusion.Fused`'s."""
    share = np.clip((explained - APART) / (AGREED - APART), 0, 1).astype(np.float32)
    return cv2.blur(share, (AGREEMENT, AGREEMENT))
