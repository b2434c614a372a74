"""How frames are restored."""

from dataclasses import dataclass
from typing import Literal

MOST_DEGREE = 12  # of the path: one frame does not determine more
DENOISER_MU = 5e-4  # weight of total variation in the image that the denoiser's splitting starts from; origin: by trial


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a frame is restored. The paper's symbols stand behind the names."""

    motion: Literal["rotation", "shift"] = "rotation"
    degree: int = 4  # P; a quartic fits 40 ms of measured hand shake to 0.004-0.035 px RMS, a cubic to several times that
    start: Literal["spectra", "kernels", "tracing"] = "spectra"  # the first trajectory: of patches, of strips with PSFs, or traced
    refinement: Literal["sparsity", "alternation"] = "sparsity"  # latent image eliminated, or the paper's Algorithm 1
    prior: Literal["denoiser", "tv", "draft"] = "denoiser"
    samples: int = 30  # K, path samples an exposure (the paper's, Sec. 5); a longer path takes one a pixel
    mu: float = 1e-2  # the alternation's first weight of total variation (Sec. 5)
    mu_factor: float = 0.7  # tau (Sec. 5)
    mu_last: float = 1e-3  # (Sec. 5)
    mu_final: float = 7e-4  # of the final image, with prior "tv"; origin: by trial
    tolerance: float = 0.25  # px, a tile's error at its edge
    candidates: int = 5  # first trajectories that are refined before one is chosen, and up to as many without one of the strips
    trust: float = 0.15  # in the strips' kernels, against the picture's sparsity; origin: by trial
    frames: Literal["together", "alone", "cold"] = "together"  # of a clip: with their neighbours, along its path only, or as stills
    device: Literal["cpu", "cuda"] = "cpu"  # what computes latent images

    def __post_init__(self) -> None:
        if not 1 <= self.degree <= MOST_DEGREE:
            raise ValueError(f"degree must lie in [1, {MOST_DEGREE}], got {self.degree}; one frame does not determine more")

    @property
    def axes(self) -> int:
        """Of a path: yaw, pitch and roll, or the paper's shift."""
        return 3 if self.motion == "rotation" else 2

    @property
    def final_mu(self) -> float:
        """The weight of total variation in the final image, or in what the denoiser starts from."""
        return self.mu_final if self.prior == "tv" else DENOISER_MU
