"""Damaged, odd and hostile pictures, alone and in folders: `case(number)` gives the same attack every time."""

import functools
import io
import struct
import tempfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import tifffile
from PIL import Image

from rsvideo.stills import exr, png
from rsvideo.stills.codes import Codes
from tests.robustness.case import Case, Fault, rng
from tests.video.clips import raw

ROOM = "pictures"
_ROWS, _COLS = 48, 64
_EXTREMES = (0, 1, 2, 3, 0x7F, 0xFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF)
_SIDES = (0, 1, 31, 20_000, 65_535, 1_000_000, 0x7FFFFFFF, 0xFFFFFFFF)
_WRONG = (
    b"",
    b"GIF89a\1\0\1\0",
    b"BM",
    b"RIFF\0\0\0\0WEBPVP8 ",
    b"<svg xmlns='http://www.w3.org/2000/svg'/>",
    b"%PDF-1.4",
    b"\0" * 4096,
    b"P6 64 48 255\n",
)

Damage = Callable[[bytes, np.random.Generator, str], bytes]


def _codes(kind: type, channels: int) -> np.ndarray:
    chance, top = np.random.default_rng(3), np.iinfo(kind).max
    y, x = np.mgrid[:_ROWS, :_COLS]
    waves = np.stack([np.sin(x / (3 + k)) * np.cos(y / (4 + k)) for k in range(channels)], axis=-1)
    return (top * np.clip(0.5 + 0.4 * waves + 0.05 * chance.standard_normal(waves.shape), 0, 1)).astype(kind)


def _saved(form: str, mode: type, channels: int, **how) -> bytes:
    codes, out = _codes(mode, channels), io.BytesIO()
    if form == "TIFF":
        tifffile.imwrite(out, codes if channels > 1 else codes[..., 0], photometric="rgb" if channels > 1 else "minisblack", **how)
    else:
        exif = Image.Exif()
        exif.update({271: "Some Maker", 33434: 0.02, 41989: 28})
        Image.fromarray(codes if channels > 1 else codes[..., 0]).save(out, form, exif=exif, **how)
    return out.getvalue()


@functools.cache
def whole(kind: str) -> bytes:
    """A sound picture of one of KINDS."""
    match kind:
        case "png":
            return _saved("PNG", np.uint8, 3, icc_profile=b"\0\0\2\x0c" + bytes(520))
        case "deep.png":
            return png.encode(Codes(samples=_codes(np.uint16, 3)))
        case "alpha.png":
            return _saved("PNG", np.uint8, 4)
        case "tif":
            return _saved("TIFF", np.uint16, 3, compression="zlib", predictor=True)
        case "plain.tif":
            return _saved("TIFF", np.uint8, 1, rowsperstrip=8)
        case "tiled.tiff":
            return _saved("TIFF", np.uint8, 3, tile=(16, 16), byteorder=">")
        case "jpg":
            return _saved("JPEG", np.uint8, 3, quality=90)
        case "progressive.jpg":
            return _saved("JPEG", np.uint8, 3, progressive=True)
        case "exr":
            return exr.encode(tuple((_codes(np.uint8, 3)[..., k] / 255).astype(np.float32) for k in range(3)))
        case _:
            with tempfile.TemporaryDirectory() as folder:
                return raw(Path(folder, "x.dng"), rows=_ROWS, cols=_COLS).read_bytes()


KINDS = ("png", "tif", "jpg", "dng", "deep.png", "plain.tif", "progressive.jpg", "exr", "alpha.png", "tiled.tiff")


def _cut(data: bytes, chance: np.random.Generator, _: str) -> bytes:
    return data[: int(chance.integers(1, len(data)))]


def _flipped(data: bytes, chance: np.random.Generator, _: str) -> bytes:
    made = bytearray(data)
    for at in chance.integers(0, len(data), int(chance.integers(1, 30))):
        made[at] ^= 1 << int(chance.integers(8))
    return bytes(made)


def _flipped_header(data: bytes, chance: np.random.Generator, kind: str) -> bytes:
    """Bits of what describes the picture; a TIFF's tags stand anywhere, PNG's checksums are made to hold."""
    made = bytearray(data)
    for at in chance.integers(4, min(len(data), 700), int(chance.integers(1, 6))):
        made[at] ^= 1 << int(chance.integers(8))
    return _checked(bytes(made)) if kind.endswith("png") else bytes(made)


def _checked(data: bytes) -> bytes:
    """A PNG whose checksums hold, as far as its chunks can be followed."""
    made, at = bytearray(data), 8
    while at + 12 <= len(made):
        (length,) = struct.unpack_from(">I", made, at)
        if at + 12 + length > len(made):
            break
        struct.pack_into(">I", made, at + 8 + length, zlib.crc32(made[at + 4 : at + 8 + length]))
        at += 12 + length
    return bytes(made)


