"""How noisy a pixel is, by its light."""

import math
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

USUAL_NOISE = 0.003  # standard deviation at half of white: about that of a phone at a low sensitivity


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Gaussian read noise and shot noise: at linear light L in [0, 1] the variance is read^2 + shot * L."""

    read: float  # standard deviation without light
    shot: float  # variance that white adds

    def __post_init__(self) -> None:
        if not (math.isfinite(self.read) and 0 <= self.read < 1 and math.isfinite(self.shot) and 0 <= self.shot < 1):
            raise ValueError(f"noise must lie in [0, 1) of white, got read {self.read:g} and shot {self.shot:g}; is it in 8-bit codes?")

    @classmethod
    def at_half(cls, sigma: float) -> "Noise":
        """That of standard deviation `sigma` at half of white, of which shot noise makes half the variance."""
        if not (math.isfinite(sigma) and 0 <= sigma < 1):
            raise ValueError(f"noise must lie in [0, 1) of white, got {sigma:g}; is it in 8-bit codes?")
        return cls(read=sigma / math.sqrt(2), shot=sigma**2)

    def at(self, light: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """The standard deviation at this light."""
        return np.sqrt(self.read**2 + self.shot * np.maximum(light, 0))

    def added_to(self, light: Float[np.ndarray, "*n"], rng: np.random.Generator) -> Float[np.ndarray, "*n"]:
        """The light as one exposure shows it, with noise drawn from `rng`."""
        return light + rng.standard_normal(light.shape) * self.at(light)

    def over(self, pixels: Float[np.ndarray, "rows cols channels"]) -> float:
        """The standard deviation of a whole picture's pixels, each channel by itself: the root of the mean variance."""
        return math.sqrt(self.read**2 + self.shot * float(np.maximum(pixels, 0).mean(dtype=np.float64)))
