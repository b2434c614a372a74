from pathlib import Path

import numpy as np
import pytest

from rsvideo.video.clip import Picture
from rsvideo.video.decode import pictures, probe
from tests.video.clips import make, planes, scene


def same(one: Picture, other: Picture) -> bool:
    """All planes are equal."""
    return all(np.array_equal(a, b) for a, b in zip(one.planes, other.planes, strict=True))


@pytest.mark.parametrize(
    ("layout", "codec"),
    [
        ("yuv420p", "ffv1"),
        ("yuv422p", "ffv1"),
        ("yuv444p", "ffv1"),
        ("yuv411p", "ffv1"),
        ("yuv420p10le", "ffv1"),
        ("yuv422p10le", "ffv1"),
        ("yuv444p12le", "ffv1"),
        ("gbrp10le", "ffv1"),
        ("gbrp16le", "ffv1"),
        ("gray", "ffv1"),
        ("gray12le", "ffv1"),
    ],
)
def test_every_layout_comes_out_code_by_code(tmp_path: Path, layout: str, codec: str) -> None:
    stream = probe(make(tmp_path / "a.mkv", codec=codec, layout=layout, rows=47, cols=63, colour=(1, 1, 0 if "gbr" in layout else 1, 0)))
    assert stream.colour.pixel_format == layout
    for picture in pictures(stream):
        expected = planes(scene(picture.index, 47, 63, layout))
        if layout.startswith("gbr"):
            expected = [expected[2], expected[0], expected[1]]
        for plane, truth in zip(picture.planes, expected, strict=True):
            np.testing.assert_array_equal(plane, truth)


def test_packed_red_green_blue_comes_out_as_planes(tmp_path: Path) -> None:
    stream = probe(make(tmp_path / "a.mkv", codec="ffv1", layout="bgr0", colour=(1, 1, 0, 2)))
    assert stream.colour.pixel_format == "gbrp"
    blue_green_red = scene(3, layout="bgr24").to_ndarray()
    for k, plane in enumerate(list(pictures(stream))[3].planes):
        np.testing.assert_array_equal(plane, blue_green_red[..., 2 - k])


GROUPS = {
    "H.264 with B-pictures": ("libx264", "keyint=5:bframes=3:b-adapt=0"),
    "H.264 with open groups": ("libx264", "keyint=6:bframes=3:b-adapt=0:open-gop=1:b-pyramid=normal:scenecut=0"),
    "H.264 with intra refresh": ("libx264", "keyint=6:intra-refresh=1:bframes=0"),
    "HEVC with open groups": ("libx265", "keyint=6:bframes=3:b-adapt=0:open-gop=1:scenecut=0:pools=1"),
    "HEVC with closed groups": ("libx265", "keyint=5:min-keyint=5:bframes=2:open-gop=0:scenecut=0:pools=1"),
}


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
@pytest.mark.parametrize("group", GROUPS)
def test_any_picture_alone_is_what_decoding_from_the_start_gives(tmp_path: Path, group: str, suffix: str) -> None:
    codec, parameters = GROUPS[group]
    options = {"x265-params" if codec == "libx265" else "x264-params": parameters}
    stream = probe(make(tmp_path / f"a{suffix}", codec=codec, frames=20, options=options))
    everything = list(pictures(stream))
    assert [picture.index for picture in everything] == list(range(20))
    for first in range(20):
        alone = next(pictures(stream, first, first + 1))
        assert (alone.index, alone.pts, alone.time) == (first, everything[first].pts, everything[first].time)
        assert same(alone, everything[first]), first
    assert [picture.index for picture in pictures(stream, 7, 15)] == list(range(7, 15))
