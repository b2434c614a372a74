"""Pictures one after the other, as pipes carry them: with the headers of y4m (YUV4MPEG2), or bare.

A pipe can be read once, and a clip is gone through several times. So its pictures are kept, as they come, in a temporary file, from
which any of them is read again.
"""

import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction
from io import BufferedIOBase
from pathlib import Path

import numpy as np

from rsvideo.config.files import UnreadableError, reading
from rsvideo.config.media import Pipe
from rsvideo.config.quantity import FASTEST_RATE, MOST_PIXELS, SLOWEST_RATE
from rsvideo.stills.codes import check_pixels
from rsvideo.video import tags
from rsvideo.video.stream import Colour, Matrix, Picture, Stream

STDIN, STDOUT = Path("standard input"), Path("standard output")  # as errors name them
PACKED = {"rgb24": "gbrp", "rgb48le": "gbrp16le"}  # layouts whose samples take turns, by the planes that hold them
LEAST_FREE = 1_000_000_000, 0.1  # bytes, or if that is less a share, of the disk of temporary files, which are left free
_MAGIC = b"YUV4MPEG2"
_LONGEST_LINE = 1000  # bytes of a header; FFmpeg writes 100 at most
_DEPTHS = ("9", "10", "12", "14", "16")
_LAYOUTS = {  # y4m's names, the first of a layout's being the one that is written
    "420mpeg2": "yuv420p",
    **dict.fromkeys(("420jpeg", "420paldv", "420"), "yuv420p"),
    **{chroma: f"yuv{chroma}p" for chroma in ("422", "444", "411")},
    **{f"{chroma}p{depth}": f"yuv{chroma}p{depth}le" for chroma in ("420", "422", "444") for depth in _DEPTHS},
    "mono": "gray",
    **{f"mono{depth}": f"gray{depth}le" for depth in _DEPTHS},
}
Y4M = frozenset(_LAYOUTS.values())
BARE = Y4M | {"yuv410p", "yuv440p", "yuv440p10le", "yuv440p12le", "gbrp", *(f"gbrp{depth}le" for depth in _DEPTHS)}


@dataclass(frozen=True, kw_only=True)
class Stated:
    """What is stated of a pipe's pictures beside them; of y4m its header states the rest."""

    format: Pipe
    size: tuple[int, int] | None = None  # columns, rows
    rate: Fraction | None = None
    layout: str | None = None  # FFmpeg's name
    matrix: Matrix | None = None


@dataclass(frozen=True, kw_only=True)
class _Header:
    rows: int
    cols: int
    rate: Fraction
    layout: str
    full_range: bool = False
    aspect: Fraction = Fraction(1)
    notes: tuple[str, ...] = ()


def raw_layout(name: str) -> str | None:
    """The planes that hold bare pixels of a layout; None of one that is not read and written."""
    held = PACKED.get(name, name)
    return held if held.replace("yuvj", "yuv") in BARE else None


def kept(pipe: BufferedIOBase, stated: Stated, file: Path, *, whole: bool = True) -> Stream:
    """All pictures of a pipe in a new file, and the stream that they are.

    UnreadableError for what is not as it is stated, and, unless it need not be `whole`, for a last picture that is cut short.
    """
    bare = stated.format == "rawvideo"
    with reading(STDIN):
        header = _stated(stated) if bare else _header(pipe.readline(_LONGEST_LINE), stated.rate)
        check_pixels(header.rows, header.cols, most=MOST_PIXELS)
    if stated.rate not in (None, header.rate):
        raise ValueError(f"--rate is {stated.rate}, {STDIN} states {header.rate} pictures a second itself; leave --rate out")
    held = PACKED.get(header.layout, header.layout)
    colour = tags.untagged(held, header.rows, matrix=stated.matrix, full_range=header.full_range)
    shapes, kind = _shapes(colour, header.rows, header.cols), _kind(colour)
    size, count, notes = sum(rows * cols for rows, cols in shapes) * kind.itemsize, 0, header.notes
    with file.open("xb") as out:
        while (data := _next(pipe, size, count, bare=bare)) is not None:
            if len(data) < size:
                cut = f"is cut short: picture {count} has {len(data)} of {size} bytes"
                if whole:
                    raise UnreadableError(f"{STDIN} {cut}; did the program before it fail? --on-damage skip leaves it out")
                notes += (f"{STDIN} {cut}; it is left out",)
                break
            _check_room(file.parent, count, size)
            for plane in _unpacked(data, header.layout, shapes, kind):
                out.write(plane.tobytes())
            count += 1
    if not count:
        raise UnreadableError(f"{STDIN} holds no picture; did the program before it fail?")
    return Stream(
        path=file,
        codec="rawvideo",
        rows=header.rows,
        cols=header.cols,
        rate=header.rate,
        time_base=1 / header.rate,
        times=np.arange(count, dtype=np.int64),
        keys=np.arange(count, dtype=np.int64),
        end=count,
        colour=colour,
        sample_aspect_ratio=header.aspect,
        bare=True,
        notes=notes,
    )


