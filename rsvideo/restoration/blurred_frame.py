"""What the restoration asks of a frame and its blur, wherever that is computed."""

from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from rsvideo.restoration.settings import Device


@runtime_checkable
class BlurredFrame(Protocol):
    """A frame with its blur, on the device where its latent image is computed: here, or on a GPU (`rsvideo.gpu.frame`).

    Latent images and pictures stay on that device from `from_host` until `to_host`; what `observed` and `covered` give lies in the
    host's memory.
    """

    @property
    def device(self) -> Device:
        """Where that is."""
        ...

    @property
    def shape(self) -> tuple[int, int, int]:
        """Rows, columns, channels."""
        ...

    def observed(self) -> tuple[Float[np.ndarray, "rows cols channels"], Float[np.ndarray, "rows cols"]]:
        """The frame b, and 1 where it is data in all channels."""
        ...

    def blurred(self, image: Any) -> Any:
        """K image (rows, cols), what lies beyond it continued from its borders."""
        ...

    def covered(self) -> Float[np.ndarray, "rows cols"]:
        """K^T 1 over what is data in all channels: how much of each latent pixel's light was observed, 1 where all of it was."""
        ...

    def towards(self, target: Any, ridge: float) -> Any:
        """argmin_l |K l - b|^2 + ridge |l - target|^2."""
        ...

    def total_variation(self, mu: float, *, steps: int) -> Any:
        """The tiles' latent images under total variation."""
        ...

    def nearest(self, latents: Any, target: Any, ridge: float) -> Any:
        """argmin_l |K l - b|^2 + ridge |l - target|^2; beyond the frame the target is the latent image itself."""
        ...

    def blended(self, latents: Any) -> Any:
        """The picture that the tiles' latent images make."""
        ...

    def unexplained(self, latents: Any) -> float:
        """The mean square of b - K l over what was observed, away from the tiles' sides, in all channels."""
        ...

    def match(self, guide: Any) -> Any:
        """Which patches of a picture look like which."""
        ...

    def denoise(self, image: Any, sigma: float, *, pilot: Any = None, matches: Any = None) -> Any:
        """A picture without noise of standard deviation `sigma`."""
        ...

    def from_host(self, image: Float[np.ndarray, "rows cols channels"]) -> Any:
        """A picture on the device."""
        ...

    def to_host(self, image: Any) -> Float[np.ndarray, "rows cols channels"]:
        """A picture in the host's memory."""
        ...


@runtime_checkable
class Eliminated(Protocol):
    """The latent images of a scene's tiles as functions of its trajectory, on a GPU (`rsvideo.gpu.sparsity`)."""

    widths: tuple[int, ...]  # columns of each tile; beyond them, what follows shows nothing of it
    frames: Any  # the tiles' blurred frames, (tiles, rows, cols)
    images: Any  # their latent images on the same pixels
    slopes: Any  # where the derivative of a measure in these is to be written

    def derivative(self) -> Float[np.ndarray, "tiles rows samples 2"]:
        """Of the measure in every path sample's displacement, once all slopes are written."""
        ...
