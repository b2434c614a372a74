"""A picture as its file holds it: integer codes, and what travels with them."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, UInt

from rsvideo.config import memory

MOST_PIXELS = 200_000_000
MOST_BYTES = 2_000_000_000
_BYTES_A_PIXEL = 30  # while a picture is decoded and brought into linear light; 33 were measured


@dataclass(frozen=True, kw_only=True, eq=False)
class Codes:
    """What a decoder hands over and an encoder takes, in stored order."""

    samples: UInt[np.ndarray, "rows cols channels"]  # uint8 or uint16; 1 channel (grey) or 3 (red, green, blue)
    alpha: UInt[np.ndarray, "rows cols"] | None = None  # straight, not multiplied into the samples
    clipped: Bool[np.ndarray, "rows cols"] | None = None  # where the sensor was full, if the decoder could tell
    icc: bytes | None = None
    exif: bytes | None = None  # a TIFF structure, as JPEG and PNG embed it
    notes: tuple[str, ...] = ()  # what the reader should know was not taken over

    @property
    def bits(self) -> int:
        """Bits per sample."""
        return 8 * self.samples.dtype.itemsize


def check_pixels(rows: int, cols: int, *, most: int = MOST_PIXELS) -> None:
    """Refuse a size that a header states before anything of that size is made."""
    if min(rows, cols) < 1 or rows * cols > most:
        raise ValueError(
            f"must hold at least a pixel and at most {most / 1e6:g} Mpx, its header says {cols} x {rows}; is the header damaged?"
        )
    there = memory.available()
    if there is not None and (needed := _BYTES_A_PIXEL * rows * cols) > there:
        raise ValueError(
            f"needs about {needed / 1e9:.2g} GB of memory to be decoded: its header says {cols} x {rows}; there are {there / 1e9:.2g} GB"
        )


def split(stored: UInt[np.ndarray, "..."]) -> tuple[np.ndarray, np.ndarray | None]:
    """Colour and alpha of an array with 1 to 4 channels."""
    stored = stored[..., None] if stored.ndim == 2 else stored
    if stored.ndim != 3 or stored.shape[2] not in (1, 2, 3, 4) or not stored.size:
        raise ValueError(f"must be rows of pixels with 1 to 4 channels, it is an array of {' x '.join(map(str, stored.shape))}")
    return (stored, None) if stored.shape[2] % 2 else (stored[..., :-1], stored[..., -1])


def joined(codes: Codes) -> UInt[np.ndarray, "rows cols channels"]:
    """Colour and alpha in one array, the inverse of `split`."""
    return codes.samples if codes.alpha is None else np.concatenate([codes.samples, codes.alpha[..., None]], axis=2)
