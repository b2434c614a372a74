"""Raw photographs: demosaiced in linear light, in sensor order, without automatic brightness."""

import contextlib
import io
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
import rawpy
from jaxtyping import UInt16
from PIL import Image

from rsvideo.stills.codes import Codes, check_pixels
from rsvideo.stills.exif import ORIENTATION, carried, record

_MOST_STRETCHED = 4  # of pixels, by which LibRaw enlarges the picture; cameras have 2 at most
_ORIENTATION_FROM_FLIP = {0: 1, 3: 3, 5: 8, 6: 6}


def decode(data: bytes) -> Codes:
    """16-bit linear codes in sRGB's primaries, with the camera's white balance."""
    with opened(data) as raw:
        samples = developed(raw, use_camera_wb=True)
        full = raw.raw_image_visible >= raw.white_level
        orientation = _ORIENTATION_FROM_FLIP.get(raw.sizes.flip, 1)
    clipped = None
    if full.shape == samples.shape[:2]:  # not so where the sensor's grid is turned or its pixels are not square
        clipped = cv2.dilate(full.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)  # as far as demosaicing spreads it
    return Codes(samples=samples, clipped=clipped, exif=_exif(data, orientation))


@contextlib.contextmanager
def opened(data: bytes) -> Iterator[rawpy.RawPy]:
    """A raw photograph whose size is one that can be; whatever LibRaw refuses becomes ValueError."""
    try:
        with rawpy.imread(io.BytesIO(data)) as raw:
            check_pixels(raw.sizes.raw_height, raw.sizes.raw_width)
            if not 1 / _MOST_STRETCHED <= raw.sizes.pixel_aspect <= _MOST_STRETCHED:
                raise ValueError(f"is damaged: its pixels are {raw.sizes.pixel_aspect:g} times as high as wide")
            yield raw
    except rawpy.LibRawError as error:
        reason = error.args[0].decode() if error.args and isinstance(error.args[0], bytes) else str(error)
        raise ValueError(f"is damaged, or a raw format that LibRaw does not read: {reason}") from error


def developed(raw: rawpy.RawPy, **balance: Any) -> UInt16[np.ndarray, "rows cols 3"]:
    """Red, green and blue, linear, without anything automatic, by a white balance as LibRaw names it."""
    return raw.postprocess(no_auto_bright=True, adjust_maximum_thr=0.0, gamma=(1, 1), output_bps=16, user_flip=0, **balance)


def _exif(data: bytes, orientation: int) -> bytes | None:
    try:
        exif = carried(data)
    except Exception:  # not every raw format is a TIFF structure; Pillow raises whatever that leads it to
        exif = Image.Exif()
    exif[ORIENTATION] = orientation
    return record(exif)
