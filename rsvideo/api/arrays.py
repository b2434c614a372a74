"""Arrays as users hold them: checked, brought to linear light, and back to what they were."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float32

from rsvideo.api.words import transfer_named
from rsvideo.frame import SMALLEST
from rsvideo.physics.tone import Tone, Transfer
from rsvideo.stills import still

SLACK = 0.25  # by which light may leave [0, 1] before it is taken for something else: noise and ringing leave it by less


@dataclass(frozen=True, kw_only=True, eq=False)
class Light:
    """A picture in linear light, and the array that it came from."""

    pixels: Float32[np.ndarray, "rows cols channels"]  # in [0, 1]
    clipped: Bool[np.ndarray, "rows cols channels"]  # where the camera was full
    source: np.ndarray  # as given
    transfer: Tone | None  # of codes; None where the array is light itself

    def like_source(self, pixels: Float32[np.ndarray, "rows cols channels"]) -> np.ndarray:
        """Light of any size in the kind of the array, as codes or float32, and with as many axes."""
        out = pixels if self.transfer is None else still.samples(pixels, self.transfer, self.source.dtype)
        return out if self.source.ndim == 3 else out[..., 0]


def checked(name: str, image: object) -> np.ndarray:
    """The picture as (rows, cols, channels), a view; TypeError or ValueError where it is none."""
    if not isinstance(image, np.ndarray):
        raise TypeError(f"{name} must be a NumPy array, got {type(image).__name__}; rsvideo.read(path) reads files")
    shape = image.shape
    if not (len(shape) == 2 or (len(shape) == 3 and shape[2] in (1, 3))):
        raise ValueError(f"{name} must have the shape (rows, cols) or (rows, cols, 3), got {shape}{_slip(shape)}")
    if min(shape[:2]) < SMALLEST:
        raise ValueError(
            f"{name} must be at least {SMALLEST} x {SMALLEST} px, it is {shape[1]} x {shape[0]};"
            " so small a picture has nothing to measure motion by"
        )
    if is_codes(image):
        return image.reshape(*shape[:2], -1)
    if image.dtype.kind != "f":
        raise TypeError(
            f"{name} must hold uint8 or uint16 codes, or light as floating point, got {image.dtype};"
            " .astype(np.uint8) makes codes of whole numbers up to 255"
        )
    if not (finite := np.isfinite(image)).all():
        row, col = np.argwhere(~finite)[0][:2]
        raise ValueError(
            f"{name} must be finite, {np.count_nonzero(~finite)} values are NaN or infinite, the first at row {row}, column {col}"
        )
    low, high = float(image.min()), float(image.max())
    if low < -SLACK or high > 1 + SLACK:
        slip = "are they codes? uint8 and uint16 arrays are decoded" if high > 1 + SLACK else "is the mean taken off?"
        raise ValueError(f"{name} must hold linear light in [0, 1], got {low:.3g} to {high:.3g}; {slip}")
    return image.reshape(*shape[:2], -1)


def curve(image: object, transfer: str | None) -> Transfer | None:
    """The transfer function that a user names for codes; ValueError where there is none, or where the array is light."""
    if transfer is not None and isinstance(image, np.ndarray) and not is_codes(image):
        raise ValueError("transfer says what codes mean, a floating-point array is linear light already")
    return transfer_named(transfer)


def is_codes(image: np.ndarray) -> bool:
    """Whether an array holds codes, not light."""
    return image.dtype in (np.uint8, np.uint16)


def light(name: str, image: object, transfer: Tone, saturation: float | None = None) -> Light:
    """The linear light of a picture; `transfer` is that of its codes, `saturation` the code in [0, 1] from which on the camera was full."""
    stored = checked(name, image)
    assert isinstance(image, np.ndarray)
    if is_codes(image):
        pixels, clipped = still.light(stored, transfer, saturation)
        return Light(pixels=pixels, clipped=clipped, source=image, transfer=transfer)
    pixels = np.clip(stored, 0, 1).astype(np.float32)
    return Light(pixels=pixels, clipped=pixels >= 1, source=image, transfer=None)


def _slip(shape: tuple[int, ...]) -> str:
    match shape:
        case (_, _, 4):
            return "; is the fourth channel alpha? image[..., :3] leaves it out"
        case (1 | 3 | 4, _, _):
            return "; are the channels first? np.moveaxis(image, 0, -1) puts them last"
        case (_, _, _, _):
            return "; is it a clip? deblur_clip() takes those"
        case _:
            return ""
