"""Sequences of pictures in a folder, one file a picture, read as a clip and written as one."""

import io
import math
import os
import re
from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from pathlib import Path

import numpy as np
import rawpy
import tifffile

from rsvideo.config import media
from rsvideo.config.files import UnreadableError, read_whole, reading
from rsvideo.config.quantity import FASTEST_RATE
from rsvideo.physics.tone import Transfer
from rsvideo.stills import exr, png, raw, tiff
from rsvideo.stills.codes import MOST_BYTES, Codes
from rsvideo.video.stream import Colour, Matrix, Picture, Stream

_KINDS = {".dng": "dng", ".png": "png", ".tif": "tiff", ".tiff": "tiff", ".exr": "exr"}
_SUFFIX = {"png": ".png", "tiff": ".tiff", "exr": ".exr"}
_SUFFIXES = (".tif", *_SUFFIX.values())  # of files that may have been written here
_WILD = re.compile(r"#+|%0?\d*d|\*")
_NUMBER = re.compile(r"([^0-9]*)([0-9]+)(.*)", re.DOTALL)
_FRAME_RATE = 51044  # CinemaDNG's tag
_ROTATION = {3: 180, 5: 90, 6: -90}  # LibRaw's flip, degrees counter-clockwise

_LINEAR = (1, 8, 0, 2)  # primaries, transfer, matrix of H.273, and FFmpeg's full range
_SRGB = (1, 13, 0, 2)


def is_sequence(path: Path) -> bool:
    """Whether a path names a sequence rather than one file: a folder, or a pattern such as `shot_####.dng`."""
    return media.is_folder(path) or (path.suffix.lower() in _KINDS and _WILD.search(path.name) is not None and not path.is_file())


def probe(path: Path, rate: Fraction | None) -> Stream:
    """What a folder or a pattern holds. The rate must be given, unless CinemaDNG states it."""
    files = _files(path)
    kind = _KINDS[files[0].suffix.lower()]
    rotation, stated = _of_raw(files[0]) if kind == "dng" else (0, None)
    rate = rate or stated
    if rate is None:
        raise ValueError(f"the rate of {path} must be given, such as 24 or 24000/1001; pictures in a folder do not say it")
    if not 0 < rate <= FASTEST_RATE:
        raise ValueError(f"the rate of {path} must lie in (0, {FASTEST_RATE}] pictures a second, got {rate}")
    planes, notes = _read(files[0], None)
    rows, cols = planes[0].shape
    times = np.arange(len(files), dtype=np.int64)
    return Stream(
        path=path,
        codec=kind,
        rows=rows,
        cols=cols,
        rate=rate,
        time_base=1 / rate,
        times=times,
        keys=times,
        end=len(files),
        colour=colour_of(kind, planes),
        rotation=rotation,
        display_matrix=_turned(rotation) if rotation else None,
        files=files,
        notes=notes,
    )


def pictures(stream: Stream, first: int, last: int) -> Iterator[Picture]:
    """The pictures first, ..., last - 1; raw ones with the white balance of the sequence's first."""
    balance = _balance(stream.files[0]) if stream.codec == "dng" else None
    for index in range(first, last):
        planes, _ = _read(stream.files[index], balance)
        rows, cols = planes[0].shape
        if (rows, cols) != (stream.rows, stream.cols):
            raise UnreadableError(
                f"{stream.files[index]} must be {stream.cols} x {stream.rows} as the sequence's first picture, it is {cols} x {rows};"
                " does it belong to another take?"
            )
        if (found := colour_of(stream.codec, planes).pixel_format) != stream.colour.pixel_format:
            raise UnreadableError(
                f"{stream.files[index]} must hold {stream.colour.pixel_format} as the sequence's first picture, it holds {found}"
            )
        yield Picture(planes=planes, index=index, pts=index, duration=1, time=stream.seconds(index))


def stem(stream: Stream, index: int, folder: Path) -> str:
    """The name, but for its suffix, under which a picture of a stream is written into a folder."""
    return stream.files[index].stem if stream.files else f"{folder.name}_{index:06d}"


