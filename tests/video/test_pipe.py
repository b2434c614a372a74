"""y4m and bare pixels: what is written is read again, what is broken is refused, and memory does not grow."""

import io
import shutil
import tracemalloc
from collections import namedtuple
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.physics.tone import Transfer
from rsvideo.video import decode, pipe, tags
from rsvideo.video.pipe import Stated
from rsvideo.video.stream import Matrix, Picture, Stream

ROWS, COLS = 35, 41  # odd, so that chroma has a sample more than half
Y4M = Stated(format="y4m")
LUMA = b"YUV4MPEG2 W41 H35 F24:1 Cmono\n"


def bare(layout: str, **words: object) -> Stated:
    return Stated(**{"format": "rawvideo", "size": (COLS, ROWS), "rate": Fraction(24000, 1001), "layout": layout, **words})  # pyright: ignore[reportArgumentType]


def noise(layout: str, count: int = 3) -> list[Picture]:
    """Pictures of all codes of a layout."""
    colour = tags.untagged(pipe.PACKED.get(layout, layout), ROWS, matrix=None, full_range=False)
    down, across = colour.chroma_shift
    chroma = -(-ROWS // (1 << down)), -(-COLS // (1 << across))
    shapes = [(ROWS, COLS)] if colour.subsampling == "4:0:0" else [(ROWS, COLS), chroma, chroma]
    rng, kind = np.random.default_rng(0), np.uint16 if colour.depth > 8 else np.uint8
    return [
        Picture(planes=tuple(rng.integers(0, colour.top, shape, dtype=kind) for shape in shapes), index=k, pts=k, duration=1, time=0.0)
        for k in range(count)
    ]


def kept(data: bytes, stated: Stated, folder: Path, *, whole: bool = True) -> Stream:
    return pipe.kept(io.BytesIO(data), stated, folder / "pictures", whole=whole)


@pytest.mark.parametrize("layout", ["yuv420p", "yuv422p10le", "yuv411p", "gray", "gray12le", "gbrp", "gbrp16le", "rgb24", "rgb48le"])
def test_bare_pixels_come_back(tmp_path: Path, layout: str) -> None:
    given = noise(layout)
    data = b"".join(pipe.encoded(picture, layout, bare=True) for picture in given)
    stream = kept(data, bare(layout), tmp_path)
    for first in (0, 2):
        for one, other in zip(decode.pictures(stream, first), given[first:], strict=True):
            assert one.index == other.index
            for a, b in zip(one.planes, other.planes, strict=True):
                np.testing.assert_array_equal(a, b)


def test_rgb24_is_red_green_and_blue_in_turns(tmp_path: Path) -> None:
    codes = np.random.default_rng(1).integers(0, 256, (ROWS, COLS, 3)).astype(np.uint8)
    (picture,) = decode.pictures(kept(codes.tobytes(), bare("rgb24"), tmp_path))
    np.testing.assert_array_equal(np.stack(picture.planes, axis=-1), codes)


@pytest.mark.parametrize("layout", ["yuv420p", "yuv444p", "yuv422p10le", "gray", "gray16le"])
def test_y4m_comes_back_with_its_rate_and_range(tmp_path: Path, layout: str) -> None:
    given = noise(layout)
    meant = tags.untagged(layout, ROWS, matrix=None, full_range=True)
    source = kept(b"".join(pipe.encoded(picture, layout, bare=True) for picture in given), bare(layout), tmp_path)
    data = pipe.header(source, meant) + b"".join(pipe.encoded(picture, layout, bare=False) for picture in given)
    (tmp_path / "again").mkdir()
    stream = kept(data, Y4M, tmp_path / "again")
    assert (stream.rows, stream.cols, stream.rate, stream.frames) == (ROWS, COLS, Fraction(24000, 1001), 3)
    assert stream.seconds(2) == pytest.approx(2 * 1001 / 24000)
    assert stream.colour == meant
    for one, other in zip(decode.pictures(stream), given, strict=True):
        for a, b in zip(one.planes, other.planes, strict=True):
            np.testing.assert_array_equal(a, b)


def test_what_is_not_stated_of_colour_is_assumed_as_players_do(tmp_path: Path) -> None:
    frame = bytes(ROWS * COLS + 2 * 18 * 21)
    header = b"YUV4MPEG2 W41 H35 F24:1 Ip A4:3 C420jpeg\n"
    stream = kept(header + b"FRAME Ip\n" + frame, Y4M, tmp_path)
    assert (stream.colour.matrix, stream.colour.transfer, stream.colour.full_range) == (Matrix.BT601, Transfer.BT709, False)
    assert stream.colour.assumed == {"matrix", "transfer", "primaries"}
    assert stream.sample_aspect_ratio == Fraction(4, 3)
    (tmp_path / "again").mkdir()
    told = kept(header + b"FRAME\n" + frame, Stated(format="y4m", matrix=Matrix.BT2020), tmp_path / "again")
    assert (told.colour.matrix, told.colour.h273[2]) == (Matrix.BT2020, 9)


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (b"", "standard input is empty; did the program before it fail?"),
        (b"\x89PNG\r\n\x1a\n" + bytes(500), "must be y4m, its first bytes are b'\\x89PNG"),
        (b"YUV4MPEG2 W41 H35 F24:1", "in one line of at most 1000 bytes"),
        (b"YUV4MPEG2 W41 " + b"X" * 2000 + b"\n", "in one line of at most 1000 bytes"),
        (b"YUV4MPEG2 H35 F24:1\n", "W must be a number of pixels, it is ''"),
        (b"YUV4MPEG2 W-4 H35 F24:1\n", "W must be a number of pixels, it is '-4'"),
        (b"YUV4MPEG2 W0 H35 F24:1\n", "at least a pixel"),
        (b"YUV4MPEG2 W99999 H99999 F24:1\n", "at most 100 Mpx, its header says 99999 x 99999"),
        (b"YUV4MPEG2 W41 H35 F24:1 C420alien\n", "the layout '420alien', which is not read"),
        (b"YUV4MPEG2 W41 H35 F24\n", "a ratio must read like 24000:1001"),
        (b"YUV4MPEG2 W41 H35 F9999999:1\n", "pictures a second, its header says 9999999"),
        (b"YUV4MPEG2 W41 H35 F0:0\n", "give --rate"),
        (b"YUV4MPEG2 W41 H35 F24:1 A1\n", "a ratio must read like"),
        (b"YUV4MPEG2 W41 H35 F24:1 C\xff\xff\n", "which is not read"),
        (LUMA, "holds no picture"),
        (LUMA + b"FRAME\n" + bytes(100), "is cut short: picture 0 has 100 of 1435 bytes"),
        (LUMA + b"FRAME\n" + bytes(1435) + b"FRA", "picture 1 must begin with FRAME, it does with b'FRA'"),
        (LUMA + b"FRAME\n" + bytes(1436) + b"FRAME\n", "picture 1 must begin with FRAME, it does with b'\\x00FRAME"),
        (LUMA + b"FRAME\n" + bytes(1435) + b"FRAME\n", "is cut short: picture 1 has 0 of 1435 bytes"),
    ],
)
def test_a_broken_stream_is_refused(tmp_path: Path, data: bytes, words: str) -> None:
    with pytest.raises(UnreadableError) as refused:
        kept(data, Y4M, tmp_path)
    assert str(refused.value).startswith("standard input ")
    assert words in str(refused.value)


