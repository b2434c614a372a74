"""OpenEXR: linear light in floating point, through FFmpeg's coder, which passes over damage; so that is looked for here."""

import struct
import zlib
from fractions import Fraction

import av
import av.error
import numpy as np
from av.video.codeccontext import VideoCodecContext
from av.video.frame import VideoFrame

from rsvideo.stills.codes import MOST_PIXELS, check_pixels
from rsvideo.stills.ffmpeg import arrays, fill, watched

_TILED, _DEEP, _PARTS = 0x200, 0x800, 0x1000
_LINES = {0: 1, 1: 1, 2: 1, 3: 16, 4: 32, 5: 16, 6: 32, 7: 32, 8: 32, 9: 256}  # of a chunk, by compression
_ZIPPED = (2, 3)
_MOST_CHANNEL_BYTES = 4096  # of their list: about 200 names


def decode(data: bytes) -> tuple[np.ndarray, ...]:
    """Red, green and blue, or grey, as float32; raises ValueError where the file is damaged."""
    try:
        _check(data)
    except (struct.error, KeyError, IndexError, ZeroDivisionError, ValueError, zlib.error) as error:
        raise ValueError(f"is damaged or cut short: {error}") from error
    context = av.CodecContext.create("exr", "r")
    assert isinstance(context, VideoCodecContext)
    context.thread_count = 1
    context.options = {"err_detect": "explode", "max_pixels": str(MOST_PIXELS)}
    try:
        with watched() as errors:
            frames = [*context.decode(av.Packet(data)), *context.decode(None)]
    except av.error.FFmpegError as error:
        raise ValueError(f"is damaged: {(error.strerror or '').lower()}") from error
    if errors or not frames:
        raise ValueError(f"is damaged: {errors[0] if errors else 'it holds no picture'}")
    name = frames[0].format.name
    if not name.startswith(("gbr", "gray")) or "f" not in name:
        raise ValueError(f"must hold floating-point colour or grey, it holds {name}")
    count = 1 if name.startswith("gray") else 3
    planes = [plane.astype(np.float32) for plane in arrays(frames[0], np.dtype("<f2" if "f16" in name else "<f4"), count)]
    return (planes[0],) if count == 1 else (planes[2], planes[0], planes[1])


def _check(data: bytes) -> None:
    """Every chunk that the table promises is there and whole; ZIP has checksums, the other compressions have none."""
    magic, flags = struct.unpack_from("<II", data)
    if magic != 20000630:
        raise ValueError("it has no EXR signature")
    if flags & (_DEEP | _PARTS):
        raise ValueError("it is deep or has several parts, which are not read")
    at, attributes = 8, dict[bytes, bytes]()
    while data[at : at + 1] != b"\0":
        name, kind, rest = data[at : at + 600].split(b"\0", 2)
        start = at + len(name) + len(kind) + 2
        (length,) = struct.unpack_from("<I", rest)
        attributes[name] = data[start + 4 : start + 4 + length]
        at = start + 4 + length
        if at >= len(data):
            raise ValueError("its header does not end")
    left, top, right, bottom = struct.unpack("<4i", attributes[b"dataWindow"])
    check_pixels(bottom - top + 1, right - left + 1)
    across = down = 0
    if flags & _TILED:
        across, down = struct.unpack_from("<2I", attributes[b"tiles"])
        if attributes[b"tiles"][8] & 15:
            raise ValueError("it holds several resolutions, which are not read")
        chunks, head = -(-(right - left + 1) // across) * -(-(bottom - top + 1) // down), 20
    else:
        chunks, head = -(-(bottom - top + 1) // _LINES[attributes[b"compression"][0]]), 8
    line = (across if flags & _TILED else right - left + 1) * _pixel_bytes(attributes[b"channels"])
    for offset in struct.unpack_from(f"<{chunks}Q", data, at + 1):
        (length,) = struct.unpack_from("<I", data, offset + head - 4)
        if offset + head + length > len(data):
            raise ValueError(f"its chunk at byte {offset} is incomplete")
        if attributes[b"compression"][0] in _ZIPPED and length % line:  # whole lines are stored as they are
            most = line * _LINES[attributes[b"compression"][0]] * max(1, down)  # bytes that the picture can hold there
            inflated = zlib.decompressobj()
            inflated.decompress(data[offset + head : offset + head + length], most + 1)
            if not inflated.eof:
                raise ValueError(f"its chunk at byte {offset} is damaged")


def _pixel_bytes(channels: bytes) -> int:
    """Bytes of all channels at one pixel: 16 bits for half floats, 32 for others."""
    if len(channels) > _MOST_CHANNEL_BYTES:
        raise ValueError(f"its list of channels has {len(channels)} bytes")
    total = 0
    while len(channels) > 1:
        _, rest = channels.split(b"\0", 1)
        total += 2 if rest[0] == 1 else 4
        channels = rest[16:]
    return total


def encode(planes: tuple[np.ndarray, ...]) -> bytes:
    """An EXR file of 32-bit floating point, compressed by ZIP."""
    rows, cols = planes[0].shape
    layout = "grayf32le" if len(planes) == 1 else "gbrpf32le"
    context = av.CodecContext.create("exr", "w")
    assert isinstance(context, VideoCodecContext)
    context.width, context.height, context.pix_fmt, context.time_base = cols, rows, layout, Fraction(1, 24)
    context.options = {"compression": "zip16"}
    frame = VideoFrame(cols, rows, layout)
    fill(frame, planes if len(planes) == 1 else (planes[1], planes[2], planes[0]))
    frame.pts = 0
    return b"".join(bytes(packet) for packet in [*context.encode(frame), *context.encode(None)])
