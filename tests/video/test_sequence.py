import os
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
import rawpy
import tifffile
from av.video.codeccontext import VideoCodecContext

from rsvideo.config.files import UnreadableError
from rsvideo.physics.tone import Transfer
from rsvideo.stills import exr
from rsvideo.stills.ffmpeg import arrays
from rsvideo.video.decode import pictures, probe
from rsvideo.video.output_format import Codec, Encoding
from rsvideo.video.writer import Writer
from tests.video.clips import make, raw, scene

RATE = Fraction(24000, 1001)


def rgb(seed: int, kind: type = np.uint16, rows: int = 48, cols: int = 64) -> np.ndarray:
    """Noise in red, green and blue."""
    return np.random.default_rng(seed).integers(0, np.iinfo(kind).max, (rows, cols, 3), dtype=kind)


def pngs(folder: Path, numbers: range, kind: type = np.uint16) -> Path:
    """A folder of PNGs with these numbers, without leading zeros."""
    folder.mkdir()
    for number in numbers:
        assert cv2.imwrite(str(folder / f"shot_{number}.png"), rgb(number, kind)[..., ::-1])
    return folder


@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_pictures_come_in_the_order_of_their_numbers(tmp_path: Path, kind: type) -> None:
    stream = probe(pngs(tmp_path / "a", range(8, 12), kind), RATE)
    assert (stream.frames, stream.rate, stream.time_base, stream.codec) == (4, RATE, 1 / RATE, "png")
    for number, picture in zip(range(8, 12), pictures(stream), strict=True):
        np.testing.assert_array_equal(np.stack(picture.planes, axis=-1), rgb(number, kind))
        assert picture.time == pytest.approx((number - 8) / float(RATE))


def test_a_part_of_a_sequence_has_the_indices_of_the_whole(tmp_path: Path) -> None:
    stream = probe(pngs(tmp_path / "a", range(5)), RATE)
    assert [(picture.index, picture.pts) for picture in pictures(stream, 2, 4)] == [(2, 2), (3, 3)]


@pytest.mark.parametrize("pattern", ["shot_#.png", "shot_%d.png", "shot_*.png"])
def test_a_pattern_chooses_one_sequence_of_several(tmp_path: Path, pattern: str) -> None:
    folder = pngs(tmp_path / "a", range(3))
    for number in range(2):
        assert cv2.imwrite(str(folder / f"other_{number}.png"), rgb(0))
    assert probe(folder / pattern, RATE).frames == 3


def test_raw_pictures_keep_the_white_balance_of_the_first(tmp_path: Path) -> None:
    for number, neutral in enumerate([(0.5, 1.0, 0.7), (0.9, 1.0, 0.4)]):
        raw(tmp_path / f"a_{number}.dng", neutral=neutral)
    stream = probe(tmp_path)
    assert (stream.rate, stream.colour.transfer, stream.colour.depth) == (Fraction(24000, 1001), Transfer.LINEAR, 16)
    first, second = pictures(stream)
    for one, other in zip(first.planes, second.planes, strict=True):
        np.testing.assert_array_equal(one, other)
    with rawpy.imread(str(tmp_path / "a_0.dng")) as file:
        own = file.postprocess(use_camera_wb=True, no_auto_bright=True, adjust_maximum_thr=0.0, gamma=(1, 1), output_bps=16, user_flip=0)
    np.testing.assert_array_equal(np.stack(first.planes, axis=-1), own)


def missing(folder: Path) -> None:
    for number in (8, 9, 11):
        raw(folder / f"A001_{number:04d}.dng")


def changing(folder: Path) -> None:
    for number, rows in enumerate([48, 48, 50]):
        raw(folder / f"A001_{number:04d}.dng", rows=rows)


def two_takes(folder: Path) -> None:
    for name in ("A001_0", "A002_0"):
        raw(folder / f"{name}.dng")


def two_kinds(folder: Path) -> None:
    raw(folder / "a_0.dng")
    cv2.imwrite(str(folder / "a_0.png"), rgb(0))


def twice(folder: Path) -> None:
    raw(folder / "a_1.dng")
    raw(folder / "a_01.dng")


def truncated(folder: Path) -> None:
    for number in range(3):
        raw(folder / f"a_{number}.dng")
    os.truncate(folder / "a_1.dng", 3000)


def depth_changes(folder: Path) -> None:
    cv2.imwrite(str(folder / "a_0.png"), rgb(0))
    cv2.imwrite(str(folder / "a_1.png"), rgb(0, np.uint8))


def unnumbered(folder: Path) -> None:
    cv2.imwrite(str(folder / "a_0.png"), rgb(0))
    cv2.imwrite(str(folder / "poster.png"), rgb(0))


def text(folder: Path) -> None:
    (folder / "a_0.dng").write_text("not a picture")


