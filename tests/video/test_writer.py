import resource
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest

from rsvideo.video.decode import pictures, probe
from rsvideo.video.output_format import Codec, Encoding
from rsvideo.video.stream import Stream
from rsvideo.video.writer import Writer
from tests.video.clips import before_0, make, packets

IRREGULAR = [0, 3003, 6006, 7000, 12012, 12013, 20000, 90000]


def rewrite(stream: Stream, path: Path, encoding: Encoding | None = None, *, first: int = 0, last: int | None = None) -> Writer:
    """A null run: decode and write, nothing between."""
    with Writer(path, stream, encoding, first=first, last=last) as writer:
        for picture in pictures(stream, first, last):
            writer.write(picture)
    assert [file.name for file in path.parent.glob(".rsvideo-*")] == []
    return writer


def seconds(stream: Stream) -> list[Fraction]:
    """When each picture is shown, exactly."""
    return [int(t) * stream.time_base for t in stream.times]


def worst(one: Stream, other: Stream) -> int:
    """The largest difference of any code."""
    pairs = zip(pictures(one), pictures(other), strict=True)
    return max(int(np.abs(a.astype(int) - b).max()) for p, q in pairs for a, b in zip(p.planes, q.planes, strict=True))


LAYOUTS = ["yuv420p", "yuv422p", "yuv444p", "yuv420p10le", "yuv422p10le", "yuv444p12le", "gbrp10le", "gbrp16le", "gray", "gray12le"]


@pytest.mark.parametrize("layout", LAYOUTS)
def test_a_null_run_with_ffv1_changes_nothing(tmp_path: Path, layout: str) -> None:
    tags = (9, 16, 0 if "gbr" in layout else 9, 2 if "gbr" in layout else 1)
    source = make(tmp_path / "in.mkv", codec="ffv1", layout=layout, rows=47, cols=63, colour=tags, sound=True, rotation=90)
    before = probe(source)
    writer = rewrite(before, tmp_path / "out.mkv")
    after = probe(tmp_path / "out.mkv")
    assert writer.notes == ()
    assert worst(before, after) == 0
    assert (after.codec, after.time_base, after.colour) == (before.codec, before.time_base, before.colour)
    np.testing.assert_array_equal(after.times, before.times)
    assert after.rotation == 90
    assert packets(tmp_path / "out.mkv", "audio") == packets(source, "audio") != []


@pytest.mark.parametrize(("codec", "layout"), [("libx264", "yuv420p"), ("libx265", "yuv420p10le"), ("prores_ks", "yuv422p10le")])
@pytest.mark.parametrize("suffix", [".mp4", ".mov"])
def test_irregular_times_are_kept_exactly(tmp_path: Path, codec: str, layout: str, suffix: str) -> None:
    if codec == "prores_ks" and suffix == ".mp4":
        suffix = ".mov"
    before = probe(make(tmp_path / f"in{suffix}", codec=codec, layout=layout, times=IRREGULAR, base=Fraction(1, 90000)))
    rewrite(before, tmp_path / f"out{suffix}")
    after = probe(tmp_path / f"out{suffix}")
    assert seconds(after) == seconds(before) == [Fraction(t, 90000) for t in IRREGULAR]
    assert before.variable


@pytest.mark.parametrize(("codec", "suffix"), [("libx264", ".mp4"), ("libx264", ".mkv"), ("prores_ks", ".mov")])
def test_the_shape_of_pixels_is_kept(tmp_path: Path, codec: str, suffix: str) -> None:
    layout = "yuv422p10le" if codec == "prores_ks" else "yuv420p"
    before = probe(make(tmp_path / f"in{suffix}", codec=codec, layout=layout, aspect=Fraction(4, 3)))
    writer = rewrite(before, tmp_path / f"out{suffix}")
    assert probe(tmp_path / f"out{suffix}").sample_aspect_ratio == before.sample_aspect_ratio == Fraction(4, 3)
    assert writer.notes == ()


def test_a_shape_of_pixels_that_cannot_be_kept_is_said(tmp_path: Path) -> None:
    before = probe(make(tmp_path / "in.mkv", aspect=Fraction(4, 3)))
    assert any("4/3" in note and "not kept" in note for note in rewrite(before, tmp_path / "out.mkv", Encoding(codec="ffv1")).notes)


