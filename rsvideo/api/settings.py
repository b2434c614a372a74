"""What a user may steer of a restoration."""

from dataclasses import dataclass
from typing import Literal, get_args

from rsvideo.api.words import one_of
from rsvideo.config import request
from rsvideo.restoration.settings import Settings as RestorationSettings

Motion = Literal["rotation", "shift"]
Start = Literal["spectra", "kernels", "tracing"]
Refinement = Literal["sparsity", "alternation"]
Prior = Literal["denoiser", "tv"]
Quality = Literal["draft", "normal", "best"]
Frames = Literal["together", "alone", "cold"]
Device = Literal["auto", "cpu", "cuda"]

_CHOICES = {
    "motion": Motion,
    "start": Start,
    "refinement": Refinement,
    "prior": Prior,
    "quality": Quality,
    "frames": Frames,
    "device": Device,
}
_MOTION, _DEBLUR = request.Motion(), request.Deblur()  # their defaults


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a picture is restored; the defaults are those of the command line.

    Args:
        motion: "rotation" is all three angles of the camera; "shift" is the paper's, which needs no focal length.
        degree: Of the polynomial that is the trajectory of one picture, 1 to 12.
        start: Where the first trajectory comes from: the power spectra of patches ("spectra"), a fit of PSFs to the kernels of strips
            ("kernels"), or the paper's tracing of these ("tracing").
        refinement: How it is refined: with the latent image eliminated ("sparsity"), or by the paper's Algorithm 1 ("alternation").
        prior: What a sharp picture is taken to look like: "denoiser" (collaborative filtering), or the paper's total variation, "tv".
        quality: How much work a frame gets: "draft", "normal" or "best".
        frames: Of a clip: each restored with its neighbours ("together"), along the clip's path only ("alone"), or as a still ("cold").
        device: What restores: "cpu", "cuda" (an NVIDIA GPU, by the extra gpu), or "auto", a GPU if there is one.

    Raises:
        ValueError: A value is out of its bounds, or none of the words above.

    Examples:
        >>> import rsvideo
        >>> rsvideo.Settings(prior="tv").prior
        'tv'
        >>> rsvideo.Settings(degree=99)
        Traceback (most recent call last):
        ValueError: degree must lie in [1, 12], got 99; one frame does not determine more
    """

    motion: Motion = _MOTION.model
    degree: int = _MOTION.degree
    start: Start = _MOTION.start
    refinement: Refinement = _MOTION.refinement
    prior: Prior = _DEBLUR.prior
    quality: Quality = _DEBLUR.quality
    frames: Frames = _DEBLUR.frames
    device: Device = _DEBLUR.device

    def __post_init__(self) -> None:
        for name, choices in _CHOICES.items():
            one_of(name, getattr(self, name), get_args(choices))
        RestorationSettings(degree=self.degree)  # refuses one that no frame determines

    def sections(self) -> tuple[request.Motion, request.Deblur]:
        """The same as a request has it."""
        motion = request.Motion(model=self.motion, degree=self.degree, start=self.start, refinement=self.refinement)
        return motion, request.Deblur(prior=self.prior, quality=self.quality, frames=self.frames, device=self.device)
