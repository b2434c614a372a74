"""Pictures come back from their file bit by bit, or not at all."""

import io
import zipfile
from pathlib import Path

import numpy as np
import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.video import planes
from rsvideo.video.decode import pictures, probe
from rsvideo.video.stream import Picture, Stream
from tests.video.clips import make


@pytest.fixture(scope="module")
def stream(tmp_path_factory: pytest.TempPathFactory) -> Stream:
    return probe(make(tmp_path_factory.mktemp("clip") / "in.mkv", codec="ffv1", layout="yuv420p10le", options={"level": "3"}))


def decoded(stream: Stream) -> list[Picture]:
    return list(pictures(stream))


def test_pictures_come_back_as_they_were(stream: Stream, tmp_path: Path) -> None:
    kept = decoded(stream)
    planes.write(tmp_path / "a.zip", kept)
    back = list(planes.read(tmp_path / "a.zip", stream, range(stream.frames)))
    for before, after in zip(kept, back, strict=True):
        assert (before.index, before.pts, before.duration, before.time) == (after.index, after.pts, after.duration, after.time)
        for p, q in zip(before.planes, after.planes, strict=True):
            assert p.dtype == q.dtype
            np.testing.assert_array_equal(p, q)
    assert [path.name for path in tmp_path.iterdir()] == ["a.zip"]


@pytest.mark.parametrize("kind", [np.uint8, np.uint16, np.float32])
def test_every_kind_of_sample_is_kept(stream: Stream, tmp_path: Path, kind: type) -> None:
    plane = (np.random.default_rng(0).standard_normal((5, 7)) * 100).astype(kind)
    planes.write(tmp_path / "a.zip", [Picture(planes=(plane,), index=3, pts=3, duration=1, time=0.125)])
    (back,) = planes.read(tmp_path / "a.zip", stream, [3])
    np.testing.assert_array_equal(back.planes[0], plane)
    assert back.planes[0].dtype == kind


def test_pictures_are_read_in_the_order_asked_for(stream: Stream, tmp_path: Path) -> None:
    planes.write(tmp_path / "a.zip", decoded(stream))
    assert [picture.index for picture in planes.read(tmp_path / "a.zip", stream, [5, 0, 2])] == [5, 0, 2]


def test_the_same_pictures_make_the_same_bytes(stream: Stream, tmp_path: Path) -> None:
    assert planes.write(tmp_path / "a.zip", decoded(stream)) == planes.write(tmp_path / "b.zip", decoded(stream))
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()
    assert planes.write(tmp_path / "c.zip", decoded(stream)[1:]) != planes.write(tmp_path / "d.zip", decoded(stream))


def test_nothing_is_left_of_a_file_that_was_not_finished(stream: Stream, tmp_path: Path) -> None:
    def broken():
        yield decoded(stream)[0]
        raise UnreadableError("the clip is damaged")

    with pytest.raises(UnreadableError):
        planes.write(tmp_path / "a.zip", broken())
    assert list(tmp_path.iterdir()) == []


def test_a_folder_that_is_missing_is_named(stream: Stream, tmp_path: Path) -> None:
    with pytest.raises(OSError, match="nowhere"):
        planes.write(tmp_path / "nowhere" / "a.zip", decoded(stream))


def test_any_damage_is_refused_or_does_no_harm(stream: Stream, tmp_path: Path) -> None:
    kept = decoded(stream)
    planes.write(tmp_path / "a.zip", kept)
    whole = (tmp_path / "a.zip").read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for at in [len(whole) // 2, *rng.integers(0, len(whole), 60).tolist()]:
        damaged = bytearray(whole)
        damaged[at] ^= 1 << int(rng.integers(8))
        (tmp_path / "b.zip").write_bytes(damaged)
        try:
            back = list(planes.read(tmp_path / "b.zip", stream, range(stream.frames)))
        except UnreadableError:
            refused += 1
        else:
            for before, after in zip(kept, back, strict=True):
                assert all(np.array_equal(p, q) for p, q in zip(before.planes, after.planes, strict=True))
    assert refused > 50


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 0.999])
def test_a_file_cut_short_is_refused(stream: Stream, tmp_path: Path, share: float) -> None:
    planes.write(tmp_path / "a.zip", decoded(stream))
    data = (tmp_path / "a.zip").read_bytes()
    (tmp_path / "a.zip").write_bytes(data[: int(share * len(data))])
    with pytest.raises(UnreadableError, match="damaged"):
        list(planes.read(tmp_path / "a.zip", stream, [0]))


def test_a_picture_that_is_not_there_is_refused(stream: Stream, tmp_path: Path) -> None:
    planes.write(tmp_path / "a.zip", decoded(stream)[:4])
    with pytest.raises(UnreadableError, match=r"damaged.*4"):
        list(planes.read(tmp_path / "a.zip", stream, [3, 4]))


def test_objects_are_never_unpickled(stream: Stream, tmp_path: Path) -> None:
    data = io.BytesIO()
    np.save(data, np.array([print], object), allow_pickle=True)
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        archive.writestr("0.0.steps", data.getvalue())
    with pytest.raises(UnreadableError, match=r"damaged.*allow_pickle"):
        list(planes.read(tmp_path / "a.zip", stream, [0]))
