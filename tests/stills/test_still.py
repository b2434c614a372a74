import io
import struct
import zlib
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile
from PIL import Image, ImageCms
from PIL.JpegImagePlugin import JpegImageFile
from PIL.TiffImagePlugin import IFDRational

from rsvideo.config import memory
from rsvideo.config.files import UnreadableError
from rsvideo.physics.tone import Transfer
from rsvideo.stills import png, still
from rsvideo.stills.codes import Codes
from rsvideo.stills.still import Format

ICC = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
WRITABLE = [Format.PNG, Format.TIFF, Format.JPEG]


def codes_like(kind: str, bits: int, rows: int = 37, cols: int = 53) -> Codes:
    """Random codes with every kind of channel: grey or colour, with alpha or without."""
    top = 2**bits
    rng = np.random.default_rng(7)
    samples = rng.integers(0, top, (rows, cols, 1 if kind.startswith("grey") else 3)).astype(f"u{bits // 8}")
    alpha = rng.integers(0, top, (rows, cols)).astype(f"u{bits // 8}") if kind.endswith("alpha") else None
    return Codes(samples=samples, alpha=alpha)


def exif_record() -> bytes:
    exif = Image.Exif()
    exif[271], exif[272], exif[274] = "Maker", "Model 1", 6
    exif[0x8769] = {33434: IFDRational(1, 50), 37386: IFDRational(43, 10), 41989: 28}
    exif[0x8825] = {1: "N", 2: (48.0, 8.0, 0.0)}
    return exif.tobytes().removeprefix(b"Exif\0\0")


def saved(path: Path, codes: Codes, kind: Format) -> Path:
    path.write_bytes(kind.module.encode(codes))
    return path


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("kind", ["grey", "grey+alpha", "colour", "colour+alpha"])
@pytest.mark.parametrize("written", [Format.PNG, Format.TIFF])
def test_untouched_pixels_come_back_code_for_code(tmp_path: Path, written: Format, kind: str, bits: int) -> None:
    codes = codes_like(kind, bits)
    photograph = still.read(saved(tmp_path / "in", codes, written))
    for into in (Format.PNG, Format.TIFF):
        (tmp_path / "out").write_bytes(still.encode(photograph, photograph.pixels, into)[0])
        back = still.read(tmp_path / "out").codes
        np.testing.assert_array_equal(back.samples, codes.samples, strict=True)
        if codes.alpha is None:
            assert back.alpha is None
        else:
            np.testing.assert_array_equal(back.alpha, codes.alpha, strict=True)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("kind", ["grey", "colour", "colour+alpha"])
def test_other_programs_read_what_is_written(kind: str, bits: int) -> None:
    codes = codes_like(kind, bits)
    stored = codes.samples if codes.alpha is None else np.concatenate([codes.samples, codes.alpha[..., None]], axis=2)
    png = cv2.imdecode(np.frombuffer(Format.PNG.module.encode(codes), np.uint8), cv2.IMREAD_UNCHANGED)
    assert png is not None
    png = png[..., None] if png.ndim == 2 else png[..., [2, 1, 0, 3][: png.shape[2]]]
    np.testing.assert_array_equal(png, stored, strict=True)
    tiff = tifffile.imread(io.BytesIO(Format.TIFF.module.encode(codes)))
    np.testing.assert_array_equal(tiff.reshape(stored.shape), stored, strict=True)


@pytest.mark.parametrize("bits", [8, 16])
@pytest.mark.parametrize("channels", [1, 3, 4])
@pytest.mark.parametrize("compression", [1, 5, 8, 32773], ids=["none", "lzw", "deflate", "packbits"])
def test_tiff_of_other_programs_is_read(tmp_path: Path, compression: int, channels: int, bits: int) -> None:
    stored = np.random.default_rng(3).integers(0, 2**bits, (40, 50, channels)).astype(f"u{bits // 8}")
    if channels == 4:
        stored[..., 3] = 2**bits - 1
    bgr = stored if channels == 1 else np.ascontiguousarray(stored[..., [2, 1, 0, 3][:channels]])
    assert cv2.imwrite(str(tmp_path / "x.tif"), bgr, [cv2.IMWRITE_TIFF_COMPRESSION, compression])
    np.testing.assert_array_equal(still.read(tmp_path / "x.tif").codes.samples, stored[..., :3], strict=True)


