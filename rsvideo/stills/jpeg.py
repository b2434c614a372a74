"""JPEG: grey or colour, with its colour profile and its EXIF as they stand."""

import io
import warnings

import imageio.v3 as imageio
import numpy as np
from PIL.JpegImagePlugin import JpegImageFile

from rsvideo.stills.codes import Codes, check_pixels, split

_EXIF = b"Exif\0\0"
_LONGEST_EXIF = 65533 - 2  # bytes that one APP1 segment holds
_QUALITY = 95  # of 100: the highest that Pillow recommends, beyond which files grow and pictures hardly gain
_FULL_CHROMA = 0  # as Pillow counts: 4:4:4, a colour of its own for each pixel


def decode(data: bytes) -> Codes:
    """The picture in `data`; CMYK is refused, since its light depends on inks.

    By Pillow's own decoder: imageio's refuses pictures of more than 179 Mpx, and understands the EXIF, which may be damaged.
    """
    try:
        with warnings.catch_warnings(action="ignore"):  # Pillow remarks on damaged EXIF, which does not concern the pixels
            image = JpegImageFile(io.BytesIO(data))
            check_pixels(image.height, image.width)
            if image.mode not in ("L", "RGB"):
                raise ValueError(f"must be grey or RGB, it is {image.mode}; convert it to RGB first")
            image.load()
    except (OSError, SyntaxError) as error:
        raise ValueError(f"is damaged: {error}") from error
    samples, alpha = split(np.array(image))
    exif = image.info.get("exif")
    return Codes(samples=samples, alpha=alpha, icc=image.info.get("icc_profile"), exif=exif.removeprefix(_EXIF) if exif else None)


def encode(codes: Codes) -> bytes:
    """A JPEG file at quality 95 with full colour resolution."""
    pixels = codes.samples[..., 0] if codes.samples.shape[2] == 1 else codes.samples
    extras = {}
    if codes.icc:
        extras["icc_profile"] = codes.icc
    if codes.exif:
        extras["exif"] = _EXIF + codes.exif
    return imageio.imwrite("<bytes>", pixels, plugin="pillow", extension=".jpg", quality=_QUALITY, subsampling=_FULL_CHROMA, **extras)


def fits(exif: bytes) -> bool:
    """Whether a JPEG can hold this much EXIF."""
    return len(_EXIF + exif) <= _LONGEST_EXIF