def test_a_clip_that_begins_late_begins_late_again(tmp_path: Path) -> None:
    times = [3000 + 1500 * k for k in range(8)]
    before = probe(make(tmp_path / "in.mp4", times=times, base=Fraction(1, 36000)))
    rewrite(before, tmp_path / "out.mp4")
    assert seconds(probe(tmp_path / "out.mp4")) == seconds(before)
    assert seconds(before)[0] > 0


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_a_clip_that_begins_before_0_begins_at_0_with_its_sound_and_chapters_as_much_later(tmp_path: Path, suffix: str) -> None:
    how = {"options": {"x264-params": "bframes=2:b-adapt=0"}, "timecode": "01:00:00:00", "chapters": True, "sound": True}
    source = before_0(make(tmp_path / "in.mp4", frames=12, **how), 6)
    stream = probe(source)
    assert seconds(stream)[0] == Fraction(-6, 24)
    rewrite(stream, tmp_path / f"out{suffix}", Encoding(codec="h264"))
    after = probe(tmp_path / f"out{suffix}")
    assert [round(24 * at) for at in seconds(after)] == list(range(12))
    assert after.timecode == "01:00:00:00"
    one, other = packets(source, "audio"), packets(tmp_path / f"out{suffix}", "audio")
    assert [data for _, data in one] == [data for _, data in other]
    assert all(abs(a + Fraction(6, 24) - b) <= Fraction(1, 1000) for (a, _), (b, _) in zip(one, other, strict=True))
    if suffix == ".mkv":  # in the others, FFmpeg lets the first chapter begin at 0 whatever it is told
        with av.open(str(tmp_path / f"out{suffix}")) as file:
            (chapter,) = file.chapters()
        assert round(1000 * chapter["start"] * (chapter["time_base"] or 0)) == 250


def test_a_part_of_a_clip_that_begins_before_0_has_the_timecode_of_its_own_place(tmp_path: Path) -> None:
    how = {"options": {"x264-params": "bframes=2:b-adapt=0"}, "timecode": "01:00:00:00"}
    stream = probe(before_0(make(tmp_path / "in.mp4", frames=12, **how), 6))
    rewrite(stream, tmp_path / "out.mp4", first=8)
    assert probe(tmp_path / "out.mp4").timecode == "01:00:00:08"


def test_matroska_rounds_times_to_the_millisecond_and_says_so(tmp_path: Path) -> None:
    before = probe(make(tmp_path / "in.mp4", times=[*IRREGULAR[:5], 20000, 20100, 20200], base=Fraction(1, 90000)))
    writer = rewrite(before, tmp_path / "out.mkv")
    after = probe(tmp_path / "out.mkv")
    assert any("millisecond" in note for note in writer.notes)
    assert max(abs(a - b) for a, b in zip(seconds(after), seconds(before), strict=True)) <= Fraction(1, 2000)


def test_matroska_is_refused_where_its_milliseconds_would_merge_pictures(tmp_path: Path) -> None:
    before = probe(make(tmp_path / "in.mp4", times=IRREGULAR, base=Fraction(1, 90000)))
    with pytest.raises(ValueError, match="millisecond"):
        rewrite(before, tmp_path / "out.mkv")
    assert [file.name for file in tmp_path.iterdir()] == ["in.mp4"]


@pytest.mark.parametrize("rotation", [0, 90, 180, -90])
@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_a_turned_phone_stays_turned_and_its_rows_stay_rows(tmp_path: Path, rotation: int, suffix: str) -> None:
    before = probe(make(tmp_path / f"in{suffix}", rotation=rotation, frames=2))
    assert (before.rows, before.cols) == (48, 64)
    assert (before.rotation - rotation) % 360 == 0
    rewrite(before, tmp_path / f"out{suffix}")
    after = probe(tmp_path / f"out{suffix}")
    assert (after.rows, after.cols, after.rotation, after.display_matrix) == (48, 64, before.rotation, before.display_matrix)


