"""Sources from object storage on a machine's own disk: whole or not used, brought once, and never more than there is room for."""

import errno
import os
from pathlib import Path

import pytest

from rsvideo.batch import cache, objects
from rsvideo.config import address
from rsvideo.config.address import Origin
from rsvideo.config.files import UnreadableError
from rsvideo.config.lock import shared
from tests.batch.buckets import Bucket


def origin(bucket: Bucket, key: str) -> Origin:
    found = objects.origin(address.parsed(f"{bucket.address}/{key}"))
    assert found is not None
    return found


def held(folder: Path) -> set[str]:
    return {path.name for path in folder.glob("*/*")}


def test_a_source_is_brought_once(bucket: Bucket, monkeypatch: pytest.MonkeyPatch) -> None:
    bucket.put(**{"a.mp4": b"clip"})
    source = origin(bucket, "a.mp4")
    path = cache.bring(source)
    assert (path.name, path.read_bytes()) == ("a.mp4", b"clip")
    assert path.stat().st_mtime_ns == source.modified_ns  # on all machines, as part of how large sources are recognised
    monkeypatch.setattr(objects, "download", None)
    assert cache.bring(source) == path


def test_another_content_under_one_address_is_another_source(bucket: Bucket) -> None:
    bucket.put(**{"a.mp4": b"clip"})
    before = origin(bucket, "a.mp4")
    assert cache.bring(before).read_bytes() == b"clip"
    bucket.put(**{"a.mp4": b"PILC"})
    after = origin(bucket, "a.mp4")
    assert cache.bring(after).read_bytes() == b"PILC"
    assert cache.bring(before).read_bytes() == b"clip"


def test_a_source_that_changes_after_the_job_was_read_is_not_used(bucket: Bucket, tmp_path: Path) -> None:
    bucket.put(**{"a.mp4": b"clip", "b.mp4": b"clip"})
    changed, gone = origin(bucket, "a.mp4"), origin(bucket, "b.mp4")
    bucket.put(**{"a.mp4": b"PILC"})
    bucket.client.delete_object(Bucket=bucket.name, Key="b.mp4")
    for source in (changed, gone):
        with pytest.raises(UnreadableError, match="was changed or removed since the job was read"):
            cache.bring(source)
    assert not held(tmp_path / "sources")


def test_what_is_cut_short_is_brought_again(bucket: Bucket) -> None:
    bucket.put(**{"a.mp4": b"clip"})
    path = cache.place_of(origin(bucket, "a.mp4"))
    path.parent.mkdir(parents=True)
    path.write_bytes(b"cl")
    assert cache.bring(origin(bucket, "a.mp4")).read_bytes() == b"clip"


def test_the_oldest_that_nobody_reads_makes_room(bucket: Bucket, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    bucket.put(**{f"{name}.mp4": bytes(400) for name in "abc"})
    monkeypatch.setenv("RSVIDEO_CACHE_GB", "1e-6")
    paths = {}
    for age, name in enumerate("ab"):
        paths[name] = cache.bring(origin(bucket, f"{name}.mp4"))
        os.utime(paths[name].parent, (1000 + age, 1000 + age))
    left = tmp_path / "sources" / "brought-by-one-who-was-killed"
    left.mkdir()
    with shared(paths["a"].parent):
        cache._held.clear()
        cache._kept.close()
        cache.bring(origin(bucket, "c.mp4"))
    assert held(tmp_path / "sources") == {"a.mp4", "c.mp4"}
    assert not left.exists()


def test_what_does_not_fit_is_refused_with_what_would_help(bucket: Bucket, monkeypatch: pytest.MonkeyPatch) -> None:
    bucket.put(**{"a.mp4": bytes(2000)})
    monkeypatch.setenv("RSVIDEO_CACHE_GB", "1e-6")
    with pytest.raises(OSError, match="RSVIDEO_CACHE_GB allows more") as caught:
        cache.bring(origin(bucket, "a.mp4"))
    assert caught.value.errno == errno.EFBIG
    for given in ("many", "-1", "nan", "inf"):
        monkeypatch.setenv("RSVIDEO_CACHE_GB", given)
        with pytest.raises(ValueError, match="RSVIDEO_CACHE_GB must be a number of gigabytes"):
            cache.bring(origin(bucket, "a.mp4"))


def test_patterns_find_what_globs_find(bucket: Bucket) -> None:
    keys = ["a.mp4", "b.mov", "x/a.mp4", "x/y/a.mp4", "x/y/.hidden.mp4", "x/y/b.txt", "z/a.mp4"]
    bucket.put(**dict.fromkeys(keys, b"clip"))
    for pattern, found in {
        "*.mp4": ["a.mp4"],
        "x/*.mp4": ["x/a.mp4"],
        "*/*.mp4": ["x/a.mp4", "z/a.mp4"],
        "**/*.mp4": ["a.mp4", "x/a.mp4", "x/y/a.mp4", "z/a.mp4"],
        "x/**": ["x/a.mp4", "x/y/a.mp4", "x/y/b.txt"],
        "[xz]/a.*": ["x/a.mp4", "z/a.mp4"],
        "none/*": [],
    }.items():
        at = address.parsed(f"{bucket.address}/{pattern}")
        assert [each.address.removeprefix(f"{bucket.address}/") for each in objects.matching(at, most=100)] == found
    assert len(objects.matching(address.parsed(f"{bucket.address}/**"), most=2)) == 3


def test_too_many_objects_are_not_looked_through(bucket: Bucket, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(objects, "MOST_LOOKED_AT", 5)
    bucket.put(**{f"{n}.mp4": b"clip" for n in range(7)})
    with pytest.raises(ValueError, match="at most 5 objects to be looked at"):
        objects.matching(address.parsed(f"{bucket.address}/1*.mp4"), most=100)


def test_an_object_whose_name_might_do_harm_is_refused(bucket: Bucket) -> None:
    bucket.put(**{"a\x1b[2J.mp4": b"clip"})
    with pytest.raises(ValueError, match="no control characters"):
        objects.matching(address.parsed(f"{bucket.address}/*.mp4"), most=100)