def _bomb(data: bytes, chance: np.random.Generator, kind: str) -> bytes:
    """A header that promises another size than there is."""
    rows, cols = (int(chance.choice(_SIDES)) for _ in range(2))
    made = bytearray(data)
    if kind.endswith("png"):
        struct.pack_into(">II", made, 16, cols, rows)
        return _checked(bytes(made))
    if kind.endswith("jpg"):
        at = next(at for mark in (b"\xff\xc0", b"\xff\xc2") if (at := data.find(mark)) >= 0)
        struct.pack_into(">HH", made, at + 5, rows & 0xFFFF, cols & 0xFFFF)
        return bytes(made)
    if kind == "exr":
        at = data.find(b"dataWindow") + 11 + 6 + 4
        struct.pack_into("<2i2I", made, at, 0, 0, *((side - 1) % 2**32 for side in (cols, rows)))
        return bytes(made)
    return _tagged(data, {256: cols, 257: rows})


def _tagged(data: bytes, values: dict[int, int]) -> bytes:
    """A TIFF with other values of some tags of its first directory."""
    made, order = bytearray(data), "<" if data[:2] == b"II" else ">"
    (at,) = struct.unpack_from(order + "I", data, 4)
    (count,) = struct.unpack_from(order + "H", data, at)
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind = struct.unpack_from(order + "HH", data, entry)
        if tag in values:
            width = {1: "B", 3: "H"}.get(kind, "I")
            struct.pack_into(order + width, made, entry + 8, values[tag] & (256 ** struct.calcsize(width) - 1))
    return bytes(made)


def _fields(data: bytes, chance: np.random.Generator, kind: str) -> bytes:
    """Extreme numbers in a header's fields: a TIFF's tags, their kinds, counts and places; a PNG's and a JPEG's lengths."""
    made = bytearray(data)
    if data[:2] in (b"II", b"MM"):
        order = "<" if data[:2] == b"II" else ">"
        (at,) = struct.unpack_from(order + "I", data, 4)
        (count,) = struct.unpack_from(order + "H", data, at)
        for _ in range(int(chance.integers(1, 4))):
            entry = at + 2 + 12 * int(chance.integers(count))
            place, width = ((0, "H"), (2, "H"), (4, "I"), (8, "I"))[chance.integers(4)]
            value = int(chance.choice((*_EXTREMES, at, 4, len(data) - 1)))
            struct.pack_into(order + width, made, entry + place, value & (256 ** struct.calcsize(width) - 1))
        return bytes(made)
    for at in chance.integers(0, min(len(data) - 4, 400), int(chance.integers(1, 3))):
        struct.pack_into(">I", made, at, int(chance.choice(_EXTREMES)))
    return _checked(bytes(made)) if kind.endswith("png") else bytes(made)


def _spliced(data: bytes, chance: np.random.Generator, _: str) -> bytes:
    second = whole(KINDS[chance.integers(len(KINDS))])
    at, further = int(chance.integers(len(data))), int(chance.integers(len(second)))
    return data[:at] + second[further:] if chance.random() < 0.7 else data + second


def _foreign(data: bytes, chance: np.random.Generator, _: str) -> bytes:
    begin = _WRONG[chance.integers(len(_WRONG))]
    return begin + chance.bytes(int(chance.integers(0, 3000))) if chance.random() < 0.7 else whole(KINDS[chance.integers(len(KINDS))])


_DAMAGE: tuple[tuple[str, Damage], ...] = (
    ("cut short", _cut),
    ("bits flipped", _flipped),
    ("bits of headers flipped", _flipped_header),
    ("header bombs", _bomb),
    ("fields", _fields),
    ("splices", _spliced),
    ("foreign files", _foreign),
)


def case(number: int) -> Case:
    """One attack on the readers of pictures: a photograph, or one picture of a folder."""
    chance = rng(ROOM, number)
    family, damage = _DAMAGE[number % len(_DAMAGE)]
    kind = KINDS[(number // len(_DAMAGE)) % len(KINDS)]
    data, suffix = damage(whole(kind), chance, kind), Path(f"x.{kind}").suffix
    if suffix in (".exr",) or (suffix in (".png", ".tif", ".tiff", ".dng") and chance.random() < 0.3):
        bad = int(chance.integers(3))
        files = {f"take/a_{n:03d}{suffix}": data if n == bad else whole(kind) for n in range(3)}
        words = ("deblur", "take", "-o", "out.mkv", "--method", "none", "--codec", "ffv1", "--rate", "24")
        source, output = "take", "out.mkv"
    else:
        source, output = f"in{suffix}", "out.png"
        files = {source: data}
        words = ("deblur", source, "-o", output, "--method", "none")
    return Case(
        name=f"{ROOM}/{number}", family=f"pictures: {family}", words=words, fault=Fault.SOURCE, files=files, source=source, output=output
    )
