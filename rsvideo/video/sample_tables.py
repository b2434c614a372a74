"""How many samples an MP4 promises: read here, since FFmpeg makes a table of whatever number the file states before it reads any."""

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import BinaryIO

import numpy as np

from rsvideo.config.files import UnreadableError, opened
from rsvideo.video.container import counted

MOST_SAMPLES = 20_000_000  # of a track of pictures: 92 hours at 60 a second
_MOST_A_BYTE = 64  # samples of sound that a byte can stand for, as the most thrifty codecs have it
_NESTS = {b"moov", b"trak", b"mdia", b"minf", b"stbl", b"moof", b"traf"}
_DEEPEST = 8  # boxes within each other; five are usual
_TABLES = {b"stsz", b"stz2", b"stsc", b"stco", b"co64", b"hdlr"}
_MOST_TABLE = 400_000_000  # bytes


def check(path: Path) -> None:
    """Refuse a file whose tables promise more samples than it has room for; UnreadableError."""
    with opened(path) as file:
        size = file.seek(0, 2)
        fragmented, tables = 0, dict[bytes, bytes]()
        for kind, at, length in _boxes(path, file, size):
            if kind == b"trak":
                _check_track(path, tables, size)
                tables = {}
            elif kind in _TABLES:
                tables.setdefault(kind, _read(file, at, min(length, _MOST_TABLE)))  # a second handler is of the file
            elif kind == b"trun":
                (count,) = struct.unpack(">4xI", _read(file, at, 8).ljust(8, b"\0"))
                fragmented += count
        _check_track(path, tables, size)
    if fragmented > min(size, _MOST_A_BYTE * MOST_SAMPLES):
        raise UnreadableError(f"{path} is damaged: its fragments promise {fragmented} samples, in a file of {size} bytes")


def _check_track(path: Path, tables: dict[bytes, bytes], size: int) -> None:
    sizes = tables.get(b"stsz") or tables.get(b"stz2") or b""
    (count,) = struct.unpack_from(">8xI", sizes.ljust(12, b"\0"))
    sound = tables.get(b"hdlr", b"")[8:12] == b"soun"
    if count > (_MOST_A_BYTE * size if sound else min(size, MOST_SAMPLES)):
        raise UnreadableError(f"{path} is damaged: its index promises {count} samples of a track, in a file of {size} bytes")
    if (chunked := _in_chunks(tables)) > 2 * count + MOST_SAMPLES:
        raise UnreadableError(f"{path} is damaged: its index promises {count} samples of a track, its chunks hold {chunked}")


def _in_chunks(tables: dict[bytes, bytes]) -> int:
    """The samples of all chunks of a track."""
    offsets = tables.get(b"stco") or tables.get(b"co64") or b""
    (chunks,) = struct.unpack_from(">4xI", offsets.ljust(8, b"\0"))
    chunks = min(chunks, len(offsets) // 4)
    body = tables.get(b"stsc", b"")[8:]
    runs = np.frombuffer(body[: len(body) // 12 * 12], ">u4").reshape(-1, 3).astype(np.int64)  # first chunk, samples in each, description
    first = np.clip(runs[:, 0] - 1, 0, chunks)
    held = np.diff(first, append=chunks).clip(0) * runs[:, 1]
    return int(min(held.astype(float).sum(), 2.0**62))


def _boxes(path: Path, file: BinaryIO, size: int) -> Iterator[tuple[bytes, int, int]]:
    """Kind, first byte and length of the body of every box, each before those within it."""
    open_boxes, at, passed = [size], 0, 0
    while open_boxes:
        if at + 8 > open_boxes[-1]:
            at = max(at, open_boxes.pop())
            continue
        length, kind, longer = struct.unpack(">I4sQ", _read(file, at, 16).ljust(16, b"\0"))
        head, extent = (16, longer) if length == 1 else (8, length or open_boxes[-1] - at)
        if extent < head:
            at = open_boxes.pop()
            continue
        passed = counted(path, passed)
        end = min(at + extent, open_boxes[-1])
        yield kind, at + head, end - at - head
        if kind in _NESTS:
            if len(open_boxes) > _DEEPEST:
                raise UnreadableError(f"{path} is damaged: its boxes are nested more than {_DEEPEST} deep")
            open_boxes.append(end)
            at += head
        else:
            at = end


def _read(file: BinaryIO, at: int, length: int) -> bytes:
    file.seek(at)
    return file.read(length)
