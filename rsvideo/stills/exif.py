"""What a camera wrote about a picture: read for the timing, and carried from one format to another."""

import io
from dataclasses import dataclass

from PIL import Image

_CARRIED = (  # of the first directory: description, make, model, orientation, resolution, software, date, artist, copyright
    (270, 271, 272, 274, 282, 283, 296, 305, 306, 315, 33432)
)
ORIENTATION, _EXIF, _GPS = 274, 0x8769, 0x8825
_INTEROPERABILITY = 0xA005  # an offset into the file it came from
FULL_FRAME_DIAGONAL = 43.266615  # mm, of 36 x 24


@dataclass(frozen=True, kw_only=True)
class Shot:
    """How a picture was taken; None where the camera did not say, or wrote 0."""

    exposure: float | None = None  # seconds
    focal_mm: float | None = None
    focal_35mm: float | None = None  # the equivalent on 36 x 24 mm
    camera: str | None = None

    def focal_px(self, rows: int, cols: int) -> float | None:
        """The focal length in pixels of an uncropped picture; equivalence is by the diagonal (CIPA DCG-001)."""
        return self.focal_35mm * (rows**2 + cols**2) ** 0.5 / FULL_FRAME_DIAGONAL if self.focal_35mm else None


def shot(data: bytes | None) -> Shot:
    """What an EXIF record, or a whole file that holds one, says; nothing if it is damaged."""
    import exifread

    if not data:
        return Shot()
    try:
        tags = exifread.process_file(io.BytesIO(data), details=False)
    except Exception:  # exifread raises whatever the damage leads it to
        return Shot()
    return Shot(
        exposure=_number(tags.get("EXIF ExposureTime")),
        focal_mm=_number(tags.get("EXIF FocalLength")),
        focal_35mm=_number(tags.get("EXIF FocalLengthIn35mmFilm")),
        camera=str(tags["Image Model"]).strip() or None if "Image Model" in tags else None,
    )


def _number(tag: object) -> float | None:
    try:
        value = float(tag.values[0])  # pyright: ignore[reportAttributeAccessIssue] # exifread's tags are not typed
    except (AttributeError, IndexError, TypeError, ValueError, ZeroDivisionError):
        return None
    return value if 0 < value < float("inf") else None


def carried(record: bytes) -> Image.Exif:
    """The part of a TIFF structure (a whole TIFF file too) that is true of the picture in any format."""
    source = Image.Exif()
    source.load(record)
    kept = Image.Exif()
    kept.endian = "<"
    for tag in _CARRIED:
        if tag in source:
            kept[tag] = source[tag]
    for directory in (_EXIF, _GPS):
        if tags := source.get_ifd(directory):
            kept[directory] = {tag: value for tag, value in tags.items() if tag != _INTEROPERABILITY}
    return kept


def record(exif: Image.Exif) -> bytes | None:
    """The TIFF structure that JPEG and PNG embed; None if there is nothing to say."""
    return exif.tobytes().removeprefix(b"Exif\0\0") if len(exif) else None


def carried_record(source: bytes) -> tuple[bytes | None, tuple[str, ...]]:
    """`carried` as bytes, and a note if the source is damaged."""
    try:
        return record(carried(source)), ()
    except Exception:  # Pillow raises whatever the damage leads it to
        return None, ("its EXIF is damaged and is not carried over",)