def test_a_picture_cut_short_may_be_left_out(tmp_path: Path) -> None:
    stream = kept(LUMA + b"FRAME\n" + bytes(1435) + b"FRAME\n" + bytes(7), Y4M, tmp_path, whole=False)
    assert stream.frames == 1
    assert "picture 1 has 7 of 1435 bytes; it is left out" in stream.notes[0]


def test_interlaced_pictures_are_taken_with_a_word(tmp_path: Path) -> None:
    stream = kept(LUMA.replace(b" Cmono", b" It Cmono") + b"FRAME\n" + bytes(1435), Y4M, tmp_path)
    assert stream.notes == ("it is tagged as interlaced; its two fields are taken as one exposure",)


def test_a_rate_is_stated_once(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="--rate is 25, standard input states 24 pictures a second itself"):
        kept(LUMA, Stated(format="y4m", rate=Fraction(25)), tmp_path)
    stream = kept(LUMA.replace(b"24:1", b"0:0") + b"FRAME\n" + bytes(1435), Stated(format="y4m", rate=Fraction(25)), tmp_path)
    assert stream.rate == 25


class Endless(io.RawIOBase):
    """Grey pictures, one after the other."""

    def __init__(self, pictures: int) -> None:
        self.left = pictures * ROWS * COLS

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # pyright: ignore[reportIncompatibleMethodOverride]
        count = min(len(buffer), self.left)
        self.left -= count
        return count


def test_memory_does_not_grow_with_the_length_of_the_stream(tmp_path: Path) -> None:
    peaks = []
    for pictures in (1, 600):  # the first loads what is loaded once
        tracemalloc.start()
        stream = pipe.kept(io.BufferedReader(Endless(pictures)), bare("gray"), tmp_path / f"{pictures} pictures")
        for _ in decode.pictures(stream):
            pass
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert stream.frames == pictures
    assert peaks[-1] < 150 * ROWS * COLS  # a quarter of them


def test_a_disk_is_not_filled(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    usage = namedtuple("usage", "total free")
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(total=20_000, free=2_000 + 1435))
    assert kept(bytes(1435), bare("gray"), tmp_path).frames == 1
    (tmp_path / "pictures").unlink()
    monkeypatch.setattr(shutil, "disk_usage", lambda _: usage(total=20_000, free=1_999 + 1435))
    with pytest.raises(UnreadableError, match=r"more pictures than there is room for in .*: 0 fill 0 GB; TMPDIR names another"):
        kept(bytes(1435), bare("gray"), tmp_path)
