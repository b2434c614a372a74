"""JPEG: grey or colour, with its colour profile and its EXIF as they stand."""

import io
import re
import warnings

import imageio.v3 as imageio
import numpy as np
from PIL.JpegImagePlugin import JpegImageFile

from rsvideo.stills.codes import Codes, check_pixels, split

_EXIF = b"Exif\0\0"
_LONGEST_EXIF = 65533 - 2  # bytes that one APP1 segment holds
_MARKER = re.compile(rb"\xff[^\x00\xd0-\xd7\xff]")  # which neither data nor marks of a restart are
_SCAN, _END, _ALONE = b"\xff\xda", b"\xff\xd9", {0x01, 0xD8}  # the last have no length
_MOST_SCANS = 200  # progressive pictures have about ten, sixty-four a channel at the very most
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
            _check_scans(data)
            if image.mode not in ("L", "RGB"):
                raise ValueError(f"must be grey or RGB, it is {image.mode}; convert it to RGB first")
            image.load()
    except (OSError, SyntaxError) as error:
        raise ValueError(f"is damaged: {error}") from error
    samples, alpha = split(np.array(image))
    exif = image.info.get("exif")
    return Codes(samples=samples, alpha=alpha, icc=image.info.get("icc_profile"), exif=exif.removeprefix(_EXIF) if exif else None)


def _check_scans(data: bytes) -> None:
    """Refuse more scans than a picture needs: each costs the time of the whole picture, even if it holds nothing."""
    at, scans = 2, 0
    while (found := _MARKER.search(data, at)) and found[0] != _END:
        at = found.end()
        if found[0][1] not in _ALONE:
            at += int.from_bytes(data[at : at + 2])
        scans += found[0] == _SCAN
        if scans > _MOST_SCANS:
            raise ValueError(f"must have at most {_MOST_SCANS} scans, it has more; is it damaged?")


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
