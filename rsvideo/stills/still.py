"""Still pictures: read into linear light, written back as they came."""

import enum
import re
from dataclasses import dataclass, replace
from pathlib import Path
from types import ModuleType

import numpy as np
from jaxtyping import Bool, Float32, UInt

from rsvideo.config.files import UnreadableError, read_whole, reading
from rsvideo.physics import tone
from rsvideo.physics.tone import Tone, Transfer
from rsvideo.stills import exif
from rsvideo.stills.codes import MOST_BYTES, Codes

_SATURATION = 254 / 255  # codes from here on count as clipped: JPEG's rounding moves a full code by one


class Format(enum.Enum):
    """The kinds of file that hold a still."""

    PNG = (".png",)
    TIFF = (".tif", ".tiff")
    JPEG = (".jpg", ".jpeg")
    RAW = ()  # read only

    @classmethod
    def of_output(cls, path: Path) -> "Format":
        """The format that the name of a file to write asks for."""
        for kind in cls:
            if path.suffix.lower() in kind.value:
                return kind
        names = ", ".join(suffix for kind in cls for suffix in kind.value)
        raise ValueError(f"{path} must end in one of {names}, it ends in {path.suffix!r}; the ending names the format")

    @property
    def module(self) -> ModuleType:
        """The coder; each is loaded when it is needed, since their libraries take time to start."""
        match self:
            case Format.PNG:
                from rsvideo.stills import png as coder
            case Format.TIFF:
                from rsvideo.stills import tiff as coder
            case Format.JPEG:
                from rsvideo.stills import jpeg as coder
            case Format.RAW:
                from rsvideo.stills import raw as coder
        return coder


_SIGNATURES = {
    b"\x89PNG\r\n\x1a\n": Format.PNG,
    b"\xff\xd8\xff": Format.JPEG,
    b"II*\0": Format.TIFF,
    b"MM\0*": Format.TIFF,
    b"II+\0": Format.TIFF,  # beyond 4 GB
    b"MM\0+": Format.TIFF,
}
_RAW = set(
    re.findall(r"\.\w+", ".3fr .arw .cr2 .cr3 .crw .dcr .dng .erf .fff .iiq .kdc .mef .mos .mrw .nef .nrw .orf .pef .raf .rw2 .srw .x3f")
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Still:
    """A photograph in sensor order, with all else that its file states."""

    pixels: Float32[np.ndarray, "rows cols channels"]  # linear light in [0, 1]; 1 channel (grey) or 3
    clipped: Bool[np.ndarray, "rows cols channels"]  # codes at the sensor's or the file's upper limit
    codes: Codes  # as stored: depth, alpha, colour profile, EXIF
    transfer: Tone  # of the codes that are written back
    capture: exif.Capture  # how it was taken
    format: Format
    source: bytes  # the file itself

    @property
    def notes(self) -> tuple[str, ...]:
        """What was not taken over on reading."""
        return self.codes.notes


def read(path: Path, transfer: Tone | None = None, saturation: float | None = None) -> Still:
    """The photograph in a file. `transfer` is sRGB unless given; raw is linear as read and takes `transfer` when written.

    Codes in [0, 1] from `saturation` on count as clipped.
    """
    data = read_whole(path, most=MOST_BYTES)
    kind = _format(path, data)
    with reading(path):
        codes: Codes = kind.module.decode(data)
    pixels, clipped = light(codes.samples, Transfer.LINEAR if kind is Format.RAW else transfer or Transfer.SRGB, saturation)
    return Still(
        pixels=pixels,
        clipped=clipped if codes.clipped is None else clipped | codes.clipped[..., None],
        codes=codes,
        transfer=transfer or Transfer.SRGB,
        capture=exif.capture(data if kind is Format.RAW else codes.exif),
        format=kind,
        source=data,
    )


def light(
    samples: UInt[np.ndarray, "rows cols channels"], transfer: Tone, saturation: float | None = None
) -> tuple[Float32[np.ndarray, "rows cols channels"], Bool[np.ndarray, "rows cols channels"]]:
    """Linear light of uint8 or uint16 codes, and where they are full: from `saturation` in [0, 1] on, if that is given."""
    top = int(np.iinfo(samples.dtype).max)
    by_code = tone.decode(transfer, np.linspace(0, 1, top + 1, dtype=np.float32))
    return by_code[samples], samples >= np.ceil(min(_SATURATION, saturation or 1.0) * top)


def samples(pixels: Float32[np.ndarray, "rows cols channels"], transfer: Tone, depth: np.dtype) -> UInt[np.ndarray, "rows cols channels"]:
    """The codes of linear light in whole numbers of `depth`."""
    return np.rint(tone.encode(transfer, pixels) * np.iinfo(depth).max).astype(depth)


def _format(path: Path, data: bytes) -> Format:
    if path.suffix.lower() in _RAW:
        return Format.RAW
    for signature, kind in _SIGNATURES.items():
        if data.startswith(signature):
            return kind
    raise UnreadableError(
        f"{path} must be a PNG, TIFF, JPEG or raw photograph, its first bytes are {data[:8]!r}; is it another kind of file?"
    )


def encode(still: Still, pixels: Float32[np.ndarray, "rows cols channels"], kind: Format) -> tuple[bytes, tuple[str, ...]]:
    """A file of format `kind` that holds `pixels` in place of the still's own, and what the format could not keep."""
    depth, alpha, record = still.codes.samples.dtype, still.codes.alpha, still.codes.exif
    notes: tuple[str, ...] = ()
    if kind is Format.TIFF and record:
        record, notes = exif.carried_record(record)
    if kind is Format.JPEG:
        if depth != np.uint8:
            notes += (f"JPEG holds 8 bits a sample; {still.codes.bits} are rounded to that",)
        if alpha is not None:
            notes += ("JPEG holds no transparency; it is dropped",)
        if record and not kind.module.fits(record):
            notes += ("the EXIF is too long for JPEG; it is dropped",)
            record = None
        depth, alpha = np.dtype(np.uint8), None
    stored = samples(pixels, still.transfer, depth)
    return kind.module.encode(replace(still.codes, samples=stored, alpha=alpha, exif=record)), notes


def unchanged(still: Still, kind: Format) -> tuple[bytes, tuple[str, ...]]:
    """The still as it was: byte for byte where the format stays the same."""
    return (still.source, ()) if kind is still.format else encode(still, still.pixels, kind)