@pytest.mark.parametrize("tags", [(1, 1, 1, 1), (9, 16, 9, 1), (9, 18, 9, 2), (5, 6, 5, 1), (12, 1, 1, 2), (2, 2, 2, 0)])
@pytest.mark.parametrize("codec", ["libx264", "libx265"])
@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_colour_tags_are_kept(tmp_path: Path, tags: tuple[int, int, int, int], codec: str, suffix: str) -> None:
    before = probe(make(tmp_path / f"in{suffix}", codec=codec, layout="yuv420p10le", colour=tags, frames=2))
    rewrite(before, tmp_path / f"out{suffix}")
    after = probe(tmp_path / f"out{suffix}")
    assert after.colour == before.colour
    assert before.colour.h273[:3] == tags[:3]


def test_what_hdr10_says_of_its_display_is_kept_or_said_to_be_lost(tmp_path: Path) -> None:
    said = ("master-display=G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,1)", "max-cll=1000,400")
    options = {"x265-params": "pools=1:" + ":".join(said)}
    before = probe(make(tmp_path / "in.mp4", codec="libx265", layout="yuv420p10le", colour=(9, 16, 9, 1), options=options))
    assert before.mastering == said
    rewrite(before, tmp_path / "out.mp4")
    assert probe(tmp_path / "out.mp4").mastering == said
    assert any("HDR10" in note and "not kept" in note for note in rewrite(before, tmp_path / "out.mov", Encoding(codec="prores")).notes)


def test_a_full_range_clip_of_8_bits_stays_one(tmp_path: Path) -> None:
    before = probe(make(tmp_path / "in.mp4", layout="yuvj420p", colour=(1, 1, 1, 2)))
    assert before.colour.full_range
    rewrite(before, tmp_path / "out.mp4", Encoding(crf=0))
    after = probe(tmp_path / "out.mp4")
    assert after.colour == before.colour
    assert worst(before, after) == 0


@pytest.mark.parametrize("suffix", [".mp4", ".mov", ".mkv"])
def test_sound_is_copied_byte_by_byte(tmp_path: Path, suffix: str) -> None:
    source = make(tmp_path / f"in{suffix}", sound=True, frames=24)
    rewrite(probe(source), tmp_path / f"out{suffix}")
    assert packets(tmp_path / f"out{suffix}", "audio") == packets(source, "audio") != []


def test_dates_timecode_titles_and_chapters_are_kept(tmp_path: Path) -> None:
    tags = {"creation_time": "2017-04-17T19:27:57.000000Z", "title": "Bosporus, Üsküdar", "firmware": "HD5"}
    source = make(tmp_path / "in.mov", tags=tags, timecode="19:26:48:04", chapters=True, frames=24)
    writer = rewrite(probe(source), tmp_path / "out.mov")
    after = probe(tmp_path / "out.mov")
    assert (after.timecode, after.created) == ("19:26:48:04", tags["creation_time"])
    assert tags.items() <= after.metadata.items()
    with av.open(str(source)) as one, av.open(str(tmp_path / "out.mov")) as other:
        assert [c["metadata"] for c in other.chapters()] == [c["metadata"] for c in one.chapters()] == [{"title": "a beginning"}]
    assert writer.notes == ()


def test_a_part_begins_at_0_with_the_sound_and_the_timecode_of_its_time(tmp_path: Path) -> None:
    source = make(tmp_path / "in.mp4", frames=48, sound=True, timecode="09:59:59:20", options={"x264-params": "keyint=12"})
    before = probe(source)
    rewrite(before, tmp_path / "out.mp4", first=24, last=36)
    after = probe(tmp_path / "out.mp4")
    assert seconds(after) == [Fraction(k, 24) for k in range(12)]
    assert after.timecode == "10:00:00:20"
    whole, part = packets(source, "audio"), packets(tmp_path / "out.mp4", "audio")
    assert [data for at, data in whole if 1 <= at < Fraction(3, 2)] == [data for _, data in part]
    assert all(abs(a - 1 - b) < Fraction(1, 1000) for (a, _), (b, _) in zip([p for p in whole if p[0] >= 1], part, strict=False))


def test_a_cameras_sensors_are_kept_and_what_is_dropped_is_named(shared: Path, tmp_path: Path) -> None:
    source = shared / "real" / "gopro_mp4_gyro" / "karma.mp4"
    before = probe(source)
    writer = rewrite(before, tmp_path / "out.mp4", Encoding(crf=40), last=30)
    after = probe(tmp_path / "out.mp4")
    assert [track.codec for track in after.tracks] == ["aac", "gpmd", "tmcd"]
    assert after.timecode == before.timecode
    sensors = [data for _, data in packets(tmp_path / "out.mp4", "data") if len(data) > 4]
    assert sensors == [data for _, data in packets(source, "data") if len(data) > 4][: len(sensors)] != []
    assert len(writer.notes) == 1
    assert "fdsc" in writer.notes[0]
    assert "not carried over" in writer.notes[0]


