"""Photographs read into light and written from light or codes."""

from pathlib import Path

import cv2
import imageio.v3 as imageio
import numpy as np
import pytest

import rsvideo


@pytest.fixture
def codes() -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (40, 48, 3)).astype(np.uint8)


@pytest.mark.parametrize("ending", [".png", ".tif"])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_codes_are_written_as_they_are(codes: np.ndarray, tmp_path: Path, ending: str, depth: type) -> None:
    stored = codes.astype(depth) * (np.iinfo(depth).max // 255)
    assert rsvideo.write(tmp_path / f"a{ending}", stored) == ()
    found = cv2.imread(str(tmp_path / f"a{ending}"), cv2.IMREAD_UNCHANGED)
    assert found is not None
    np.testing.assert_array_equal(found[..., ::-1], stored)


def test_a_picture_is_read_and_written_without_loss(codes: np.ndarray, tmp_path: Path) -> None:
    imageio.imwrite(tmp_path / "a.png", codes)
    before = rsvideo.read(tmp_path / "a.png")
    rsvideo.write(tmp_path / "b.png", before)
    rsvideo.write(tmp_path / "c.png", before.pixels, like=before)
    for name in ("b.png", "c.png"):
        np.testing.assert_array_equal(imageio.imread(tmp_path / name), codes)


def test_light_alone_is_written_as_16_bits(tmp_path: Path) -> None:
    light = np.linspace(0, 1, 40 * 48).reshape(40, 48)
    rsvideo.write(tmp_path / "a.png", light)
    assert imageio.imread(tmp_path / "a.png").dtype == np.uint16
    again = rsvideo.read(tmp_path / "a.png")
    assert again.pixels.shape == (40, 48)
    np.testing.assert_allclose(again.pixels, light, atol=1e-4)
    np.testing.assert_array_equal(np.asarray(again), again.pixels)


def test_nothing_is_replaced_unless_that_is_wanted(codes: np.ndarray, tmp_path: Path) -> None:
    rsvideo.write(tmp_path / "a.png", codes)
    with pytest.raises(FileExistsError, match="overwrite=True"):
        rsvideo.write(tmp_path / "a.png", codes)
    rsvideo.write(tmp_path / "a.png", codes[::-1].copy(), overwrite=True)
    np.testing.assert_array_equal(imageio.imread(tmp_path / "a.png"), codes[::-1])


@pytest.mark.parametrize(
    ("name", "picture", "words", "line"),
    [
        ("a.gif", np.zeros((40, 48), np.uint8), {}, "must end in one of .png"),
        ("a.png", np.zeros((40, 48), np.uint8), {"transfer": "srgb"}, "the array holds codes"),
        ("a.jpg", np.zeros((40, 48), np.uint16), {}, "JPEG holds 8 bits a sample"),
        ("a.png", np.full((40, 48), 3.0), {}, "picture must hold linear light"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path: Path, name: str, picture: np.ndarray, words: dict, line: str) -> None:
    with pytest.raises(ValueError, match=line):
        rsvideo.write(tmp_path / name, picture, **words)
    assert not list(tmp_path.iterdir())


def test_a_file_that_is_not_there_is_unreadable(tmp_path: Path) -> None:
    with pytest.raises(rsvideo.UnreadableError, match="does not exist"):
        rsvideo.read(tmp_path / "a.png")
    with pytest.raises(rsvideo.UnreadableError):
        rsvideo.read_clip(tmp_path / "a.mp4")


def test_photographs_and_clips_are_not_taken_for_each_other(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match=r"a\.mp4 is taken for a clip; read_clip"):
        rsvideo.read(tmp_path / "a.mp4")
    with pytest.raises(ValueError, match=r"a\.png is taken for a photograph.*read\(path\)"):
        rsvideo.read_clip(tmp_path / "a.png")
    with pytest.raises(ValueError, match=r"a\.png is taken for a photograph.*deblur\(read\(path\)\)"):
        rsvideo.deblur_clip(tmp_path / "a.png")
