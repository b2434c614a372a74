import math
import struct
import tracemalloc
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import av.logging
import numpy as np
import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.physics.tone import Transfer
from rsvideo.video.decode import pictures, probe
from rsvideo.video.stream import Matrix, Picture
from tests.video.clips import before_0, make, planes, scene, still


@pytest.mark.parametrize(("keys", "infinite"), [("4", False), ("1", True)])
def test_bits_are_those_of_pictures_that_need_others(keys: str, infinite: bool, tmp_path: Path) -> None:
    path = make(tmp_path / "in.mkv", options={"g": keys})
    with av.open(str(path)) as file:
        needing = [packet.size for packet in file.demux(video=0) if packet.size and not packet.is_keyframe]
    stream = probe(path)
    assert math.isinf(stream.bits) == infinite == (not needing)
    if needing:
        assert stream.bits == pytest.approx(8 * np.average(needing, weights=needing) / math.sqrt(stream.rows * stream.cols))


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


def test_times_that_vary_are_those_of_the_packets(tmp_path: Path) -> None:
    times = [0, 3003, 6006, 7000, 12012, 12013, 20000, 90000]
    stream = probe(make(tmp_path / "a.mp4", times=times, base=Fraction(1, 90000)))
    assert stream.times.tolist() == times
    assert stream.variable
    shown = list(pictures(stream))
    assert [picture.time for picture in shown] == pytest.approx([t / 90000 for t in times])
    assert [picture.duration for picture in shown[:-1]] == np.diff(times).tolist()


@pytest.mark.parametrize(("rate", "frames"), [(2, 4), (1000, 8), (Fraction(30000, 1001), 1), (Fraction(24000, 1001), 8)])
def test_the_rate_and_the_count_are_those_of_the_clip(tmp_path: Path, rate: Fraction | int, frames: int) -> None:
    stream = probe(make(tmp_path / "a.mp4", rate=rate, frames=frames))
    assert (stream.rate, stream.frames) == (rate, frames)
    assert stream.interval_s == pytest.approx(float(1 / Fraction(rate)))
    assert stream.duration_s == pytest.approx(frames / float(rate))
    assert not stream.variable


def test_what_is_not_tagged_is_assumed_and_said(tmp_path: Path) -> None:
    small = probe(make(tmp_path / "a.mkv", codec="ffv1", colour=(2, 2, 2, 0), frames=1)).colour
    assert small.assumed == {"matrix", "transfer", "primaries", "full_range"}
    assert (small.matrix, small.transfer, small.full_range) == (Matrix.BT601, Transfer.BT709, False)
    large = probe(make(tmp_path / "b.mkv", codec="ffv1", rows=720, cols=64, colour=(2, 2, 2, 0), frames=1)).colour
    assert large.matrix is Matrix.BT709
    assert "bt709 (assumed)" in large.note
    tagged = probe(make(tmp_path / "c.mp4", colour=(9, 16, 9, 1), layout="yuv420p10le", frames=1)).colour
    assert (tagged.matrix, tagged.transfer, tagged.primaries, tagged.full_range) == (Matrix.BT2020, Transfer.PQ, "bt2020", False)
    assert tagged.assumed == set()


def test_other_tracks_are_listed(tmp_path: Path) -> None:
    (track,) = probe(make(tmp_path / "a.mp4", sound=True)).tracks
    assert (track.kind, track.codec, track.copied) == ("audio", "aac", True)


def nothing(path: Path) -> None:
    pass


def empty(path: Path) -> None:
    path.touch()


def text(path: Path) -> None:
    path.write_text("this is a letter, not a clip\n" * 20)


def sound_only(path: Path) -> None:
    make(path, video=False, sound=True, frames=24)


def picture_named_mp4(path: Path) -> None:
    path.write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(100))


def playlist(path: Path) -> None:
    path.write_text("#EXTM3U\n#EXTINF:1,\n/etc/passwd\n")


def without_index(path: Path) -> None:
    make(path)
    data = path.read_bytes()
    path.write_bytes(data[: data.index(b"moov") - 4])


def longer_in_its_header(path: Path) -> None:
    """mvhd, tkhd, mdhd and the edit list promise ten times as much."""
    make(path, frames=24)
    data = bytearray(path.read_bytes())
    for kind, offset in ((b"mvhd", 16), (b"mdhd", 16), (b"tkhd", 20), (b"elst", 8)):
        at = data.index(kind) + 4 + offset
        struct.pack_into(">I", data, at, 10 * struct.unpack_from(">I", data, at)[0])
    path.write_bytes(data)


def more_samples_in_its_header(path: Path) -> None:
    """The table of sample sizes and the last run of durations say 5 pictures more, and the chunk that it has more."""
    make(path, frames=12, options={"x264-params": "bframes=0"})
    data = bytearray(path.read_bytes())
    at = data.index(b"stts") + 4 + 8
    struct.pack_into(">I", data, at, struct.unpack_from(">I", data, at)[0] + 500)
    path.write_bytes(data)