@pytest.mark.parametrize(("rate", "frames"), [(1000, 8), (2, 4), (Fraction(30000, 1001), 1), (24, 1)])
@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
def test_every_rate_and_a_single_picture(tmp_path: Path, rate: Fraction | int, frames: int, suffix: str) -> None:
    before = probe(make(tmp_path / f"in{suffix}", rate=rate, frames=frames))
    assert before.frames == frames
    rewrite(before, tmp_path / f"out{suffix}")
    after = probe(tmp_path / f"out{suffix}")
    assert seconds(after) == seconds(before)
    assert after.rate == before.rate


@pytest.mark.parametrize(
    ("codec", "suffix", "layout", "held"),
    [
        ("prores", ".mov", "yuv420p", "yuv422p10le"),
        ("prores", ".mkv", "yuv444p", "yuv444p"),
        ("dnxhr", ".mov", "yuv420p", "yuv422p"),
        ("dnxhr", ".mov", "yuv420p10le", "yuv422p10le"),
        ("hevc", ".mp4", "yuv422p10le", "yuv422p10le"),
        ("h264", ".mp4", "yuv422p10le", "yuv422p10le"),
        ("ffv1", ".mkv", "yuv420p10le", "yuv420p10le"),
    ],
)
def test_every_codec_holds_the_picture_within_its_own_loss(tmp_path: Path, codec: Codec, suffix: str, layout: str, held: str) -> None:
    before = probe(make(tmp_path / "in.mkv", codec="ffv1", layout=layout, rows=144, cols=256, frames=2))
    writer = rewrite(before, tmp_path / f"out{suffix}", Encoding(codec=codec))
    after = probe(tmp_path / f"out{suffix}")
    assert after.colour.pixel_format.startswith(held)
    assert bool(writer.notes) == (held != layout) or suffix == ".mkv" or "millisecond" in writer.notes[0]
    shift = after.colour.depth - before.colour.depth
    for one, other in zip(pictures(before), pictures(after), strict=True):
        gap = np.abs((one.planes[0].astype(int) << shift) - other.planes[0]) / (1 << after.colour.depth)
        assert gap.mean() < 0.01


@pytest.mark.parametrize(
    ("codec", "name", "layout", "words"),
    [
        ("prores", "out.mp4", "yuv420p", ["ProRes", ".mov or .mkv"]),
        ("ffv1", "out.mov", "yuv420p", ["FFV1", ".mkv"]),
        ("h264", "out.avi", "yuv420p", [".mp4, .mov or .mkv", ".avi"]),
        ("h264", "out.mp4", "yuv444p12le", ["H.264", "12 bit", "FFV1"]),
        ("prores", "out.mov", "yuv420p12le", ["ProRes", "12 bit"]),
    ],
)
def test_what_a_codec_or_container_cannot_hold_is_refused(tmp_path: Path, codec: Codec, name: str, layout: str, words: list[str]) -> None:
    stream = probe(make(tmp_path / "in.mkv", codec="ffv1", layout=layout))
    with pytest.raises(ValueError) as refusal:  # noqa: PT011 - the words follow
        rewrite(stream, tmp_path / name, Encoding(codec=codec))
    assert all(word in str(refusal.value) for word in words), refusal.value
    assert [file.name for file in tmp_path.iterdir()] == ["in.mkv"]


@pytest.mark.parametrize(
    ("codec", "suffix", "layout"),
    [("h264", ".mp4", "yuv420p"), ("hevc", ".mp4", "yuv420p"), ("ffv1", ".mkv", "yuv420p"), ("prores", ".mov", "yuv422p10le")],
)
def test_the_same_pictures_make_the_same_bytes(tmp_path: Path, codec: Codec, suffix: str, layout: str) -> None:
    stream = probe(make(tmp_path / "in.mkv", codec="ffv1", layout=layout, rows=96, cols=160, frames=50, sound=True))
    chance, made = np.random.default_rng(0), set()
    for k in range(3):
        used = [np.frombuffer(chance.bytes(n), np.uint8).copy() for n in chance.integers(1000, 200_000, 300)]
        del used  # memory that holds something else each time
        rewrite(stream, tmp_path / f"{k}{suffix}", Encoding(codec=codec))
        made.add((tmp_path / f"{k}{suffix}").read_bytes())
    assert len(made) == 1


