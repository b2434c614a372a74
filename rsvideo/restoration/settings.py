"""How frames are restored."""

from dataclasses import dataclass
from typing import Literal

Quality = Literal["draft", "normal", "best"]
Device = Literal["cpu", "cuda"]
MOST_DEGREE = 12  # of the path: one frame does not determine more
DENOISER_MU = 5e-4  # weight of total variation in the image that the denoiser's splitting starts from; origin: by trial
TV_FIRST_STEPS = 10  # of ADMM for that image; origin: by trial


@dataclass(frozen=True, kw_only=True)
class Effort:
    """How much work a frame gets. All are by trial; the page of results has seconds beside decibels."""

    heats: tuple[tuple[int, bool, int], ...]  # of a still's candidate paths: steps, on all columns?, how many go on
    blur_steps: int  # of L-BFGS, in which blur refines a clip's path
    exposure_pixels: int = 480 * 1080  # of a clip's frame, whose focus shows its exposure: 480 columns of so many rows
    neighbours: int  # frames on either side that one of a clip is restored with
    tv_steps: int  # of ADMM where nothing is denoised
    splittings: int  # denoisings of the final image, of which a frame that neighbours help gets the last; 0: what they start from


EFFORTS: dict[Quality, Effort] = {
    "draft": Effort(heats=((3, False, 4), (5, True, 4)), blur_steps=2, exposure_pixels=480 * 135, neighbours=1, tv_steps=7, splittings=0),
    "normal": Effort(heats=((3, False, 6), (5, False, 4), (5, True, 6)), blur_steps=6, neighbours=3, tv_steps=50, splittings=4),
    "best": Effort(heats=((3, False, 12), (5, False, 8), (5, True, 8)), blur_steps=12, neighbours=5, tv_steps=100, splittings=8),
}


@dataclass(frozen=True, kw_only=True)
class Settings:
    """How a frame is restored. The paper's symbols stand behind the names."""

    motion: Literal["rotation", "shift"] = "rotation"
    degree: int = 4  # P; a quartic fits 40 ms of measured hand shake to 0.004-0.035 px RMS, a cubic to several times that
    start: Literal["spectra", "kernels", "tracing"] = "spectra"  # the first trajectory: of patches, of strips with PSFs, or traced
    refinement: Literal["sparsity", "alternation"] = "sparsity"  # latent image eliminated, or the paper's Algorithm 1
    prior: Literal["denoiser", "tv"] = "denoiser"
    quality: Quality = "normal"
    samples: int = 30  # K, path samples an exposure (the paper's, Sec. 5); a longer path takes one a pixel
    mu: float = 1e-2  # the alternation's first weight of total variation (Sec. 5)
    mu_factor: float = 0.7  # tau (Sec. 5)
    mu_last: float = 1e-3  # (Sec. 5)
    mu_final: float = 7e-4  # of the final image, with prior "tv"; origin: by trial
    tolerance: float = 0.25  # px, a tile's error at its edge
    candidates: int = 5  # first trajectories that are refined before one is chosen, and up to as many without one of the strips
    trust: float = 0.15  # in the strips' kernels, against the picture's sparsity; origin: by trial
    frames: Literal["together", "alone", "cold"] = "together"  # of a clip: with their neighbours, along its path only, or as stills
    device: Device = "cpu"  # what computes latent images

    def __post_init__(self) -> None:
        if not 1 <= self.degree <= MOST_DEGREE:
            raise ValueError(f"degree must lie in [1, {MOST_DEGREE}], got {self.degree}; one frame does not determine more")

    @property
    def axes(self) -> int:
        """Of a path: yaw, pitch and roll, or the paper's shift."""
        return 3 if self.motion == "rotation" else 2

    @property
    def effort(self) -> Effort:
        """How much work a frame gets."""
        return EFFORTS[self.quality]

    @property
    def splittings(self) -> int:
        """Denoisings of the final image."""
        return 0 if self.prior == "tv" else self.effort.splittings

    @property
    def tv_steps(self) -> int:
        """Of ADMM, for the final image or for what the denoiser starts from."""
        return TV_FIRST_STEPS if self.splittings else self.effort.tv_steps

    @property
    def final_mu(self) -> float:
        """The weight of total variation in the final image, or in what the denoiser starts from."""
        return self.mu_final if self.prior == "tv" else DENOISER_MU
