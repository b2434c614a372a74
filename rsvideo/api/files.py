"""Photographs and clips read from files, and photographs written."""

import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from fractions import Fraction
from os import PathLike
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, Float32

from rsvideo.api import arrays
from rsvideo.api.treatment import pictures_a_second
from rsvideo.api.words import transfer_named
from rsvideo.config import media
from rsvideo.config.files import write_whole
from rsvideo.physics.tone import Transfer
from rsvideo.stills import exif, still
from rsvideo.stills.codes import Codes
from rsvideo.stills.still import Format, Still
from rsvideo.video import colour, decode
from rsvideo.video.stream import Stream


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """A photograph as `read` gives it.

    Attributes:
        pixels: (rows, cols, 3), or (rows, cols) of a grey one: linear light in [0, 1], float32, in the order in which the file stores it.
        clipped: The same shape: where the sensor or the file was full.
        exposure: Seconds, by EXIF; None where it does not say.
        focal_px: Focal length in pixels, by EXIF's 35 mm equivalent, for an uncropped picture; None where it does not say.
        camera: The camera's model, by EXIF.
        path: The file.
        notes: What was not taken over on reading.
    """

    pixels: Float32[np.ndarray, "..."] = field(repr=False)
    clipped: Bool[np.ndarray, "..."] = field(repr=False)
    exposure: float | None
    focal_px: float | None
    camera: str | None
    path: Path
    notes: tuple[str, ...]
    still: Still = field(repr=False)  # with all that its file held besides

    def __array__(self, dtype: np.dtype | None = None, copy: bool | None = None) -> np.ndarray:
        """`pixels`, so that NumPy and matplotlib take a picture for an array."""
        return np.array(self.pixels, dtype=dtype, copy=copy)


@dataclass(frozen=True, kw_only=True, eq=False)
class Clip:
    """A clip as `read_clip` gives it: its frames are decoded each time one iterates over it, and none is kept.

    Iterating gives (rows, cols, 3) arrays, or (rows, cols) of a grey clip, of linear light in [0, 1], float32, in stored order.

    Attributes:
        path: The file or folder.
        rows, cols: Of a frame, as stored; display rotation is not applied.
        rate: Frames a second, as the file states it, or on average.
        times: (frames,) seconds at which frames are shown, counted from the first.
        transfer: The name of the curve by which codes are decoded.
        notes: What was not taken over on reading.
    """

    path: Path
    rows: int
    cols: int
    rate: Fraction
    times: Float[np.ndarray, " frames"] = field(repr=False)
    transfer: str
    notes: tuple[str, ...]
    stream: Stream = field(repr=False)
    chosen: Transfer | None = field(repr=False)  # by the user

    def __len__(self) -> int:
        return len(self.times)

    def __iter__(self) -> Iterator[np.ndarray]:
        for picture in decode.pictures(self.stream):
            pixels = colour.light(picture, self.stream.colour)[0]
            yield pixels[..., 0] if pixels.shape[2] == 1 else pixels


def read(path: str | PathLike[str], *, transfer: str | None = None) -> Picture:
    """Read a photograph: PNG, TIFF, JPEG or raw. It is neither turned upright nor converted to other primaries.

    Args:
        path: The file.
        transfer: How codes stand for light, by name: "srgb", "bt709", "linear", ... [default: "srgb"; raw is linear as read]

    Raises:
        UnreadableError: The file is missing, damaged, or of another kind.
        ValueError: `transfer` names no curve, or the file is a clip.

    Examples:
        >>> import rsvideo
        >>> photograph = rsvideo.read("samples/coffee/blurred.png")
        >>> photograph.pixels.shape, photograph.pixels.dtype.name
        ((382, 564, 3), 'float32')
    """
    path, curve = Path(path), transfer_named(transfer)
    if media.is_clip(path):
        raise ValueError(f"{path} is taken for a clip; read_clip(path) opens those")
    found = still.read(path, curve)
    grey = found.pixels.shape[2] == 1
    return Picture(
        pixels=found.pixels[..., 0] if grey else found.pixels,
        clipped=found.clipped[..., 0] if grey else found.clipped,
        exposure=found.capture.exposure,
        focal_px=found.capture.focal_px(*found.pixels.shape[:2]),
        camera=found.capture.camera,
        path=path,
        notes=found.notes,
        still=found,
    )


