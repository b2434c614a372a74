"""The boxes of an MP4 and the elements of a Matroska file, found so that an attack can aim at them."""

import struct
from collections.abc import Iterator
from dataclasses import dataclass

_NESTS = {b"moov", b"trak", b"edts", b"mdia", b"minf", b"dinf", b"stbl", b"udta", b"mvex", b"moof", b"traf"}
_MASTERS = {0x18538067, 0x1549A966, 0x1654AE6B, 0xAE, 0xE0, 0x1F43B675, 0xA0, 0x1C53BB6B, 0xBB, 0xB7, 0x114D9B74, 0x4DBB, 0x1254C367}


@dataclass(frozen=True)
class Part:
    """A box or element: where its head begins, where its body does, where it ends, and its kind."""

    at: int
    body: int
    end: int
    kind: bytes


def boxes(data: bytes, at: int = 0, end: int | None = None) -> Iterator[Part]:
    """The boxes of a whole MP4, outer ones before those that they hold."""
    end = len(data) if end is None else end
    while at + 8 <= end:
        length, kind = struct.unpack_from(">I4s", data, at)
        head = 8
        if length == 1:
            head, length = 16, struct.unpack_from(">Q", data, at + 8)[0]
        length = length or end - at
        if length < head or at + length > end:
            return
        yield Part(at, at + head, at + length, kind)
        if kind in _NESTS:
            yield from boxes(data, at + head, at + length)
        at += length


def elements(data: bytes, at: int = 0, end: int | None = None) -> Iterator[Part]:
    """The elements of a whole Matroska file, outer ones before those that they hold."""
    end = len(data) if end is None else end
    while at < end and data[at]:
        wide = 9 - data[at].bit_length()
        kind, at_length = data[at : at + wide], at + wide
        if at_length >= end or not data[at_length]:
            return
        many = 9 - data[at_length].bit_length()
        stated = int.from_bytes(data[at_length : at_length + many]) & ((1 << 7 * many) - 1)
        body = at_length + many
        stop = end if stated == (1 << 7 * many) - 1 else min(body + stated, end)
        yield Part(at, body, stop, kind)
        if int.from_bytes(kind) in _MASTERS:
            yield from elements(data, body, stop)
        at = stop
