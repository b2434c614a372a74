"""Chunks in a store: what is whole is found, whoever wrote it, and what is not is not believed."""

import hashlib
from pathlib import Path

import pytest

from rsvideo.batch.objects import Objects
from rsvideo.batch.places import Folder, Place
from rsvideo.batch.store import FOLDER, Store, in_use
from rsvideo.config.sidecar import Mark
from rsvideo.pipeline.pieces import Chunk, ChunkRecord

CHUNK = Chunk(index=3, first=12, last=15, warm_up=4)
DATA = {"000003.zip": b"pictures" * 1000, "000003.jsonl": b"frames"}
RECORD = ChunkRecord(
    pictures="000003.zip", frames="000003.jsonl", sha256={name: hashlib.sha256(data).hexdigest() for name, data in DATA.items()}
).model_dump_json()


def made(folder: Path) -> Path:
    folder.mkdir(parents=True)
    for name, data in DATA.items():
        (folder / name).write_bytes(data)
    return folder


MARK = Mark(job="job.yaml", input="a.mp4", settings="0", source="1")


@pytest.fixture(params=["folder", "objects"])
def stores(request: pytest.FixtureRequest, tmp_path: Path) -> Place:
    """Where a job keeps its stores."""
    if request.param == "folder":
        return Folder(path=tmp_path / "job" / FOLDER)
    return Objects(address=f"{request.getfixturevalue('bucket').address}/job")


@pytest.fixture
def store(stores: Place, tmp_path: Path) -> Store:
    """A store that holds one chunk."""
    store = Store.of(stores, "a.mp4", MARK)
    store.make()
    store.put(CHUNK, RECORD, made(tmp_path / "made"))
    return store


def test_a_chunk_comes_out_as_it_went_in(store: Store, tmp_path: Path) -> None:
    assert store.record(CHUNK) == RECORD
    assert store.fetch(CHUNK, RECORD, tmp_path / "taken")
    assert {path.name: path.read_bytes() for path in (tmp_path / "taken").iterdir()} == DATA
    store.remove()
    assert not store.there()
    assert not store.place.within("3").names()
    assert {path.name: path.read_bytes() for path in (tmp_path / "taken").iterdir()} == DATA


def test_other_settings_or_another_source_have_another_store(tmp_path: Path) -> None:
    stores = Folder(path=tmp_path)
    assert Store.of(stores, "a.mp4", MARK) == (store := Store.of(stores, "a.mp4", MARK))
    for changed in (MARK.model_copy(update={"settings": "1"}), MARK.model_copy(update={"source": "2"})):
        assert Store.of(stores, "a.mp4", changed) != store
    assert Store.of(stores, "b.mp4", MARK) != store


@pytest.mark.parametrize("ruin", [lambda data: b"P" + data[1:], lambda data: data[:-1], lambda _: b""], ids=["changed", "cut", "empty"])
@pytest.mark.parametrize("kind", ["data", "record"])
def test_what_does_not_hold_what_its_name_says_is_not_believed_and_can_be_put_again(store: Store, tmp_path: Path, kind: str, ruin) -> None:
    chunk = store.place.within("3")
    for name in chunk.names():
        if name.endswith(".json") == (kind == "record"):
            chunk.state(name, ruin(chunk.read(name, most=10_000)))
    assert kind == "record" or not store.fetch(CHUNK, RECORD, tmp_path / "taken")
    assert store.record(CHUNK) is None
    store.put(CHUNK, RECORD, made(tmp_path / "again"))
    assert store.record(CHUNK) == RECORD
    assert store.fetch(CHUNK, RECORD, tmp_path / "taken")


@pytest.mark.parametrize("stores", ["folder"], indirect=True)
def test_a_file_that_another_is_writing_is_not_cut_short(store: Store, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("rsvideo.batch.places.Folder.holds", lambda *_: False)  # as while the other has not come to its end
    chunk = Path(store.place.at("3"))
    with next(path for path in chunk.iterdir() if path.suffix != ".json" and path.stat().st_size > 100).open("rb") as reader:
        begin = reader.read(10)
        reads = []
        monkeypatch.setattr(
            "rsvideo.batch.places._blocks", lambda content: _pieces(content, lambda: reads.append(reader.seek(0) or reader.read()))
        )
        store.put(CHUNK, RECORD, made(tmp_path / "again"))
    assert begin == DATA["000003.zip"][:10]
    assert reads
    assert set(reads) == {DATA["000003.zip"]}


def _pieces(content: Path | bytes, between):
    data = content if isinstance(content, bytes) else content.read_bytes()
    for at in range(0, len(data), 1000):
        between()
        yield data[at : at + 1000]


@pytest.mark.parametrize("name", ["../outside", "/outside", "a/b", "..", ""])
def test_a_record_that_names_a_file_elsewhere_is_not_followed(store: Store, tmp_path: Path, name: str) -> None:
    digest = hashlib.sha256(DATA["000003.jsonl"]).hexdigest()
    hostile = ChunkRecord(pictures=name, frames=name, sha256={name: digest}).model_dump_json()
    assert not store.fetch(CHUNK, hostile, tmp_path / "taken")
    assert not (tmp_path / "taken").exists()
    for digest in ("../" + "0" * 61, "x"):
        assert not store.fetch(CHUNK, ChunkRecord(pictures="a", frames="a", sha256={"a": digest}).model_dump_json(), tmp_path / "taken")


def test_who_comes_too_late_leaves_nothing_behind(store: Store, tmp_path: Path) -> None:
    store.remove()
    with pytest.raises(FileNotFoundError):
        store.put(CHUNK, RECORD, tmp_path / "made")
    assert not store.place.within("3").names()
    assert store.record(CHUNK) is None


def test_a_chunk_of_which_no_record_came_is_not_there(store: Store, tmp_path: Path) -> None:
    chunk = store.place.within("3")
    held = {name: chunk.read(name, most=10_000) for name in chunk.names()}
    store.remove()
    store.make()
    for name, data in sorted(held.items(), key=lambda item: item[0].endswith(".json")):
        assert store.record(CHUNK) is None
        store.place.put(f"3/{name}", name.removesuffix(".json"), data)
    assert store.record(CHUNK) == RECORD


@pytest.mark.parametrize("stores", ["folder"], indirect=True)
def test_what_is_stored_is_in_use(store: Store, tmp_path: Path) -> None:
    assert in_use(tmp_path / "job")
    store.remove()
    assert not in_use(tmp_path / "job")