def test_an_interruption_leaves_nothing_and_what_stood_there(tmp_path: Path) -> None:
    stream = probe(make(tmp_path / "in.mp4"))
    (tmp_path / "out.mkv").write_text("the version before")

    def interrupted() -> None:
        with Writer(tmp_path / "out.mkv", stream, Encoding(codec="ffv1")) as writer:
            for picture in pictures(stream, 0, 4):
                writer.write(picture)
            assert len(list(tmp_path.glob(".rsvideo-*/out.mkv"))) == 1
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert sorted(file.name for file in tmp_path.iterdir()) == ["in.mp4", "out.mkv"]
    assert (tmp_path / "out.mkv").read_text() == "the version before"


def test_too_few_pictures_and_pictures_out_of_order_are_refused(tmp_path: Path) -> None:
    stream = probe(make(tmp_path / "in.mp4"))
    with pytest.raises(ValueError, match="8 pictures, 1 were written"), Writer(tmp_path / "out.mp4", stream) as writer:
        writer.write(next(pictures(stream)))
    with pytest.raises(ValueError, match="in order"), Writer(tmp_path / "out.mp4", stream) as writer:
        writer.write(next(pictures(stream, 3)))
    assert [file.name for file in tmp_path.iterdir()] == ["in.mp4"]


def test_a_file_that_does_not_read_back_is_not_called_done(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    stream = probe(make(tmp_path / "in.mp4"))
    monkeypatch.setattr("rsvideo.video.decode.pictures", lambda _: iter(()))
    with pytest.raises(OSError, match="read back"):
        rewrite(stream, tmp_path / "out.mp4")
    assert [file.name for file in tmp_path.iterdir()] == ["in.mp4"]


def test_a_folder_that_is_not_there_is_an_error_of_the_system(tmp_path: Path) -> None:
    stream = probe(make(tmp_path / "in.mp4"))
    with pytest.raises(OSError, match="No such file") as refusal:
        rewrite(stream, tmp_path / "nowhere" / "out.mp4")
    assert "out.mp4" in str(refusal.value.filename)


@pytest.mark.parametrize(("codec", "name"), [("h264", "out.mp4"), ("ffv1", "out.mkv"), ("tiff", "out")])
def test_a_full_disk_is_an_error_of_the_system_and_leaves_nothing(tmp_path: Path, codec: Codec, name: str) -> None:
    stream = probe(make(tmp_path / "in.mp4", rows=96, cols=128))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (6000, hard))
    try:
        with pytest.raises(OSError, match="File too large") as refusal:
            rewrite(stream, tmp_path / name, Encoding(codec=codec, crf=0))
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert name in str(refusal.value.filename)
    assert [file.name for file in tmp_path.iterdir()] == ["in.mp4"]


def test_subtitles_are_copied_or_said_to_be_dropped(tmp_path: Path) -> None:
    (tmp_path / "words.srt").write_text("1\n00:00:00,000 --> 00:00:00,200\nA word.\n\n")
    plain = make(tmp_path / "plain.mkv")
    with av.open(str(plain)) as one, av.open(str(tmp_path / "words.srt")) as two, av.open(str(tmp_path / "in.mkv"), "w") as out:
        tracks = {
            track.type: out.add_stream_from_template(track, opaque=True) for track in (one.streams.video[0], two.streams.subtitles[0])
        }
        for file in (one, two):
            for packet in file.demux():
                if packet.size:
                    packet.stream = tracks[packet.stream.type]
                    out.mux(packet)
    stream = probe(tmp_path / "in.mkv")
    assert [track.kind for track in stream.tracks] == ["subtitle"]
    rewrite(stream, tmp_path / "out.mkv")
    assert packets(tmp_path / "out.mkv", "subtitle") == packets(tmp_path / "in.mkv", "subtitle") != []
    writer = rewrite(stream, tmp_path / "out.mp4")
    assert any("subtitle" in note and "not carried over" in note for note in writer.notes)
