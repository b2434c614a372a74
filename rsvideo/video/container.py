"""Whether a clip's container is whole: its parts end where they say, its checksums hold, and all that its header promises is there.

FFmpeg reads what it can and is silent about the rest.
"""

import struct
import zlib
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rsvideo.config.files import UnreadableError, opened

_MOST_HEADER = 500_000_000  # bytes of MP4's index
_MOST_PARTS = 2_000_000  # boxes or elements; a fragment a second over a day is 200 thousand of the outermost
_EBML = b"\x1aE\xdf\xa3"
_BOXES = {b"ftyp", b"moov", b"mdat", b"wide", b"free", b"skip", b"pnot"}
_SEGMENT, _CLUSTER, _CRC = b"\x18S\x80g", b"\x1fC\xb6u", b"\xbf\x84"  # the last with its length of 4 bytes
_NESTS = {b"mdia", b"minf", b"stbl"}
_UNKNOWN = {0: 0xFFFFFFFF, 1: 0xFFFFFFFFFFFFFFFF}
_LEVEL_1 = {
    _SEGMENT,
    _CLUSTER,
    b"\xec",
    *(n.to_bytes(4) for n in (0x114D9B74, 0x1549A966, 0x1654AE6B, 0x1C53BB6B, 0x1941A469, 0x1043A770, 0x1254C367)),
}


@dataclass(frozen=True, kw_only=True)
class Header:
    """What an MP4 states about its length and its tracks."""

    shown_s: float = 0.0  # of the whole file; 0 where it does not say
    media_s: dict[int, float] = field(default_factory=dict)  # by the track's number, seconds
    timed_s: dict[int, float] = field(default_factory=dict)  # the sum of all samples' durations, seconds
    kinds: dict[int, str] = field(default_factory=dict)  # four letters, such as avc1, mp4a, gpmd, tmcd
    fragmented: bool = False


def family(path: Path, *, strict: bool) -> str:
    """The kind of container, from its first bytes; FFmpeg's own guess would open playlists and text too."""
    with opened(path) as file:
        head, size = file.read(16), file.seek(0, 2)
        if not size:
            raise UnreadableError(f"{path} is empty")
        if head[4:8] in _BOXES:
            if strict:
                _check_boxes(path, file, size)
            return "mov"
        if head[:4] == _EBML:
            if strict:
                _check_segment(path, file, size)
            return "matroska"
    raise UnreadableError(f"{path} must be an MP4, MOV or MKV clip, its first bytes are {head[:8]!r}; is it another kind of file?")


def _check_boxes(path: Path, file: BinaryIO, size: int) -> None:
    """Every box of the outermost level must end within the file."""
    at, kinds, parts = 0, set(), 0
    while at + 8 <= size:
        parts = counted(path, parts)
        file.seek(at)
        length, kind, longer = struct.unpack(">I4sQ", file.read(16).ljust(16, b"\0"))
        kinds.add(kind)
        extent = {0: size - at, 1: longer}.get(length, length)
        if {b"moov", b"mdat"} < kinds and not (kind.isalnum() and kind.isascii()):
            break  # whatever was put behind a whole clip
        if extent < 8 or at + extent > size:
            raise UnreadableError(
                f"{path} is cut short or damaged: its {kind.decode('latin-1')!r} box at byte {at} says {extent} bytes, {size - at} are left"
            )
        at += extent
    if b"moov" not in kinds:
        raise UnreadableError(f"{path} is cut short: it has no index ('moov' box); was the recording interrupted?")


def counted(path: Path, parts: int) -> int:
    """One part more; refused where there are more than any recording has."""
    if parts == _MOST_PARTS:
        raise UnreadableError(f"{path} is damaged: it must hold at most {_MOST_PARTS} parts")
    return parts + 1


def _check_segment(path: Path, file: BinaryIO, size: int) -> None:
    """The parts of a Matroska file must be elements that Matroska defines, and end where the next begins; a checksum must match."""
    at, end, inside, parts = 0, size, False, 0
    while at < end:
        parts = counted(path, parts)
        file.seek(at)
        kind, length, head = _element(file.read(12))
        if kind is None or (inside and kind not in _LEVEL_1):
            raise UnreadableError(f"{path} is damaged: at byte {at} of {size} no part of a Matroska file begins")
        if length is None and kind not in (_SEGMENT, _CLUSTER):
            raise UnreadableError(f"{path} is damaged: its part at byte {at} has no length")
        if kind == _SEGMENT:
            inside = True
            if length is not None and (end := at + head + length) > size:
                raise UnreadableError(f"{path} is cut short: its segment says {length} bytes, {size - at - head} are left")
            at += head
            continue
        if length is None:  # a live recording: the rest cannot be divided without reading it all
            return
        if at + head + length > end:
            raise UnreadableError(f"{path} is cut short: its part at byte {at} says {length} bytes, {end - at - head} are left")
        if inside:
            _check_sum(path, file, at, head, length)
        at += head + length
    if not inside:
        raise UnreadableError(f"{path} is cut short: it has a header only")


