"""Raw photographs: demosaiced in linear light, in sensor order, without automatic brightness."""

import io

import cv2
import numpy as np
import rawpy
from PIL import Image

from rsvideo.stills.codes import Codes, check_pixels
from rsvideo.stills.exif import ORIENTATION, carried, record

_ORIENTATION_FROM_FLIP = {0: 1, 3: 3, 5: 8, 6: 6}


def decode(data: bytes) -> Codes:
    """16-bit linear codes in sRGB's primaries, with the camera's white balance."""
    try:
        with rawpy.imread(io.BytesIO(data)) as raw:
            check_pixels(raw.sizes.raw_height, raw.sizes.raw_width)
            samples = raw.postprocess(
                use_camera_wb=True, no_auto_bright=True, adjust_maximum_thr=0.0, gamma=(1, 1), output_bps=16, user_flip=0
            )
            full = raw.raw_image_visible >= raw.white_level
            orientation = _ORIENTATION_FROM_FLIP.get(raw.sizes.flip, 1)
    except rawpy.LibRawError as error:
        reason = error.args[0].decode() if error.args and isinstance(error.args[0], bytes) else str(error)
        raise ValueError(f"is damaged, or a raw format that LibRaw does not read: {reason}") from error
    clipped = None
    if full.shape == samples.shape[:2]:  # not so where the sensor's grid is turned or its pixels are not square
        clipped = cv2.dilate(full.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)  # as far as demosaicing spreads it
    return Codes(samples=samples, clipped=clipped, exif=_exif(data, orientation))


def _exif(data: bytes, orientation: int) -> bytes | None:
    try:
        exif = carried(data)
    except Exception:  # not every raw format is a TIFF structure; Pillow raises whatever that leads it to
        exif = Image.Exif()
    exif[ORIENTATION] = orientation
    return record(exif)
