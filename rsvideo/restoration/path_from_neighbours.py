"""The path of a run corrected by what its frames show of one scene.

Points hardly show how a camera moves within an exposure, nor a wobble that repeats from frame to frame: all frames would be sheared alike.
The blur of the frames does, if they are compared. Each is restored as a draft, by itself, in grey; the drafts of a frame's neighbours are
brought to its pose, and say what is missing of its path (`restoration.departure`). Of frame k they say x_k = G_k (C - C_0) up to

    (h^2 S_k + f^2 / |d|^2 + g^2 Z_k Z_k^T) / w_k

with C_0 the path's coefficients so far, G_k and Z_k of `camera_path.Doubts`. Neighbours err alike over the whole frame: by h times what its
blocks disagree by, by f px in each displacement d, and by g px in how far the last scanline is displaced against the first. So the run's
coefficients C minimise, in the norms of these covariances,

    (C - C_0)^T H (C - C_0) + sum_k |x_k - G_k (C - C_0)|^2

A frame whose blur is too short to tell is corrected by those around it.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from rsvideo import threads
from rsvideo.frame import Frame
from rsvideo.physics.camera import Camera
from rsvideo.physics.channels import any_channel
from rsvideo.physics.luminance import luminance
from rsvideo.physics.trajectory import Trajectory
from rsvideo.restoration import single_frame
from rsvideo.restoration.camera_path import PATH_ERROR, CameraPath, doubts, within
from rsvideo.restoration.departure import departure
from rsvideo.restoration.extent import beyond, longest
from rsvideo.restoration.fusion import PosedImage, fused, helpful
from rsvideo.restoration.parallax import Flow
from rsvideo.restoration.rectification import displaced, straightened
from rsvideo.restoration.resolution import halved, halved_path, pose_factors, too_long
from rsvideo.restoration.scanlines import View, to_scanlines
from rsvideo.restoration.settings import Settings
from rsvideo.restoration.trust import observed, ramp

LARGEST = 960  # px, the longer side at most of the frames in which this is measured
DRAFT = Settings(quality="draft")  # how a frame is restored for it
FAINT = 1.5  # px of blur in these, up to which a frame is straightened only
SHORT, LONG = 2.0, 4.0  # px of blur, up to which a frame says nothing of its path, and from which on it counts in full
WEAKER, STRONG = 0.6, 0.9  # the same of the blur's strength: weaker blur says that more than the path is wrong
LEAST_SHOWN = 0.25  # of a frame, that its neighbours must show: a part of it has too few blocks to disagree
SCATTER, ERROR, SHEAR = 3.0, 0.05, 0.3  # h, and f and g in px of these frames; chosen on clips of real scenes (docs/results.md)


@dataclass(frozen=True, kw_only=True, eq=False)
class Taken:
    """A frame of a run, in grey, and how it is believed to be blurred; along the scanlines, in px of its own."""

    view: View
    begins: float  # s of the clip
    path: Trajectory  # within it, from the pose at the middle of its interval
    pose: Float[np.ndarray, " axes"]  # there, against the other frames'
    group: int  # frames whose points lead to one another are of one
    flow: Flow | None  # of points beyond the path
    scale: float  # of the frame as stored

    @classmethod
    def of(cls, frame: Frame, camera: Camera, begins: float, path: CameraPath, group: int, flow: Flow | None) -> "Taken":
        """A frame that `small` has made, its camera and flow in px as stored."""
        within_it, scale = within(path.spline, begins, camera.timing), 1.0
        pose = path.spline.at(np.array([begins + camera.timing.middle]))[0]
        while camera.intrinsics.rows > len(frame.pixels):
            camera, within_it, flow, scale = camera.halved(), halved_path(within_it), flow and flow.scaled(0.5), scale / 2
        return cls(
            view=to_scanlines(frame, camera),
            begins=begins,
            path=within_it,
            pose=pose * pose_factors(scale, len(pose)),
            group=group,
            flow=flow,
            scale=scale,
        )

    @cached_property
    def length(self) -> float:
        """Px of its blur."""
        return longest(self.view.camera, self.path)

    @property
    def followed(self) -> bool:
        """Whether its path leads somewhere that a latent image can be solved along."""
        return not (beyond(self.view.camera, self.path) or too_long(self.view, self.length))


def small(view: View) -> Frame:
    """The luminance of a frame, halved until its longer side has at most LARGEST px, along the scanlines."""
    grey = replace(view, pixels=luminance(view.pixels)[..., None], clipped=any_channel(view.clipped)[..., None])
    while max(grey.pixels.shape) > LARGEST:
        grey = halved(grey)
    return replace(view.source, pixels=grey.pixels, clipped=grey.clipped)


def corrected(path: CameraPath, frames: Sequence[Taken], reach: int) -> CameraPath:
    """The path of a run as its frames bear it out together, each with those up to `reach` before and behind it."""
    drafts = threads.each(_draft, frames)

    def shown(k: int) -> _Shown | None:
        near = range(max(0, k - reach), min(len(frames), k + reach + 1))
        return _shown(path, frames[k], drafts[k], [drafts[j].image for j in near if j != k and frames[j].group == frames[k].group])

    precision, right = path.precision.copy(), np.zeros(len(path.precision))
    for found in threads.each(shown, range(len(frames))):
        if found:
            precision += found.of_path.T @ found.precision @ found.of_path
            right += found.of_path.T @ found.precision @ found.missing
    coefficients = path.spline.coefficients
    missing = np.linalg.solve(precision, right).reshape(coefficients.shape)
    return replace(path, spline=path.spline.with_coefficients(coefficients + missing))


@dataclass(frozen=True, kw_only=True, eq=False)
class _Draft:
    """A frame restored by itself."""

    image: PosedImage
    own: Float[np.ndarray, "rows cols"] | None = None  # the share of it that its data grant; None: all


def _draft(taken: Taken) -> _Draft:
    """Straightened only where its blur is faint, or cannot be undone."""
    view, covered = taken.view, None
    if taken.length > FAINT and taken.followed:
        noise = single_frame.model_noise(view, min(PATH_ERROR, taken.length))
        alone = single_frame.restored(view, DRAFT, path=taken.path, noise=noise, flow=taken.flow, coverage=True)
        latent, covered = alone.latent, alone.covered
    else:
        latent = straightened(view, taken.path, flow=taken.flow)
    own = None if covered is None else observed(covered)
    return _Draft(image=PosedImage(latent=latent, pose=taken.pose, length=taken.length), own=own)


@dataclass(frozen=True, kw_only=True, eq=False)
class _Shown:
    """What a frame says of the run's path: of_path @ what is missing of its coefficients = missing, with this precision."""

    missing: Float[np.ndarray, " doubts"]
    precision: Float[np.ndarray, "doubts doubts"]
    of_path: Float[np.ndarray, "doubts unknowns"]


