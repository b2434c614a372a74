"""Tables that promise what no file can hold, refused before FFmpeg makes room for it."""

import struct
from pathlib import Path

import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.video import sample_tables
from rsvideo.video.decode import probe
from tests.video.clips import make


def with_number(path: Path, kind: bytes, offset: int, value: int) -> Path:
    """The clip with a number in the body of each box of a kind replaced."""
    data, at = bytearray(path.read_bytes()), -1
    while (at := data.find(kind, at + 1)) >= 0:
        struct.pack_into(">I", data, at + 4 + offset, value)
    path.write_bytes(data)
    return path


def box(kind: bytes, *parts: bytes) -> bytes:
    body = b"".join(parts)
    return struct.pack(">I4s", len(body) + 8, kind) + body


@pytest.mark.parametrize("how", [{}, {"sound": True}, {"muxer": {"movflags": "frag_keyframe+empty_moov"}}])
def test_a_whole_clip_passes(tmp_path: Path, how: dict) -> None:
    sample_tables.check(make(tmp_path / "in.mp4", **how))


@pytest.mark.parametrize(
    ("kind", "offset", "fragments"),
    [(b"stsz", 8, False), (b"stsc", 12, False), (b"trun", 4, True)],  # samples; samples of a chunk; samples of a fragment
)
def test_fifty_million_samples_in_a_small_file_are_refused(tmp_path: Path, kind: bytes, offset: int, *, fragments: bool) -> None:
    path = make(tmp_path / "in.mp4", muxer={"movflags": "frag_keyframe+empty_moov"} if fragments else None)
    with pytest.raises(UnreadableError, match=r"in\.mp4 is damaged: its .* 50000000|chunks hold 50000000"):
        probe(with_number(path, kind, offset, 50_000_000))


def test_sound_may_have_more_samples_than_the_file_has_bytes_but_not_any_number(tmp_path: Path) -> None:
    sizes, handler = struct.pack(">4xII", 1, 300), bytes(8) + b"soun" + bytes(12)
    tables = box(b"minf", box(b"stbl", box(b"stsz", sizes)))
    path = tmp_path / "in.mov"
    path.write_bytes(box(b"moov", box(b"trak", box(b"mdia", box(b"hdlr", handler), tables))))
    assert path.stat().st_size < 300
    sample_tables.check(path)
    with pytest.raises(UnreadableError, match="promises 4000000000 samples"):
        sample_tables.check(with_number(path, b"stsz", 8, 4_000_000_000))


def test_boxes_within_boxes_have_an_end(tmp_path: Path) -> None:
    nest = b""
    for _ in range(20_000):
        nest = box(b"mdia", nest)
    (tmp_path / "in.mp4").write_bytes(box(b"ftyp", b"isom") + box(b"moov", box(b"trak", nest)) + box(b"mdat", b""))
    with pytest.raises(UnreadableError, match="nested more than 8 deep"):
        probe(tmp_path / "in.mp4")
