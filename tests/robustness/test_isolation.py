"""Nothing but the file itself is opened: no other file, no connection, whatever a name or a file's contents ask for."""

import ctypes
import os
import socket
import struct
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import av
import av.error
import pytest

from tests.cli.forked import call
from tests.robustness.boxes import boxes
from tests.video.clips import make

pytestmark = pytest.mark.skipif(not hasattr(ctypes.CDLL(None), "inotify_init1"), reason="the system does not report which files are opened")
_OPENED = 0x20  # inotify's IN_OPEN


@dataclass(frozen=True)
class Trap:
    """A file that nobody may open, and a port that nobody may reach."""

    secret: Path
    port: int
    sprung: Callable[[], bool]


@pytest.fixture
def trap(tmp_path: Path) -> Iterator[Trap]:
    """The secret is a sound clip: whoever opens it has a reason to read on."""
    secret = make(tmp_path / "secret.mkv", codec="ffv1", frames=2)
    system = ctypes.CDLL(None, use_errno=True)
    watch = system.inotify_init1(os.O_NONBLOCK)
    assert system.inotify_add_watch(watch, os.fsencode(secret), _OPENED) > 0
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.setblocking(False)

        def sprung() -> bool:
            found = False
            for reached in (lambda: os.read(watch, 4096), lambda: server.accept()[0].close()):
                try:
                    reached()
                    found = True
                except BlockingIOError:
                    pass
            return found

        yield Trap(secret, server.getsockname()[1], sprung)
    os.close(watch)


def replaced(data: bytes, kind: bytes, body: bytes) -> bytes:
    """An MP4 with another body of its first box of a kind; the boxes around it grow with it."""
    whole = list(boxes(data))
    part = next(each for each in whole if each.kind == kind)
    made = bytearray(data[: part.body] + body + data[part.end :])
    for each in whole:
        if each.at <= part.at and each.end >= part.end:
            struct.pack_into(">I", made, each.at, each.end - each.at + len(body) - (part.end - part.body))
    return bytes(made)


def reference(kind: bytes, where: str) -> Callable[[Path, Trap], bytes]:
    """A clip whose samples are in another file, by a data reference of QuickTime."""

    def build(folder: Path, trap: Trap) -> bytes:
        data = make(folder / "sound.mov").read_bytes()
        (folder / "sound.mov").unlink()
        target = where.format(secret=trap.secret, port=trap.port).encode()
        body = struct.pack(">I", 0) + target + b"\0" if kind == b"url " else alias(trap.secret)
        return replaced(data, b"dref", struct.pack(">II", 0, 1) + struct.pack(">I4s", 8 + len(body), kind) + body)

    return build


def alias(target: Path) -> bytes:
    """A Macintosh alias record with the target's path, as FFmpeg understands it."""
    head = bytearray(150)
    struct.pack_into(">HH", head, 10 - 6, 150, 2)
    name = target.name.encode()
    head[4 + 50 : 4 + 51 + len(name)] = bytes([len(name)]) + name
    path = str(target).encode()
    return struct.pack(">I", 0) + bytes(head) + struct.pack(">HH", 2, len(path)) + path + struct.pack(">HH", 0xFFFF, 0)


def text(words: str) -> Callable[[Path, Trap], bytes]:
    """A playlist in words."""
    return lambda _, trap: words.format(secret=trap.secret, port=trap.port, name=trap.secret.name).encode()


def movie_reference(_: Path, trap: Trap) -> bytes:
    """A QuickTime movie that stands for another by its address."""
    url = f"http://127.0.0.1:{trap.port}/x.mov".encode() + b"\0"
    inner = struct.pack(">II4sI", 0, 0, b"url ", len(url)) + url
    for kind in (b"rdrf", b"rmda", b"rmra", b"moov"):
        inner = struct.pack(">I4s", 8 + len(inner), kind) + inner
    return struct.pack(">I4s4sI", 16, b"ftyp", b"qt  ", 0) + inner