def read_clip(path: str | PathLike[str], *, transfer: str | None = None, rate: float | str | Fraction | None = None) -> Clip:
    """Open a clip: MP4, MOV, MKV, or a folder of pictures. No frame is decoded yet, and no sound ever.

    Args:
        path: A file, a folder, or a pattern such as shot_####.dng.
        transfer: How codes stand for light, by name: "srgb", "bt709", "s-log3", ... [default: the clip's tag]
        rate: Frames a second of a folder of pictures, such as 24 or "24000/1001".

    Raises:
        UnreadableError: The file is missing, damaged, or of another kind.
        ValueError: `transfer` or `rate` cannot be meant, `rate` is missing, or the file is a photograph.

    Examples:
        >>> import rsvideo
        >>> clip = rsvideo.read_clip("samples/clip/blurred.mp4")
        >>> len(clip), clip.rate, clip.transfer
        (12, Fraction(24, 1), 'bt709')
        >>> [frame.shape for frame in clip][:2]
        [(216, 384, 3), (216, 384, 3)]
    """
    path, curve = Path(path), transfer_named(transfer)
    if not media.is_clip(path):
        raise ValueError(f"{path} is taken for a photograph, clips are .mp4, .mov, .mkv or folders; read(path) reads photographs")
    return _clip(path, curve, pictures_a_second(rate))


def write(
    path: str | PathLike[str],
    picture: Picture | np.ndarray,
    *,
    like: Picture | None = None,
    transfer: str | None = None,
    overwrite: bool = False,
) -> tuple[str, ...]:
    """Write a photograph: PNG, TIFF or JPEG, by the suffix of `path`. It writes no clips; `rsvideo deblur` does.

    Args:
        path: The file; it appears whole or not at all.
        picture: A `Picture`, or an array as `deblur` takes it: codes are stored as they are, light as 16 bits a sample (JPEG: 8).
        like: The photograph whose bit depth, transfer function, EXIF, colour profile and transparency an array of light takes over.
        transfer: How light is stored, by name. [default: that of `like`, or "srgb"]
        overwrite: Replace a file of that name.

    Returns:
        What the format could not keep, in words.

    Raises:
        ValueError: The suffix names no format, or the array cannot be meant.
        FileExistsError: The file exists, and `overwrite` is not given.
        OSError: The file cannot be written.

    Examples:
        >>> import tempfile, pathlib, numpy as np, rsvideo
        >>> photograph = rsvideo.read("samples/coffee/blurred.png")
        >>> with tempfile.TemporaryDirectory() as folder:
        ...     rsvideo.write(pathlib.Path(folder) / "darker.png", 0.5 * photograph.pixels, like=photograph)
        ...     rsvideo.read(pathlib.Path(folder) / "darker.png").pixels.shape
        ()
        (382, 564, 3)
    """
    path = Path(path)
    kind = Format.of_output(path)
    if os.path.lexists(path) and not overwrite:
        raise FileExistsError(f"{path} exists already; overwrite=True replaces it")
    curve = transfer_named(transfer)
    if isinstance(picture, Picture):
        picture, like = picture.pixels, like or picture
    stored = arrays.checked("picture", picture)
    if arrays.is_codes(picture):
        if like is not None or transfer is not None:
            raise ValueError("like and transfer concern light, the array holds codes, which are stored as they are")
        codes = Codes(samples=stored)
        if kind is Format.JPEG and picture.dtype != np.uint8:
            raise ValueError(f"JPEG holds 8 bits a sample, the array holds {picture.dtype}; write PNG or TIFF")
        data, notes = kind.module.encode(codes), ()
    else:
        base = like.still if like else _plain(stored)
        if base.codes.samples.shape[:2] != stored.shape[:2]:
            rows, cols = base.codes.samples.shape[:2]
            raise ValueError(f"like must be of the array's size, {stored.shape[1]} x {stored.shape[0]} px, it is {cols} x {rows}")
        base = replace(base, transfer=curve or base.transfer)
        data, notes = still.encode(base, np.clip(stored, 0, 1).astype(np.float32), kind)
    write_whole({path: data})
    return notes


def _clip(path: Path, transfer: Transfer | None, rate: Fraction | None) -> Clip:
    stream = decode.probe(path, rate)
    if transfer is not None:
        stream = replace(stream, colour=replace(stream.colour, transfer=transfer))
    return Clip(
        path=path,
        rows=stream.rows,
        cols=stream.cols,
        rate=stream.rate,
        times=(stream.times - stream.times[0]) * float(stream.time_base),
        transfer=stream.colour.transfer.value,
        notes=stream.notes,
        stream=stream,
        chosen=transfer,
    )


def _plain(stored: np.ndarray) -> Still:
    """A photograph of 16 bits a sample, that comes from no file."""
    blank = np.zeros(stored.shape, np.uint16)
    return Still(
        pixels=np.zeros(stored.shape, np.float32),
        clipped=np.zeros(stored.shape, bool),
        codes=Codes(samples=blank),
        transfer=Transfer.SRGB,
        capture=exif.Capture(),
        format=Format.PNG,
        source=b"",
    )