def test_tiff_with_separate_planes_and_inverted_grey_are_read(tmp_path: Path) -> None:
    colour = codes_like("colour", 16).samples
    tifffile.imwrite(tmp_path / "planes.tif", np.moveaxis(colour, 2, 0), photometric="rgb", planarconfig="separate")
    np.testing.assert_array_equal(still.read(tmp_path / "planes.tif").codes.samples, colour)
    tifffile.imwrite(tmp_path / "negative.tif", colour[..., 0], photometric="miniswhite")
    np.testing.assert_array_equal(still.read(tmp_path / "negative.tif").codes.samples[..., 0], 65535 - colour[..., 0])


@pytest.mark.parametrize("mode", ["1", "L", "LA", "P", "RGB", "RGBA"])
def test_every_kind_of_png_is_read(tmp_path: Path, mode: str) -> None:
    image = Image.fromarray(np.random.default_rng(5).integers(0, 256, (40, 50, 4), dtype=np.uint8)).convert(mode)
    image.save(tmp_path / "x.png")
    expected = np.asarray(image.convert("RGBA" if mode == "P" else "L" if mode == "1" else mode)).reshape(40, 50, -1)
    got = still.read(tmp_path / "x.png").codes
    stored = got.samples if got.alpha is None else np.concatenate([got.samples, got.alpha[..., None]], axis=2)
    np.testing.assert_array_equal(stored, expected)


@pytest.mark.parametrize("mode", ["L", "RGB"])
def test_jpeg_is_read_and_written_with_little_loss(tmp_path: Path, mode: str) -> None:
    ramp = np.indices((64, 64)).sum(axis=0).astype(np.uint8) * 2
    Image.fromarray(ramp).convert(mode).save(tmp_path / "x.jpg", quality=98)
    photograph = still.read(tmp_path / "x.jpg")
    (tmp_path / "y.jpg").write_bytes(still.encode(photograph, photograph.pixels, Format.JPEG)[0])
    difference = still.read(tmp_path / "y.jpg").codes.samples.astype(int) - photograph.codes.samples
    assert np.abs(difference).max() <= 4
    assert photograph.pixels.shape[2] == (1 if mode == "L" else 3)


def test_jpeg_is_written_with_a_colour_for_each_pixel_and_with_what_travels_along() -> None:
    written = JpegImageFile(io.BytesIO(Format.JPEG.module.encode(replace(codes_like("colour", 8), icc=ICC, exif=exif_record()))))
    assert [(across, down) for _, across, down, _ in written.layer] == [(1, 1)] * 3
    assert (written.info["icc_profile"], written.info["exif"].removeprefix(b"Exif\0\0")) == (ICC, exif_record())


@pytest.mark.parametrize("source", WRITABLE)
@pytest.mark.parametrize("target", WRITABLE)
def test_profile_orientation_and_exposure_travel_between_all_formats(tmp_path: Path, source: Format, target: Format) -> None:
    codes = replace(codes_like("colour", 8), icc=ICC, exif=exif_record())
    photograph = still.read(saved(tmp_path / "in", codes, source))
    (tmp_path / "out").write_bytes(still.encode(photograph, photograph.pixels, target)[0])
    back = still.read(tmp_path / "out")
    assert back.codes.icc == ICC
    assert (back.capture.exposure, back.capture.focal_mm, back.capture.focal_35mm, back.capture.camera) == (0.02, 4.3, 28, "Model 1")
    with Image.open(tmp_path / "out") as image:
        exif = image.getexif()
        assert exif[274] == 6
        assert exif.get_ifd(0x8825)[1] == "N"
    assert back.pixels.shape == photograph.pixels.shape  # carried, not applied


def test_jpeg_to_jpeg_keeps_the_whole_exif_record(tmp_path: Path) -> None:
    photograph = still.read(saved(tmp_path / "in", replace(codes_like("colour", 8), exif=exif_record()), Format.JPEG))
    (tmp_path / "out").write_bytes(still.encode(photograph, photograph.pixels, Format.JPEG)[0])
    assert still.read(tmp_path / "out").codes.exif == exif_record()