CONTENTS = {
    "a playlist of a file": text("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\n{name}\n#EXT-X-ENDLIST\n"),
    "a playlist of an address": text("#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nhttp://127.0.0.1:{port}/x.ts\n#EXT-X-ENDLIST\n"),
    "ffconcat of a file": text("ffconcat version 1.0\nfile '{name}'\n"),
    "ffconcat of an address": text("ffconcat version 1.0\nfile 'http://127.0.0.1:{port}/x.mp4'\n"),
    "a session's description": text("v=0\no=- 0 0 IN IP4 127.0.0.1\ns=x\nc=IN IP4 127.0.0.1\nt=0 0\nm=video {port} RTP/AVP 96\n"),
    "a manifest": text('<?xml version="1.0"?><MPD><Period><BaseURL>http://127.0.0.1:{port}/</BaseURL></Period></MPD>'),
    "entities": text('<?xml version="1.0"?><!DOCTYPE x [<!ENTITY e SYSTEM "file://{secret}">]><MPD>&e;</MPD>'),
    "samples in a file": reference(b"url ", "file://{secret}"),
    "samples at an address": reference(b"url ", "http://127.0.0.1:{port}/x.mov"),
    "samples by an alias": reference(b"alis", ""),
    "a movie elsewhere": movie_reference,
}
NAMES = (
    "concat:{name}|{name}",
    "concat:{secret}",
    "file:{name}",
    "file://{secret}",
    "subfile,,start,0,end,0,,:{name}",
    "cache:{name}",
    "crypto:{name}",
    "async:{name}",
    "http://127.0.0.1:{port}/x.mp4",
    "http://127.0.0.1:{port}/x.png",
    "tcp://127.0.0.1:{port}/x.mkv",
    "rtmp://127.0.0.1:{port}/x.mkv",
    "tls://127.0.0.1:{port}/x.mkv",
    "hls+http://127.0.0.1:{port}/x.m3u8",
    "data:text/plain,{name}.mkv",
    "unix:{name}.mkv",
)


@pytest.mark.parametrize("suffix", [".mp4", ".m3u8"])
@pytest.mark.parametrize("content", CONTENTS)
def test_what_a_file_holds_opens_nothing_else(
    trap: Trap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, content: str, suffix: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(f"x{suffix}").write_bytes(CONTENTS[content](tmp_path, trap))
    done = call("deblur", f"x{suffix}", "-o", "out.png" if suffix == ".m3u8" else "out.mkv", "--method", "none")
    assert not trap.sprung()
    assert done.returncode == 3 or (content.startswith("samples") and not done.returncode), done.stderr


@pytest.mark.parametrize("name", NAMES)
def test_a_name_that_is_an_address_opens_nothing(trap: Trap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str) -> None:
    monkeypatch.chdir(tmp_path)
    source = name.format(secret=trap.secret, name=trap.secret.name, port=trap.port)
    job = tmp_path / "job.yaml"
    job.write_text(f"clips: ['{source}']\ndefaults: {{camera: {{exposure: 1/50, readout: 1ms}}, motion: {{model: shift}}}}\n")
    for words in (("deblur", source, "-o", "out.mkv", "--method", "none"), ("run", job, "--dry-run")):
        done = call(*words)
        assert done.returncode in (2, 3), done.stderr
    assert not trap.sprung()


@pytest.mark.parametrize("name", ["concat:secret.mkv", "file:secret.mkv", "cache:secret.mkv", "subfile,,start,0,end,0,,:secret.mkv"])
def test_a_file_that_is_named_like_an_address_is_the_file_itself(
    trap: Trap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.chdir(tmp_path)
    make(tmp_path / "x.mkv", codec="ffv1", frames=5, sound=True).rename(name)
    done = call("deblur", name, "-o", "out.mkv", "--method", "none")
    assert done.returncode == 0, done.stderr
    assert not trap.sprung()
    with av.open("out.mkv") as file:
        assert sum(1 for _ in file.decode(video=0)) == 5


def test_the_trap_springs_where_ffmpeg_is_left_to_itself(trap: Trap, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert not trap.sprung()
    with av.open(f"concat:{trap.secret.name}"):
        assert trap.sprung()
    Path("x.ffconcat").write_bytes(CONTENTS["ffconcat of a file"](tmp_path, trap))
    with av.open("x.ffconcat"):
        assert trap.sprung()
    with pytest.raises(av.error.FFmpegError):
        av.open(f"http://127.0.0.1:{trap.port}/x.mp4", timeout=0.5)
    assert trap.sprung()
