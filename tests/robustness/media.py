"""Damaged, odd and hostile clips, each made from a real one: `case(number)` gives the same attack every time."""

import functools
import struct
import tempfile
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np

from tests.robustness.boxes import Part, boxes, elements
from tests.robustness.case import Case, Fault, rng
from tests.video.clips import FRAMES, make

ROOM = "media"
_WORDS = (0, 1, 2, 7, 8, 0x7F, 0xFF, 0x100, 0x7FFF, 0xFFFF, 0x10000, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFE, 0xFFFFFFFF, 50_000_000)
_CLOCKS = (b"mvhd", b"mdhd", b"tkhd", b"elst", b"stts", b"ctts", b"tfdt", b"trun", b"mehd")
_TABLES = (b"stts", b"stss", b"ctts", b"stsc", b"stsz", b"stco", b"stsd", b"trun", b"tfhd", b"sdtp", b"trex")
_TEXTS = (
    b"",
    b"#EXTM3U\n",
    b"GIF89a",
    b"RIFF\xff\xff\xff\xffAVI LIST",
    b"YUV4MPEG2 W64 H48 F24:1\nFRAME\n",
    b"FLV\x01\x05\0\0\0\x09",
    b"\x47" * 188,
)


class Made(NamedTuple):
    """A damaged clip."""

    data: bytes
    suffix: str
    frames: int | None = None  # that a result must have, where the damage cannot change how many there are


_KINDS: tuple[tuple[str, dict], ...] = (
    (".mp4", {"codec": "libx264"}),
    (".mov", {"codec": "libx264", "sound": True, "timecode": "01:00:00:00", "rotation": 90}),
    (".mkv", {"codec": "ffv1", "muxer": {"write_crc32": "0"}}),
    (".mp4", {"codec": "libx264", "options": {"bf": "2", "g": "4"}, "tags": {"make": "GoPro", "model": "X"}, "chapters": True}),
    (".mkv", {"codec": "libx264", "sound": True}),
    (".mov", {"codec": "prores_ks", "layout": "yuv422p10le"}),
    (".mp4", {"codec": "libx264", "muxer": {"movflags": "frag_keyframe+empty_moov"}}),
    (".mp4", {"codec": "libx265"}),
    (".mov", {"codec": "mjpeg", "layout": "yuvj420p"}),
    (".mkv", {"codec": "libx264", "muxer": {"live": "1"}}),
    (".mp4", {"codec": "mpeg4", "base": Fraction(1, 24_000), "times": [1000 * n + (n % 3) * 7 for n in range(FRAMES)]}),
)


@functools.cache
def whole(kind: int) -> bytes:
    """A sound clip of one of the kinds."""
    suffix, how = _KINDS[kind]
    with tempfile.TemporaryDirectory() as folder:
        return make(Path(folder, f"clip{suffix}"), **how).read_bytes()


@functools.cache
def other_size(kind: int) -> bytes:
    """A clip of the same kind with other pictures, of another size."""
    suffix, how = _KINDS[kind]
    with tempfile.TemporaryDirectory() as folder:
        return make(Path(folder, f"clip{suffix}"), **{**how, "rows": 80, "cols": 96}).read_bytes()


def _parts(data: bytes) -> list[Part]:
    return list(elements(data) if data.startswith(b"\x1aE\xdf\xa3") else boxes(data))