def two_sizes(path: Path) -> None:
    """The second half of the stream has other dimensions, told in the stream alone."""
    one, other = make(path.with_name("one.mkv"), options={"x264-params": "keyint=4:bframes=0:repeat-headers=1"}), None
    other = make(path.with_name("other.mkv"), rows=64, cols=96, options={"x264-params": "keyint=4:bframes=0:repeat-headers=1"})
    with av.open(str(one)) as first, av.open(str(other)) as second, av.open(str(path), "w", format="mp4") as out:
        track = out.add_stream_from_template(first.streams.video[0], opaque=True)
        for start, file in ((0, first), (8, second)):
            headers = file.streams.video[0].codec_context.extradata
            assert headers
            for number, packet in enumerate(packet for packet in file.demux(video=0) if packet.size):
                data = bytes(packet)
                if number == 0 and start:  # parameter sets before the first picture, each behind its length
                    sps = 8
                    sps_length = int.from_bytes(headers[6:8])
                    pps = sps + sps_length + 3
                    pps_length = int.from_bytes(headers[pps - 2 : pps])
                    sets = [headers[sps : sps + sps_length], headers[pps : pps + pps_length]]
                    data = b"".join(len(part).to_bytes(4) + part for part in sets) + data
                joined = av.Packet(data)
                joined.stream, joined.time_base = track, Fraction(1, 24)
                joined.pts = joined.dts = start + number
                joined.is_keyframe = packet.is_keyframe
                out.mux(joined)


def far_too_fast(path: Path) -> None:
    """As if a flipped bit had made the clock tick 16384 times as fast."""
    make(path, frames=10)
    data = bytearray(path.read_bytes())
    at = data.index(b"mdhd") + 4 + 12
    struct.pack_into(">I", data, at, 16384 * struct.unpack_from(">I", data, at)[0])
    path.write_bytes(data)


def after_the_end_of_time(path: Path) -> None:
    """Its fragments are said to begin some millions of years from now."""
    make(path, muxer={"movflags": "frag_keyframe+empty_moov"})
    data = bytearray(path.read_bytes())
    at = data.index(b"tfdt") + 4
    struct.pack_into(">BxxxQ", data, at, 1, 1 << 60)
    path.write_bytes(data)


def long_before_0(path: Path) -> None:
    before_0(make(path, frames=12), 24 * 61)


def of_a_codec_that_nobody_has(path: Path) -> None:
    make(path)
    path.write_bytes(path.read_bytes().replace(b"avc1", b"zzzz").replace(b"avcC", b"zzzC"))


@pytest.mark.parametrize(
    ("build", "words"),
    [
        (far_too_fast, ["pictures a second", "is its header damaged"]),
        (after_the_end_of_time, ["must be shown within", "is its header damaged"]),
        (long_before_0, ["60 s before time 0 at most", "-61 s", "is its header damaged"]),
        (of_a_codec_that_nobody_has, ["stores its pictures in a way that is not read"]),
        (nothing, ["does not exist"]),
        (empty, ["is empty"]),
        (text, ["must be an MP4, MOV or MKV clip"]),
        (picture_named_mp4, ["must be an MP4, MOV or MKV clip"]),
        (playlist, ["must be an MP4, MOV or MKV clip"]),
        (sound_only, ["must hold video, it holds audio"]),
        (without_index, ["cut short"]),
        (longer_in_its_header, ["cut short", "promises"]),
        (more_samples_in_its_header, ["promises"]),
        (two_sizes, ["one size", "64 x 48", "96 x 64", "picture 8"]),
    ],
    ids=lambda case: getattr(case, "__name__", None),
)
def test_what_is_not_a_whole_clip_is_refused_in_one_line(tmp_path: Path, build: Callable[[Path], None], words: list[str]) -> None:
    path = tmp_path / "ünter wegs.mp4"
    build(path)
    with pytest.raises(UnreadableError) as refusal:
        list(pictures(probe(path)))
    assert str(path) in str(refusal.value)
    assert all(word in str(refusal.value) for word in words), refusal.value
    assert "\n" not in str(refusal.value)


CODERS = [("libx264", ".mp4"), ("libx265", ".mp4"), ("libx264", ".mkv"), ("libx265", ".mkv"), ("prores_ks", ".mov"), ("ffv1", ".mkv")]


def coded(path: Path, codec: str, **how: Any) -> bytes:
    """The bytes of a clip of twelve pictures."""
    return make(path, codec=codec, layout="yuv422p10le" if codec == "prores_ks" else "yuv420p", frames=12, **how).read_bytes()


@pytest.mark.parametrize(
    ("codec", "suffix", "flags"),
    [(*coder, flags) for coder in CODERS for flags in ("", "+faststart", "+frag_keyframe+empty_moov") if coder[1] != ".mkv" or not flags],
)
def test_a_clip_cut_short_anywhere_is_refused(tmp_path: Path, codec: str, suffix: str, flags: str) -> None:
    data = coded(tmp_path / f"a{suffix}", codec, muxer={"movflags": flags} if flags else None)
    cut = tmp_path / f"b{suffix}"
    for share in (0.05, 0.2, 0.4, 0.6, 0.8, 0.95, 0.999):
        cut.write_bytes(data[: int(share * len(data))])
        with pytest.raises(UnreadableError):
            list(pictures(probe(cut)))