def older(folder: Path, stream: Stream) -> tuple[Path, ...]:
    """The pictures in a folder, if there is one, that a stream's stand for once they are written there.

    Pictures of another take are never replaced, nor are the new ones laid among them: ValueError.
    """
    if not folder.is_dir():
        return ()
    take = {_around(stem(stream, index, folder)) for index in range(stream.frames)}
    found = sorted(file for file in folder.iterdir() if file.suffix.lower() in _KINDS)
    for file in found:
        if not file.is_file() or file.suffix.lower() not in _SUFFIXES or _around(file.stem) not in take:
            raise ValueError(f"{folder} must hold no pictures but those that are replaced, it holds {file.name}; choose another OUTPUT")
    return tuple(found)


def _around(stem: str) -> tuple[str, str]:
    """What stands before and behind the number of a picture's name: the same of all pictures of a take."""
    match = _NUMBER.fullmatch(stem[::-1])  # reversed, the last number comes first
    return (match[3][::-1], match[1][::-1]) if match else (stem, "")


def layout(codec: str, colour: Colour) -> Colour:
    """The layout in which a sequence's files hold a colour: 16 bits in RGB or grey; floating-point light in EXR."""
    grey = colour.subsampling == "4:0:0"
    facts = {"matrix": Matrix.RGB, "subsampling": "4:0:0" if grey else "4:4:4", "chroma_shift": (0, 0), "full_range": True}
    if codec == "exr":
        facts |= {"transfer": Transfer.LINEAR, "depth": 32, "pixel_format": "grayf32le" if grey else "gbrpf32le", "h273": _LINEAR}
    else:
        same = colour.matrix is Matrix.RGB and colour.depth == 8
        facts |= {"depth": 8 if same else 16, "pixel_format": ("gray" if grey else "gbrp") + ("" if same else "16le")}
        if colour.transfer is Transfer.LINEAR:  # which these files are not expected to hold
            facts |= {"transfer": Transfer.SRGB, "h273": _SRGB}
    return replace(colour, **facts)


def write(folder: Path, stem: str, codec: str, picture: Picture) -> None:
    """One picture in the layout that `layout` gives, as a whole file."""
    if codec == "exr":
        data = exr.encode(picture.planes)
    else:
        data = {"png": png, "tiff": tiff}[codec].encode(Codes(samples=np.stack(picture.planes, axis=-1)))
    with (folder / (stem + _SUFFIX[codec])).open("wb") as out:
        out.write(data)
        out.flush()
        os.fsync(out.fileno())


def _files(path: Path) -> tuple[Path, ...]:
    """The files in order of their numbers, none missing."""
    if path.is_dir():
        found = [file for file in path.iterdir() if file.suffix.lower() in _KINDS and file.is_file() and not file.name.startswith(".")]
    else:
        if not path.parent.is_dir():
            raise UnreadableError(f"{path.parent}, the folder of {path.name}, does not exist")
        spelt = [re.escape(part) for part in _WILD.split(path.name)]
        wild = [r".*" if mark == "*" else r"[0-9]+" for mark in _WILD.findall(path.name)]
        pattern = re.compile("".join(part + mark for part, mark in zip(spelt, [*wild, ""], strict=True)), re.DOTALL)
        found = [file for file in path.parent.iterdir() if pattern.fullmatch(file.name) and file.is_file()]
    if not found:
        raise UnreadableError(f"{path} holds no pictures ({', '.join(_KINDS)}); is it the right folder?")
    if len(kinds := sorted({file.suffix.lower() for file in found})) > 1:
        raise UnreadableError(
            f"{path} must hold one kind of picture, it holds {' and '.join(kinds)}; a pattern such as *{kinds[0]} chooses"
        )
    if len(found) == 1:
        return tuple(found)
    numbered = {file: _NUMBER.fullmatch(file.stem[::-1]) for file in found}  # reversed, the last number comes first
    if unnumbered := sorted(file.name for file, match in numbered.items() if match is None):
        raise UnreadableError(f"{path} must hold numbered pictures, {unnumbered[0]} has no number; a pattern leaves it out")
    around = {file: (match[3][::-1], match[1][::-1]) for file, match in numbered.items() if match}
    if len(takes := sorted(set(around.values()))) > 1:
        names = " and ".join(f"{before}####{after}" for before, after in takes[:2])
        raise UnreadableError(f"{path} must hold one sequence, it holds {names}; a pattern chooses one")
    numbers = {file: int(match[2][::-1]) for file, match in numbered.items() if match}
    ordered = sorted(found, key=numbers.__getitem__)
    for one, following in pairwise(ordered):
        if numbers[following] == numbers[one]:
            raise UnreadableError(f"{path} must hold each number once, {one.name} and {following.name} have the same")
        if numbers[following] > numbers[one] + 1:
            before, after = around[one]
            name = f"{before}{numbers[one] + 1:0{len(one.stem) - len(before) - len(after)}d}{after}{one.suffix}"
            raise UnreadableError(f"{path} lacks {name}: after {one.name} comes {following.name}")
    return tuple(ordered)