def _cut(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    return data[: int(chance.integers(1, len(data)))], FRAMES


def _flipped(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    """Bits anywhere."""
    made = bytearray(data)
    for at in chance.integers(0, len(data), int(chance.integers(1, 30))):
        made[at] ^= 1 << int(chance.integers(8))
    return bytes(made), None


def _flipped_header(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    """Bits of what describes the pictures, not of the pictures."""
    parts = [part for part in _parts(data) if part.kind not in (b"mdat", b"\xa3", b"\xa1") and part.end - part.at < 2000]
    made = bytearray(data)
    for _ in range(int(chance.integers(1, 6))):
        part = parts[chance.integers(len(parts))]
        made[chance.integers(part.at, part.end)] ^= 1 << int(chance.integers(8))
    return bytes(made), None


def _zeroed(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    """A stretch that a disk lost."""
    at, length = int(chance.integers(len(data))), int(chance.integers(1, 4096))
    return (data[:at] + bytes(length) + data[at + length :])[: len(data)], None


def _sized(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    """A part that says that it is shorter or longer than it is: it overlaps the next, or leaves a gap."""
    parts = _parts(data)
    part, made = parts[chance.integers(len(parts))], bytearray(data)
    if data[4:8] == b"ftyp":
        length = part.end - part.at
        near = (length - 8, length - 4, length - 1, length + 1, length + 4, length + 8, 2 * length, length + 1000)
        struct.pack_into(">I", made, part.at, int(chance.choice((*_WORDS, *near))) & 0xFFFFFFFF)
    else:
        at = part.at + len(part.kind)
        made[at] = int(chance.integers(256))
        if part.body - at > 1 and chance.random() < 0.5:
            made[at + 1 : part.body] = bytes([int(chance.choice((0, 1, 0xFE, 0xFF)))]) * (part.body - at - 1)
    return bytes(made), None


def _long_sized(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    """A box with a length of 64 bits, absurd or right."""
    parts = _parts(data)
    part = parts[chance.integers(len(parts))]
    length = int(chance.choice((0, 8, 15, 16, part.end - part.at + 8, 2**31, 2**62, 2**63 - 1)))
    return data[: part.at] + struct.pack(">I4sQ", 1, part.kind[:4].ljust(4), length) + data[part.body :], None


def _nested(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    """Boxes within boxes, deep enough to end a recursion."""
    parts = [part for part in _parts(data) if part.kind in (b"moov", b"trak", b"mdia", b"stbl", b"udta", b"\x16T\xaek", b"\xa0", b"\xae")]
    if not parts:
        return data[:100], FRAMES
    part = parts[chance.integers(len(parts))]
    depth = int(chance.choice((2, 50, 1200, 20_000)))
    inner, kind = data[part.at : part.end] if chance.random() < 0.5 else b"", part.kind
    if data[4:8] == b"ftyp":
        heads = b"".join(struct.pack(">I4s", len(inner) + 8 * (depth - n), kind) for n in range(depth))
    else:
        heads = b"".join(kind + (len(inner) + (len(kind) + 4) * (depth - 1 - n) | 0x10000000).to_bytes(4) for n in range(depth))
    return data[: part.at] + heads + inner + data[part.end :], None


def _rearranged(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    """A part missing, twice, renamed, emptied, or in another's place."""
    parts = _parts(data)
    part, more = (parts[chance.integers(len(parts))] for _ in range(2))
    held = data[part.at : part.end]
    match int(chance.integers(5)):
        case 0:
            made = data[: part.at] + data[part.end :]
        case 1:
            made = data[: part.end] + held + data[part.end :]
        case 2:
            made = data[: part.body - 4] + bytes(chance.integers(32, 127, 4).tolist()) + data[part.body :]
        case 3:
            made = data[: part.body] + bytes(part.end - part.body) + data[part.end :]
        case _:
            made = data[: more.at] + held + data[more.end :]
    return made, None


def _worded(data: bytes, chance: np.random.Generator, kinds: tuple[bytes, ...]) -> tuple[bytes, int | None]:
    """Extreme numbers in the fields of some boxes."""
    parts = [part for part in _parts(data) if (part.kind in kinds if data[4:8] == b"ftyp" else 0 < part.end - part.body <= 8)]
    made = bytearray(data)
    for _ in range(int(chance.integers(1, 4))):
        part = parts[chance.integers(len(parts))]
        if data[4:8] == b"ftyp" and part.end - part.body >= 8:
            at = part.body + 4 * int(chance.integers((part.end - part.body) // 4))
            struct.pack_into(">I", made, min(at, part.end - 4), int(chance.choice(_WORDS)))
        else:
            value = int(chance.choice((0, 1, 2**31, 2**63 - 1, 2**64 - 1)))
            made[part.body : part.end] = value.to_bytes(9)[-(part.end - part.body) :]
    return bytes(made), None


def _tables(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    return _worded(data, chance, _TABLES)


def _clocks(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    return _worded(data, chance, _CLOCKS)


def _backwards(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    """Times that stand still, go back, or leap."""
    made = bytearray(data)
    for part in _parts(data):
        if part.kind == b"stts":
            struct.pack_into(">I", made, part.body + 12, int(chance.choice((0, 1, 0x7FFFFFFF, 0xFFFFFFFF, 0xFFFFFF00))))
        elif part.kind == b"ctts":
            for at in range(part.body + 12, part.end - 3, 8):
                struct.pack_into(">i", made, at, int(chance.choice((0, -1, -(2**31), 2**31 - 1, -512, 512, 10**6))))
        elif part.kind in (b"\xa3", b"\xe7") and part.end - part.body >= 2:  # Matroska: a block's or a cluster's time
            at = part.body + (part.kind == b"\xa3")
            struct.pack_into(">h", made, at, int(chance.choice((-32768, -1, 0, 32767))))
    return bytes(made), None


def _spliced(data: bytes, chance: np.random.Generator, kind: int) -> tuple[bytes, int | None]:
    """The beginning of one clip and the end of another."""
    second = whole(int(chance.integers(len(_KINDS)))) if chance.random() < 0.5 else other_size(kind)
    at, further = int(chance.integers(len(data))), int(chance.integers(len(second)))
    return (data[:at] + second[further:] if chance.random() < 0.8 else data + second), None


def _swapped(data: bytes, chance: np.random.Generator, kind: int) -> tuple[bytes, int | None]:
    """One clip's index over another's pictures; sizes that change within the stream."""
    second = other_size(kind)
    ours, theirs = (list(_parts(each)) for each in (data, second))
    part = ours[chance.integers(len(ours))]
    same = [each for each in theirs if each.kind == part.kind]
    put = same[chance.integers(len(same))] if same else theirs[0]
    return data[: part.at] + second[put.at : put.end] + data[part.end :], None


def _foreign(data: bytes, chance: np.random.Generator, _: int) -> tuple[bytes, int | None]:
    """Something else under a clip's name."""
    begin = _TEXTS[chance.integers(len(_TEXTS))]
    return begin + chance.bytes(int(chance.integers(0, 5000))), FRAMES


_DAMAGE: tuple[tuple[str, Callable[..., tuple[bytes, int | None]]], ...] = (
    ("cut short", _cut),
    ("bits flipped", _flipped),
    ("bits of headers flipped", _flipped_header),
    ("stretches lost", _zeroed),
    ("sizes of boxes", _sized),
    ("sizes of boxes", _long_sized),
    ("nesting", _nested),
    ("boxes rearranged", _rearranged),
    ("sample tables", _tables),
    ("timestamps", _clocks),
    ("timestamps", _backwards),
    ("splices", _spliced),
    ("sizes that change", _swapped),
    ("foreign files", _foreign),
)


def made(number: int) -> tuple[str, Made]:
    """The family and the file of one attack."""
    chance = rng(ROOM, number)
    family, damage = _DAMAGE[number % len(_DAMAGE)]
    kind = (number // len(_DAMAGE)) % len(_KINDS)
    data, frames = damage(whole(kind), chance, kind)
    return family, Made(data, _KINDS[kind][0], frames)


def case(number: int) -> Case:
    """One attack on the reader of clips."""
    family, clip = made(number)
    chance = rng(ROOM + " words", number)
    source = f"in{clip.suffix}"
    command, output, frames = ("deblur", source, "-o", "out.mkv", "--method", "none", "--codec", "ffv1"), "out.mkv", clip.frames
    match int(chance.integers(8)):
        case 0:
            command, output = ("inspect", source), None
        case 1:
            command, frames = (*command, "--on-damage", "passthrough"), None
        case 2:
            command, output = ("deblur", source, "-o", f"out{clip.suffix}", "--method", "none"), f"out{clip.suffix}"
    return Case(
        name=f"{ROOM}/{number}",
        family=f"clips: {family}",
        words=command,
        fault=Fault.TIMES if family == "timestamps" else Fault.SOURCE,
        files={source: clip.data},
        source=source,
        output=output,
        frames=frames,
    )
