"""The motion of a run that was stabilised: from frame to frame as its points show it, and within each frame as its own blur does.

A stabiliser shifts frames after they were exposed, and may put their scanlines straight. Then the path between the frames says nothing of
their blur, which `relative_blur` finds without it; its sense does not show, so nothing is straightened. Whether the frames come
into focus along their streaks tells whether these are right, as of any other path.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float

from rsvideo.physics.camera import Intrinsics
from rsvideo.restoration.camera_path import PATH_ERROR, polynomial
from rsvideo.restoration.clip_motion import Followed, Run, movement_along, movement_of, votes_along
from rsvideo.restoration.movement import Evidence, Movement, groups
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.relative_blur import Streaks, streaks
from rsvideo.restoration.scanlines import path_in_image
from rsvideo.restoration.trust import BETTER, blur_share, deviations, run_share


def movement(followed: Followed) -> Movement:
    """The motion of a run without a readout, in image axes: with streaks, or along the path that its points show.

    A path is believed of a global shutter, and streaks where a readout is only not shown, unless frames are in better focus with the other:
    in an even pan, which blurs all of them alike, along the path.
    """
    run, path = followed.run, followed.path.spline
    found = streaks_of(run)
    timings = [run.timing(k) for k in range(len(run.begins))]
    along = (found.pose * np.gradient(path.at(run.begins + run.camera.timing.middle), axis=0))[:, :2].sum(axis=1)
    sense = np.where(along < 0, -1, 1)[:, None]  # as the points move, if either is as likely
    within = [
        polynomial(timing, 2, run.axes).with_coefficients(np.stack([0 * pose, pose / np.sqrt(12)]))
        for timing, pose in zip(timings, sense * found.pose, strict=True)
    ]
    changes = zip(timings, sense * found.change, strict=True)
    flows = [_by_scanline(-change / timing.exposure, run.camera.intrinsics) for timing, change in changes]
    power = (found.pose[:, :2] ** 2).sum(axis=1)
    certain = found.probability * power / (power + found.variance)
    votes = votes_along(run, within, flows)
    if deviations(votes) - deviations(followed.votes) <= (-BETTER if run.readout_guessed else BETTER):
        return movement_along(followed)
    shares = run_share(votes) * blur_share(certain)
    evidence = [
        Evidence(flow=flow, error=float(np.hypot(PATH_ERROR, std)), share=float(share), certainty=1.0, blur_certainty=float(certainty))
        for flow, std, share, certainty in zip(flows, np.sqrt(found.variance), shares, certain, strict=True)
    ]
    between = movement_of(run, path, run.followed)
    shown = [path_in_image(piece, run.direction) if held else None for piece, held in zip(within, run.followed, strict=True)]
    return replace(between, within=shown, evidence=evidence)


def streaks_of(run: Run) -> Streaks:
    """The streaks of its frames, along the scanlines, px of the frame."""
    return streaks([frame.pixels[..., 0] for frame in run.small], run.displaced, groups(run.tied), run.camera, run.axes)


def _by_scanline(change: Float[np.ndarray, " 2"], lens: Intrinsics) -> Flow:
    """A field that rises by so many px/s over the frame's height, evenly, and is 0 in its middle."""
    x, y, reach, far = (lens.cols - 1) / 2, (lens.rows - 1) / 2, lens.rows / 4, 8 * max(lens.rows, lens.cols)
    unit = Flow(points=np.array([[x, y - reach], [x, y + reach]]), weights=np.array([[-1.0, 0], [1, 0]]), length=far)
    return replace(unit, weights=np.outer([-1, 1], change / 2 / unit.at(np.array([[x, y + lens.rows / 2]]))[0, 0]))