def pictures(stream: Stream, first: int, last: int) -> Iterator[Picture]:
    """The pictures first, ..., last - 1 of what was kept."""
    shapes, kind = _shapes(stream.colour, stream.rows, stream.cols), _kind(stream.colour)
    size = sum(rows * cols for rows, cols in shapes) * kind.itemsize
    with stream.path.open("rb") as file:
        file.seek(first * size)
        for index in range(first, last):
            planes = _unpacked(file.read(size), "", shapes, kind)
            yield Picture(planes=planes, index=index, pts=index, duration=1, time=stream.seconds(index))


def header(stream: Stream, colour: Colour) -> bytes:
    """Of y4m, for a stream's pictures in the layout of `colour`."""
    plain = colour.pixel_format.replace("yuvj", "yuv")
    layout = next(name for name, held in _LAYOUTS.items() if held == plain)
    words = (
        f"W{stream.cols} H{stream.rows} F{stream.rate.numerator}:{stream.rate.denominator} Ip"
        f" A{stream.sample_aspect_ratio.numerator}:{stream.sample_aspect_ratio.denominator} C{layout}"
        f" XCOLORRANGE={'FULL' if colour.full_range else 'LIMITED'}"
    )
    return _MAGIC + f" {words}\n".encode()


def encoded(picture: Picture, layout: str, *, bare: bool) -> bytes:
    """A picture as it follows those before it; `layout` is FFmpeg's name of what its planes are to be."""
    planes = picture.planes
    if layout in PACKED:
        data = np.stack(planes, axis=-1).tobytes()
    else:
        data = b"".join(plane.tobytes() for plane in ((planes[1], planes[2], planes[0]) if layout.startswith("gbr") else planes))
    return data if bare else b"FRAME\n" + data


def lost(stream: Stream) -> str:
    """What a pipe does not carry, of a stream and beside it."""
    kinds = sorted({"sound" if track.kind == "audio" else track.kind for track in stream.tracks})
    held = {
        "colour tags": any(code != 2 for code in stream.colour.h273[:3]),  # 2 states none
        "varying times": stream.variable,
        "rotation": stream.rotation,
        "timecode": stream.timecode,
        "date": stream.created,
        "HDR10 metadata": stream.mastering,
    }
    words = ["the sidecar", "the gyroscope's log", *(name for name, there in held.items() if there), *kinds]
    return f"a pipe carries pictures at one rate and no more; lost are {', '.join(words)}; rsvideo track writes a sidecar"


def _next(pipe: BufferedIOBase, size: int, count: int, *, bare: bool) -> bytes | None:
    """The bytes of the next picture, fewer where the pipe ends within it; None where it ends before it."""
    if not bare:
        line = pipe.readline(_LONGEST_LINE)
        if not line:
            return None
        if not line.startswith(b"FRAME") or (line[5:6] not in b" \n" and line.endswith(b"\n")):
            raise UnreadableError(f"{STDIN} is damaged: picture {count} must begin with FRAME, it does with {line[:16]!r}")
        if not line.endswith(b"\n"):
            return b""
    data = pipe.read(size)
    return data if data or not bare else None


def _check_room(folder: Path, count: int, size: int) -> None:
    disk = shutil.disk_usage(folder)
    if disk.free - size < min(LEAST_FREE[0], LEAST_FREE[1] * disk.total):
        raise UnreadableError(
            f"{STDIN} holds more pictures than there is room for in {folder.parent}: {count} fill {count * size / 1e9:.2g} GB;"
            " TMPDIR names another folder"
        )


