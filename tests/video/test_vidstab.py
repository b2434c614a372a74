"""The peer that others use steadies a clip frame by frame, and says in one line what it cannot."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.restoration.tracks import track
from rsvideo.video import vidstab
from rsvideo.video.decode import probe
from tests.pipeline.moving import Moving, luma

needed = pytest.mark.skipif(not vidstab.available(), reason="the extra `vidstab` is not installed")


def steps(path: Path) -> np.ndarray:
    """px that the picture moves from frame to frame."""
    pictures = luma(path)
    pairs = [track(a, b) for a, b in pairwise(pictures)]
    return np.array([np.median(p.after - p.before, axis=0) for p in pairs])


@needed
def test_a_clip_is_steadier_and_keeps_its_frames_times_and_size(tmp_path: Path) -> None:
    clip = Moving(frames=10, exposure=0.5e-3, readout=0.01, reach=6.0, rows=144, cols=208).clip(tmp_path / "it's [a];clip.mp4")
    found = vidstab.stabilised(clip, tmp_path / "out.mkv", tmp_path)
    before, now = probe(clip), probe(found)
    assert (now.frames, now.rows, now.cols) == (10, 144, 208)
    seconds = [(s.times - s.times[0]) * float(s.time_base) for s in (before, now)]
    np.testing.assert_allclose(*seconds, atol=1e-3)
    was, left = (float(np.sqrt((steps(path) ** 2).sum(axis=1).mean())) for path in (clip, found))
    assert left < 0.7 * was


@needed
@pytest.mark.parametrize("name", ["a: b 'c' \"d\" \\e", "\u00fcber \u96ea [0:v];,=%d #1", "-y", "pipe:1"])
def test_any_name_of_source_result_and_folder_will_do(tmp_path: Path, name: str) -> None:
    folder = tmp_path / name
    folder.mkdir()
    clip = Moving(frames=3, rows=64, cols=96).clip(tmp_path / "clip.mp4").rename(folder / f"{name}.mp4")
    found = vidstab.stabilised(clip, folder / f"{name}.mkv", folder)
    assert probe(found).frames == 3
    assert sorted(path.name for path in folder.iterdir()) == sorted(["motion.trf", f"{name}.mp4", f"{name}.mkv"])


@needed
def test_what_is_no_clip_and_what_takes_too_long_are_told(tmp_path: Path) -> None:
    (tmp_path / "no.mp4").write_bytes(b"no clip at all")
    with pytest.raises(UnreadableError, match=r"no.mp4 could not be stabilised by vid.stab: .+"):
        vidstab.stabilised(tmp_path / "no.mp4", tmp_path / "out.mkv", tmp_path)
    clip = Moving(frames=2).clip(tmp_path / "clip.mp4")
    with pytest.raises(UnreadableError, match=r"took more than 0\.001 s"):
        vidstab.stabilised(clip, tmp_path / "out.mkv", tmp_path, timeout=0.001)


def test_without_the_program_it_is_told_how_to_get_it(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vidstab, "available", lambda: False)
    with pytest.raises(vidstab.UnavailableError, match=r"pip install 'rsvideo\[vidstab\]'"):
        vidstab.stabilised(tmp_path / "clip.mp4", tmp_path / "out.mkv", tmp_path)