def _check_sum(path: Path, file: BinaryIO, at: int, head: int, length: int) -> None:
    file.seek(at + head)
    first = file.read(6)
    if first[:2] != _CRC or length < 6:
        return
    found, left = 0, length - 6
    while left and (data := file.read(min(left, 1 << 20))):
        found, left = zlib.crc32(data, found), left - len(data)
    if found != int.from_bytes(first[2:], "little"):
        raise UnreadableError(f"{path} is damaged: the checksum of its part at byte {at} ({length} bytes) is wrong")


def _element(head: bytes) -> tuple[bytes | None, int | None, int]:
    """Kind, length (None: not stated) and bytes of the head of an EBML element; no kind where there is none."""
    id_bytes = 9 - head[0].bit_length() if head and head[0] else 9
    if id_bytes > 4 or len(head) < id_bytes + 1 or not head[id_bytes]:
        return None, None, 0
    bits = 7 * (length_bytes := 9 - head[id_bytes].bit_length())
    length = int.from_bytes(head[id_bytes : id_bytes + length_bytes]) & ((1 << bits) - 1)
    return head[:id_bytes], None if length == (1 << bits) - 1 else length, id_bytes + length_bytes


def header(path: Path) -> Header:
    """What the index of an MP4 states; raises UnreadableError where it contradicts itself."""
    with path.open("rb") as file:
        index = _box(file, b"moov", path.stat().st_size)
    try:
        return _header(path, index)
    except UnreadableError:
        raise
    except (struct.error, IndexError, KeyError, ValueError, ZeroDivisionError) as error:
        raise UnreadableError(f"{path} is damaged: its index ('moov' box) is incomplete") from error


def _header(path: Path, index: bytes) -> Header:
    media, timed, kinds, shown, fragmented = {}, {}, {}, 0.0, False
    for kind, body in _boxes(index):
        if kind == b"mvhd":
            scale, duration = _clock(body)
            shown = duration / scale if duration != _UNKNOWN[body[0]] else 0.0
        elif kind == b"mvex":
            fragmented = True
    for kind, body in _boxes(index):
        if kind != b"trak":
            continue
        boxes = dict(_inside(body))
        number = struct.unpack_from(">I", boxes[b"tkhd"], 20 if boxes[b"tkhd"][0] else 12)[0]
        scale, duration = _clock(boxes[b"mdhd"])
        count = struct.unpack_from(">I", boxes[b"stts"], 4)[0]
        runs = np.frombuffer(boxes[b"stts"], ">u4", 2 * count, 8).reshape(-1, 2).astype(np.int64)  # how many, how long
        sizes = boxes.get(b"stsz") or boxes.get(b"stz2") or bytes(12)
        samples = struct.unpack_from(">I", sizes, 8)[0]
        if (counted := int(runs[:, 0].sum())) != samples:
            raise UnreadableError(f"{path} is damaged: its header promises {counted} times and {samples} samples of track {number}")
        kinds[number] = boxes[b"stsd"][12:16].decode("latin-1")
        media[number] = duration / scale if duration != _UNKNOWN[boxes[b"mdhd"][0]] else 0.0
        timed[number] = float(runs.prod(axis=1).sum()) / scale
    return Header(shown_s=shown, media_s=media, timed_s=timed, kinds=kinds, fragmented=fragmented)


def _clock(body: bytes) -> tuple[int, int]:
    """Ticks a second, and duration in ticks, of mvhd and mdhd."""
    return struct.unpack_from(">IQ", body, 20) if body[0] else struct.unpack_from(">II", body, 12)


def _box(file: BinaryIO, wanted: bytes, size: int) -> bytes:
    """The body of a box of the outermost level; empty where there is none."""
    at = 0
    while at + 8 <= size:
        file.seek(at)
        length, kind, longer = struct.unpack(">I4sQ", file.read(16).ljust(16, b"\0"))
        head, extent = (16, longer) if length == 1 else (8, length or size - at)
        if kind == wanted:
            file.seek(at + head)
            return file.read(min(extent - head, _MOST_HEADER))
        if extent < 8:
            break
        at += extent
    return b""


def _boxes(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    at = 0
    while at + 8 <= len(data):
        length, kind = struct.unpack_from(">I4s", data, at)
        if length < 8:
            return
        yield kind, data[at + 8 : at + length]
        at += length


def _inside(data: bytes) -> Iterator[tuple[bytes, bytes]]:
    """All boxes of a track, those in its containers too."""
    for kind, body in _boxes(data):
        yield kind, body
        if kind in _NESTS:
            yield from _inside(body)