def _shown(path: CameraPath, taken: Taken, draft: _Draft, others: Sequence[PosedImage]) -> _Shown | None:
    """None where the frame's blur is too short, or too weak, to tell, and where neighbours show too little of it."""
    if taken.length <= SHORT or not taken.followed or not (others := helpful(draft.image, others)):
        return None
    view, flow = taken.view, taken.flow
    if not len((doubted := doubts(path, taken.begins, view.camera.timing)).moves):
        return None
    frame = single_frame.tiled_frame(view, taken.path, DRAFT, flow)
    still = displaced(taken.path, view.camera, flow)
    error = min(PATH_ERROR, taken.length)
    both = fused(frame, draft.image, others, view.camera.intrinsics, view.noise, error, own=draft.own, displaced=still)
    assert both.predicted
    if both.predicted.shown.mean() < LEAST_SHOWN:
        return None
    moves = doubted.moves * pose_factors(taken.scale, doubted.moves.shape[2])
    found = departure(taken.path, moves, both.predicted, view.camera, flow)
    share = ramp(taken.length, SHORT, LONG) * ramp(found.strength, WEAKER, STRONG)
    if share == 0:
        return None
    sheared = SHEAR / taken.scale * doubted.shear
    uncertain = SCATTER**2 * found.covariance + np.diag((ERROR / np.linalg.norm(moves, axis=(1, 2))) ** 2) + sheared @ sheared.T
    return _Shown(missing=found.missing, precision=share * np.linalg.inv(uncertain), of_path=doubted.of_path)