def test_a_still_left_as_it_was_is_the_same_file(tmp_path: Path) -> None:
    path = saved(tmp_path / "in", codes_like("colour", 8), Format.JPEG)
    assert still.unchanged(still.read(path), Format.JPEG)[0] == path.read_bytes()


def test_what_jpeg_cannot_hold_is_said(tmp_path: Path) -> None:
    photograph = still.read(saved(tmp_path / "in", codes_like("colour+alpha", 16), Format.PNG))
    notes = still.encode(photograph, photograph.pixels, Format.JPEG)[1]
    assert [note.split(";")[0] for note in notes] == ["JPEG holds 8 bits a sample", "JPEG holds no transparency"]


@pytest.mark.parametrize(("bits", "first"), [(8, 254), (16, 65278)])
def test_codes_at_the_top_count_as_clipped(tmp_path: Path, bits: int, first: int) -> None:
    samples = np.array([[0, first - 1], [first, 2**bits - 1]])[..., None].astype(f"u{bits // 8}")
    clipped = still.read(saved(tmp_path / "in", Codes(samples=samples), Format.PNG)).clipped[..., 0]
    np.testing.assert_array_equal(clipped, [[False, False], [True, True]])


@pytest.mark.parametrize(("transfer", "expected"), [(Transfer.SRGB, 0.21586), (Transfer.BT709, 0.26146), (Transfer.LINEAR, 0.50196)])
def test_pixels_are_the_light_that_the_transfer_function_says(tmp_path: Path, transfer: Transfer, expected: float) -> None:
    path = saved(tmp_path / "in", Codes(samples=np.full((4, 4, 1), 128, np.uint8)), Format.PNG)
    np.testing.assert_allclose(still.read(path, transfer).pixels, expected, atol=2e-4)


def test_an_exif_that_says_zero_says_nothing(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[0x8769] = {33434: IFDRational(0, 1), 41989: 0}
    codes = replace(codes_like("grey", 8), exif=exif.tobytes().removeprefix(b"Exif\0\0"))
    shot = still.read(saved(tmp_path / "in", codes, Format.JPEG)).capture
    assert shot.exposure is None
    assert shot.focal_px(100, 100) is None


def test_a_damaged_exif_does_not_stop_the_picture(tmp_path: Path) -> None:
    for kind in WRITABLE[:1] + WRITABLE[2:]:
        photograph = still.read(saved(tmp_path / "in", replace(codes_like("grey", 8), exif=b"II*\0\xff\xff\xff\x7fnonsense"), kind))
        assert photograph.capture.exposure is None


def chunk(kind: bytes, body: bytes) -> bytes:
    return struct.pack(">I", len(body)) + kind + body + struct.pack(">I", zlib.crc32(kind + body))


def huge_png() -> bytes:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 100_000, 100_000, 8, 2, 0, 0, 0))
    return b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", zlib.compress(b"")) + chunk(b"IEND", b"")


def flipped(data: bytes, at: float) -> bytes:
    position = int(len(data) * at)
    return data[:position] + bytes([data[position] ^ 0x55]) + data[position + 1 :]


def float_tiff(value: float) -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, np.full((40, 40), value, np.float32))
    return file.getvalue()


def cmyk_jpeg() -> bytes:
    file = io.BytesIO()
    Image.new("CMYK", (40, 40)).save(file, "JPEG")
    return file.getvalue()


def premultiplied_tiff() -> bytes:
    file = io.BytesIO()
    tifffile.imwrite(file, codes_like("colour", 8).samples.repeat(2, axis=2)[..., :4], photometric="rgb", extrasamples=["assocalpha"])
    return file.getvalue()


def encoded(kind: Format) -> bytes:
    return kind.module.encode(codes_like("colour", 8))