def _stated(stated: Stated) -> _Header:
    """Of bare pixels, which state nothing themselves."""
    assert stated.size is not None
    assert stated.rate is not None
    assert stated.layout is not None
    cols, rows = stated.size
    return _Header(rows=rows, cols=cols, rate=stated.rate, layout=stated.layout)


def _header(line: bytes, rate: Fraction | None) -> _Header:
    """What the first line of y4m states; `rate` is given where it does not."""
    if not line:
        raise UnreadableError(f"{STDIN} is empty; did the program before it fail?")
    if not line.startswith(_MAGIC + b" "):
        raise UnreadableError(
            f"{STDIN} must be y4m, its first bytes are {line[:10]!r}; ffmpeg -f yuv4mpegpipe writes it; bare pixels need"
            " --format rawvideo, and a photograph or a clip in its container is read from a file"
        )
    if not line.endswith(b"\n"):
        raise UnreadableError(f"{STDIN} must hold a y4m header in one line of at most {_LONGEST_LINE} bytes; is it cut short?")
    words = line.decode("ascii", "replace").split()[1:]
    given = {word[0]: word[1:] for word in words if word[0] != "X"}
    name = given.get("C", "420")
    if (layout := _LAYOUTS.get(name)) is None:
        raise UnreadableError(f"{STDIN} holds y4m of the layout {name[:20]!r}, which is not read; ffmpeg -pix_fmt yuv420p converts it")
    found = _fraction(given.get("F", "0:0"))
    if not (settled := found or rate):
        raise UnreadableError(f"{STDIN} does not state how many pictures are shown a second; give --rate, such as 24 or 24000/1001")
    if not SLOWEST_RATE <= settled <= FASTEST_RATE:
        raise ValueError(f"must show {SLOWEST_RATE} to {FASTEST_RATE} pictures a second, its header says {settled}; is it damaged?")
    notes = ("it is tagged as interlaced; its two fields are taken as one exposure",) if given.get("I", "p")[:1] not in ("p", "?") else ()
    return _Header(
        rows=_side("H", given),
        cols=_side("W", given),
        rate=settled,
        layout=layout,
        full_range="XCOLORRANGE=FULL" in words,
        aspect=_fraction(given.get("A", "1:1")) or Fraction(1),
        notes=notes,
    )


def _side(name: str, given: dict[str, str]) -> int:
    text = given.get(name, "")
    if not (text.isascii() and text.isdecimal() and len(text) < 10):  # more no picture has
        raise UnreadableError(f"{STDIN} holds a broken y4m header: {name} must be a number of pixels, it is {text[:20]!r}")
    return int(text)


def _fraction(text: str) -> Fraction | None:
    """`24000:1001` as a number; None where it states nothing, as 0:0."""
    number, _, divisor = text.partition(":")
    if not all(part.isascii() and part.isdecimal() and len(part) < 10 for part in (number, divisor)):
        raise UnreadableError(f"{STDIN} holds a broken y4m header: a ratio must read like 24000:1001, got {text[:20]!r}")
    return Fraction(int(number), int(divisor)) if int(number) and int(divisor) else None


def _kind(colour: Colour) -> np.dtype:
    return np.dtype("<u2" if colour.depth > 8 else "u1")


def _shapes(colour: Colour, rows: int, cols: int) -> list[tuple[int, int]]:
    """Of the planes."""
    down, across = colour.chroma_shift
    chroma = -(-rows // (1 << down)), -(-cols // (1 << across))
    return [(rows, cols)] if colour.subsampling == "4:0:0" else [(rows, cols), chroma, chroma]


def _unpacked(data: bytes, layout: str, shapes: list[tuple[int, int]], kind: np.dtype) -> tuple[np.ndarray, ...]:
    """The planes, Y, U, V or R, G, B, of bytes in a layout."""
    samples = np.frombuffer(data, kind)
    if layout in PACKED:
        return tuple(np.ascontiguousarray(samples.reshape(*shapes[0], 3)[..., k]) for k in range(3))
    ends = np.cumsum([rows * cols for rows, cols in shapes])
    planes = tuple(part.reshape(shape) for part, shape in zip(np.split(samples, ends[:-1]), shapes, strict=True))
    return (planes[2], planes[0], planes[1]) if layout.startswith("gbr") else planes