@pytest.mark.parametrize(("codec", "suffix"), CODERS)
def test_bits_that_flipped_never_lose_pictures_unnoticed(tmp_path: Path, codec: str, suffix: str) -> None:
    data = coded(tmp_path / f"a{suffix}", codec)
    damaged, rng, found = tmp_path / f"b{suffix}", np.random.default_rng(0), 0
    for _ in range(20):
        flipped = bytearray(data)
        for at in rng.integers(600, len(data) - 900, 8):
            flipped[at] ^= 1 << rng.integers(8)
        damaged.write_bytes(flipped)
        try:
            assert [picture.index for picture in pictures(probe(damaged))] == list(range(12))
        except UnreadableError:
            found += 1
    assert found >= (20 if suffix == ".mkv" else 5)  # Matroska's checksums see all; MP4 has none, and a coder may find sense in nonsense


def in_the_middle(path: Path, codec: str, suffix: str) -> Path:
    """A clip with a key picture every four, whose fifth to eighth pictures are damaged."""
    name = "x265-params" if codec == "libx265" else "x264-params"
    source = make(path.with_suffix(suffix), codec=codec, frames=12, options={name: "keyint=4:min-keyint=4:scenecut=0:bframes=0"})
    with av.open(str(source)) as file:
        packet = [packet for packet in file.demux(video=0) if packet.size][5]
        assert packet.pos is not None
        start, length = packet.pos, packet.size
    data = bytearray(source.read_bytes())
    data[start + 5 : start + length] = bytes(length - 5)
    source.write_bytes(data)
    return source


@pytest.mark.parametrize("codec", ["libx264", "libx265"])
def test_damage_is_refused_passed_through_or_skipped_as_asked(tmp_path: Path, codec: str) -> None:
    whole = list(pictures(probe(make(tmp_path / "whole.mp4", codec=codec, frames=12, options={}))))
    stream = probe(in_the_middle(tmp_path / "a", codec, ".mp4"), on_damage="skip")
    with pytest.raises(UnreadableError, match="picture"):
        list(pictures(stream))
    passed = list(pictures(stream, on_damage="passthrough"))
    assert [picture.pts for picture in passed] == [picture.pts for picture in whole]
    assert [picture.index for picture in passed if picture.damaged] == [5, 6, 7]
    skipped = list(pictures(stream, on_damage="skip"))
    assert [picture.index for picture in skipped] == [0, 1, 2, 3, 4, 8, 9, 10, 11]
    assert [picture.index for picture in pictures(stream, 6, 10, on_damage="skip")] == [8, 9]
    assert [picture.index for picture in pictures(stream, 8, 12)] == [8, 9, 10, 11]  # where nothing is damaged


def test_a_clip_cut_short_gives_what_is_there_if_asked(tmp_path: Path) -> None:
    data = coded(tmp_path / "a.mp4", "libx264", muxer={"movflags": "+faststart"})
    (tmp_path / "b.mp4").write_bytes(data[: int(0.8 * len(data))])
    stream = probe(tmp_path / "b.mp4", on_damage="skip")
    assert 0 < len(list(pictures(stream, on_damage="skip"))) < 12


def test_a_few_bytes_that_would_be_decoded_for_hours_are_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = still(tmp_path / "a.mp4", rows=1080, cols=1920, frames=24)
    assert probe(path).frames == 24
    monkeypatch.setattr("rsvideo.video.probing._FREE_PIXELS", 0)
    with pytest.raises(UnreadableError, match=r"it shows 49.77 Mpx and holds \d+ bytes of them; is it one picture that stands still"):
        probe(path)


def test_pictures_are_not_kept(tmp_path: Path) -> None:
    stream = probe(make(tmp_path / "a.mkv", codec="ffv1", rows=270, cols=480, frames=12))
    tracemalloc.start()
    for picture in pictures(stream):
        assert picture.planes
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 6 * 270 * 480 * 1.5


def test_ffmpegs_own_logging_is_left_as_it_was(tmp_path: Path) -> None:
    before = av.logging.get_level()
    list(pictures(probe(make(tmp_path / "a.mp4"))))
    assert av.logging.get_level() == before


def test_a_name_is_a_file_and_never_an_address(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    clip = make(tmp_path / "a.mp4")
    monkeypatch.chdir(tmp_path)
    Path("http:").mkdir()
    for name in ("concat:a.mp4|a.mp4", "subfile,,start,0,end,0,,:a.mp4", "http:/a.mp4", "data:a.mp4"):
        Path(name).write_bytes(clip.read_bytes())
        stream = probe(Path(name))
        assert len(list(pictures(stream))) == stream.frames == 8