@pytest.mark.parametrize(
    ("data", "why"),
    [
        (b"just words", "must be a PNG, TIFF, JPEG or raw photograph"),
        (encoded(Format.PNG)[:-500], "is cut short"),
        (encoded(Format.PNG)[:20], "is cut short"),
        (flipped(encoded(Format.PNG), 0.5), "checksum"),
        (encoded(Format.JPEG)[:-500], "is damaged.*truncated"),
        (encoded(Format.JPEG)[:10], "is damaged"),
        (encoded(Format.TIFF)[:-500], "is damaged"),
        (encoded(Format.TIFF)[:10], "is damaged"),
        (flipped(encoded(Format.TIFF), 0.9), "is damaged"),
        (huge_png(), "at most 200 Mpx, its header says 100000 x 100000"),
        (float_tiff(0.5), "8 or 16 whole bits a sample, it has 32 bits of float32; "),
        (float_tiff(np.nan), "not finite"),
        (cmyk_jpeg(), "must be grey or RGB, it is CMYK"),
        (premultiplied_tiff(), "straight alpha"),
    ],
    ids=lambda value: value if isinstance(value, str) else "",
)
def test_damaged_and_strange_files_are_refused_by_name(tmp_path: Path, data: bytes, why: str) -> None:
    path = tmp_path / "picture.png"
    path.write_bytes(data)
    with pytest.raises(UnreadableError, match=rf"picture\.png .*{why}"):
        still.read(path)


def test_a_raw_that_is_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "picture.dng"
    path.write_bytes(b"II*\0" + bytes(2000))
    with pytest.raises(UnreadableError, match=r"picture\.dng is damaged"):
        still.read(path)


def test_a_raw_photograph_is_linear_and_in_sensor_order(shared: Path) -> None:
    photograph = still.read(next((shared / "real" / "raw").glob("*.dng")))
    assert photograph.pixels.shape == (1156, 1734, 3)
    assert photograph.codes.bits == 16
    assert photograph.pixels.mean() == pytest.approx(0.065, abs=0.005)  # no automatic brightness: the chart is dark in linear light
    np.testing.assert_allclose(photograph.pixels, photograph.codes.samples / 65535, atol=1e-6)
    data, notes = still.encode(photograph, photograph.pixels, Format.TIFF)
    assert not notes
    assert tifffile.imread(io.BytesIO(data)).dtype == np.uint16


def test_a_phone_photograph_says_its_exposure(shared: Path) -> None:
    shot = still.read(shared / "real" / "galaxynexus_chart" / "giro_data_image.jpg").capture
    assert shot.exposure == pytest.approx(0.059994)
    assert shot.camera == "Full AOSP on Maguro"


@pytest.mark.parametrize("name", ["a.png", "a.PNG", "a.tif", "a.TIFF", "a.jpg", "a.jpeg"])
def test_the_ending_names_the_format(name: str) -> None:
    assert Path(name).suffix.lower() in Format.of_output(Path(name)).value


@pytest.mark.parametrize("name", ["a", "a.bmp", "a.dng", ".png"])
def test_other_endings_are_refused(name: str) -> None:
    with pytest.raises(ValueError, match=r"must end in one of \.png"):
        Format.of_output(Path(name))


def test_a_jpeg_with_more_scans_than_a_picture_needs_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.jpg"
    Image.fromarray(np.random.default_rng(0).integers(0, 255, (40, 40, 3), np.uint8)).save(path, progressive=True)
    assert still.read(path).pixels.shape == (40, 40, 3)
    data = path.read_bytes()
    at = data.rindex(b"\xff\xda")
    scan = data[at:-2]
    path.write_bytes(data[:at] + scan * 300 + data[-2:])
    with pytest.raises(UnreadableError, match=r"a\.jpg must have at most 200 scans"):
        still.read(path)


def test_a_picture_that_the_machine_has_no_memory_for_is_refused_by_its_header(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.zeros((1000, 1000), np.uint8))
    monkeypatch.setattr(memory, "available", lambda: 20_000_000)
    with pytest.raises(UnreadableError, match=r"a\.png needs about 0\.03 GB of memory to be decoded.*1000 x 1000"):
        still.read(path)


def test_whatever_a_decoder_raises_is_the_file_s_fault(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.png"
    cv2.imwrite(str(path), np.zeros((8, 8), np.uint8))

    def overflows(_: bytes) -> None:
        raise OverflowError("Python int too large to convert to C long")

    monkeypatch.setattr(png, "decode", overflows)
    with pytest.raises(UnreadableError, match=r"a\.png is damaged: OverflowError"):
        still.read(path)