def truncated_exr(folder: Path) -> None:
    data = exr.encode(tuple(np.ones((3, 48, 64), np.float32)))
    (folder / "a_0.exr").write_bytes(data)
    (folder / "a_1.exr").write_bytes(data[:-5])


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (missing, ["lacks A001_0010.dng", "A001_0011.dng"]),
        (changing, ["A001_0002.dng", "64 x 48", "64 x 50"]),
        (two_takes, ["A001_####", "A002_####"]),
        (two_kinds, [".dng and .png"]),
        (twice, ["a_01.dng", "a_1.dng"]),
        (truncated, ["a_1.dng", "damaged"]),
        (depth_changes, ["a_1.png", "gbrp16le", "gbrp"]),
        (unnumbered, ["poster.png"]),
        (text, ["a_0.dng"]),
        (truncated_exr, ["a_1.exr", "cut short"]),
        (lambda _: None, ["holds no pictures"]),
    ],
    ids=lambda case: getattr(case, "__name__", None),
)
def test_a_faulty_sequence_is_refused_by_the_name_of_its_picture(tmp_path: Path, build: Callable[[Path], None], words: list[str]) -> None:
    build(tmp_path)
    with pytest.raises(UnreadableError) as refusal:
        list(pictures(probe(tmp_path, RATE)))
    assert all(word in str(refusal.value) for word in words), refusal.value
    assert "\n" not in str(refusal.value)


def test_a_folder_of_pictures_needs_a_rate(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"rate .* must be given"):
        probe(pngs(tmp_path / "a", range(2)))


@pytest.mark.parametrize("codec", ["png", "tiff"])
def test_a_sequence_of_codes_is_written_code_by_code(tmp_path: Path, codec: Codec) -> None:
    stream = probe(pngs(tmp_path / "a", range(9, 12)), RATE)
    with Writer(tmp_path / "out", stream, Encoding(codec=codec)) as writer:
        for picture in pictures(stream):
            writer.write(picture)
    again = probe(tmp_path / "out", RATE)
    assert [file.stem for file in again.files] == ["shot_9", "shot_10", "shot_11"]
    for one, other in zip(pictures(stream), pictures(again), strict=True):
        for plane, twin in zip(one.planes, other.planes, strict=True):
            np.testing.assert_array_equal(plane, twin)


def test_light_beyond_white_survives_in_exr(tmp_path: Path) -> None:
    (tmp_path / "a").mkdir()
    planes = tuple(np.random.default_rng(0).normal(1, 2, (3, 47, 63)).astype(np.float32))
    (tmp_path / "a" / "x_0.exr").write_bytes(exr.encode(planes))
    stream = probe(tmp_path / "a", RATE)
    with Writer(tmp_path / "out", stream) as writer:
        writer.write(next(pictures(stream)))
    (again,) = pictures(probe(tmp_path / "out", RATE))
    for plane, twin in zip(planes, again.planes, strict=True):
        np.testing.assert_array_equal(plane, twin)


def test_half_floats_are_read(tmp_path: Path) -> None:
    context = av.CodecContext.create("exr", "w")
    assert isinstance(context, VideoCodecContext)
    context.width, context.height, context.pix_fmt, context.time_base = 64, 48, "gbrpf32le", Fraction(1, 24)
    context.options = {"format": "half", "compression": "zip1"}
    frame = scene(0, layout="gbrpf32le")
    frame.pts = 0
    (tmp_path / "x_0.exr").write_bytes(b"".join(map(bytes, [*context.encode(frame), *context.encode(None)])))
    (picture,) = pictures(probe(tmp_path, RATE))
    green, blue, red = arrays(frame, np.dtype("<f4"), 3)
    for plane, truth in zip(picture.planes, (red, green, blue), strict=True):
        np.testing.assert_allclose(plane, truth, rtol=2**-10)


def test_a_clip_becomes_pictures_of_16_bits(tmp_path: Path) -> None:
    stream = probe(make(tmp_path / "a.mp4", layout="yuv420p10le", codec="libx265"))
    with Writer(tmp_path / "out", stream, Encoding(codec="tiff"), first=2, last=5) as writer:
        for picture in pictures(stream, 2, 5):
            writer.write(picture)
    names = sorted(file.name for file in (tmp_path / "out").iterdir())
    assert names == ["out_000002.tiff", "out_000003.tiff", "out_000004.tiff"]
    assert tifffile.imread(tmp_path / "out" / names[0]).dtype == np.uint16
    assert any("other tracks" in note or "clipped" in note for note in writer.notes)


def test_what_stood_in_the_folder_is_left_alone(tmp_path: Path) -> None:
    stream = probe(pngs(tmp_path / "a", range(2)), RATE)
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "letter.txt").write_text("dear")
    with Writer(tmp_path / "out", stream) as writer:
        for picture in pictures(stream):
            writer.write(picture)
    assert sorted(file.name for file in (tmp_path / "out").iterdir()) == ["letter.txt", "shot_0.png", "shot_1.png"]
    assert sorted(file.name for file in tmp_path.iterdir()) == ["a", "out"]