def _read(file: Path, balance: list[float] | None) -> tuple[tuple[np.ndarray, ...], tuple[str, ...]]:
    """The planes of one file, and what was not taken over."""
    data = read_whole(file, most=MOST_BYTES)
    with reading(file):
        match _KINDS[file.suffix.lower()]:
            case "dng":
                return _developed(data, balance), ()
            case "exr":
                return exr.decode(data), ()
            case kind:
                codes = {"png": png, "tiff": tiff}[kind].decode(data)
                notes = codes.notes + (("its transparency is not carried over",) if codes.alpha is not None else ())
                return tuple(np.ascontiguousarray(codes.samples[..., k]) for k in range(codes.samples.shape[2])), notes


def _developed(data: bytes, balance: list[float] | None) -> tuple[np.ndarray, ...]:
    """Red, green and blue of a raw picture, linear, in 16 bits, without anything automatic."""
    with raw.opened(data) as photograph:
        samples = raw.developed(photograph, user_wb=balance or _balance_of(photograph))
    return tuple(np.ascontiguousarray(samples[..., k]) for k in range(3))


def _balance(file: Path) -> list[float]:
    with reading(file), raw.opened(read_whole(file, most=MOST_BYTES)) as photograph:
        return _balance_of(photograph)


def _balance_of(photograph: rawpy.RawPy) -> list[float]:
    """The multipliers of the four colours as the camera chose them, or those of daylight where it did not."""
    chosen = [float(w) for w in photograph.camera_whitebalance]
    return chosen if all(math.isfinite(w) and w > 0 for w in chosen[:3]) else [float(w) for w in photograph.daylight_whitebalance]


def _of_raw(file: Path) -> tuple[int, Fraction | None]:
    """How the camera was turned, and the rate that CinemaDNG states."""
    data = read_whole(file, most=MOST_BYTES)
    with reading(file), raw.opened(data) as photograph:
        rotation = _ROTATION.get(photograph.sizes.flip, 0)
    try:
        with tifffile.TiffFile(io.BytesIO(data)) as pages:
            number, divisor = pages.pages[0].tags.valueof(_FRAME_RATE)  # pyright: ignore[reportAttributeAccessIssue]
            return rotation, Fraction(number, divisor) if number > 0 < divisor else None
    except Exception:  # not stated, or tifffile raises whatever the damage leads it to
        return rotation, None


def colour_of(kind: str, planes: tuple[np.ndarray, ...]) -> Colour:
    """What the codes of a sequence's pictures mean: of 8, 16 or 32 bits, grey or RGB."""
    grey, floating, deep = len(planes) == 1, planes[0].dtype == np.float32, planes[0].dtype == np.uint16
    linear = kind in ("dng", "exr")
    return Colour(
        matrix=Matrix.RGB,
        transfer=Transfer.LINEAR if linear else Transfer.SRGB,
        primaries="bt709",
        full_range=True,
        depth=32 if floating else 16 if deep else 8,
        subsampling="4:0:0" if grey else "4:4:4",
        pixel_format=("gray" if grey else "gbrp") + ("f32le" if floating else "16le" if deep else ""),
        assumed=frozenset({"primaries"} if linear else {"primaries", "transfer"}),
        h273=_LINEAR if linear else _SRGB,
    )


def _turned(degrees: int) -> tuple[int, ...]:
    """The display matrix of a rotation counter-clockwise."""
    cos, sin = (round(65536 * f(math.radians(degrees))) for f in (math.cos, math.sin))
    return (cos, -sin, 0, sin, cos, 0, 0, 0, 1 << 30)
