"""Clips that give two pictures one time, as converters that stumble write them."""

from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.video.decode import pictures, probe
from rsvideo.video.writer import Writer
from tests.video.clips import make, packets, retimed

STEP = 1000
FRAMES = 16
MISHAPS = {
    "two B-pictures share a time": ({5: 4}, [0, 1, 2, 3, 4, 5, 6]),
    "three pictures share a time": ({4: 5, 6: 5}, [0, 1, 2, 3, 5, 5 + 2 / 3, 6 + 1 / 3, 7]),
    "two share a time, two others are in the wrong order": ({2: 1, 1: 2, 5: 6}, [0, 1, 2, 3, 4, 6, 6.5]),
    "the last two share a time": ({FRAMES - 1: FRAMES - 2}, [0, 1, 2, 3, 4, 5, 6]),
}


def clip(path: Path) -> Path:
    """Sixteen pictures and sound, in the order I P B B."""
    options = {"x264-params": "bframes=2:b-adapt=0:keyint=9:min-keyint=9:scenecut=0"}
    times = [STEP * n for n in range(FRAMES)]
    return make(path, frames=FRAMES, times=times, base=Fraction(1, 24 * STEP), options=options, sound=True)


def stumbled(tmp_path: Path, suffix: str, moved: dict[int, int]) -> tuple[Path, Path]:
    """A sound clip, and the same with the times of some pictures moved, both in numbers of pictures."""
    whole = clip(tmp_path / f"whole{suffix}")
    stated = probe(whole).times
    return whole, retimed(whole, tmp_path / f"in{suffix}", {int(stated[a]): int(stated[b]) for a, b in moved.items()})


@pytest.mark.parametrize("suffix", [".mp4", ".mkv"])
@pytest.mark.parametrize("mishap", MISHAPS)
def test_pictures_of_one_time_are_all_shown_in_the_coded_order(tmp_path: Path, suffix: str, mishap: str) -> None:
    moved, begins = MISHAPS[mishap]
    whole, path = stumbled(tmp_path, suffix, moved)
    stream, truth = probe(path), list(pictures(probe(whole)))
    assert (np.diff(stream.times) > 0).all()
    assert [stream.seconds(k) for k in range(len(begins))] == pytest.approx([at / 24 for at in begins], abs=0.001)
    assert any("share one time" in note for note in stream.notes)
    found = list(pictures(stream))
    assert len(found) == FRAMES
    for one, other in zip(found, truth, strict=True):
        assert all(np.array_equal(a, b) for a, b in zip(one.planes, other.planes, strict=True)), one.index
    for first in range(FRAMES):
        alone = next(pictures(stream, first, first + 1))
        assert (alone.index, alone.pts) == (first, found[first].pts)
        assert np.array_equal(alone.planes[0], found[first].planes[0])


def test_the_written_clip_has_the_mended_times_and_the_sound_as_it_was(tmp_path: Path) -> None:
    _, path = stumbled(tmp_path, ".mp4", {5: 4})
    stream = probe(path)
    with Writer(tmp_path / "out.mp4", stream) as writer:
        for picture in pictures(stream):
            writer.write(picture)
    after = probe(tmp_path / "out.mp4")
    assert after.times.tolist() == stream.times.tolist()
    assert after.notes == ()
    assert packets(tmp_path / "out.mp4", "audio") == packets(path, "audio") != []


@pytest.mark.parametrize("moved", [{5: 4, 8: 14}, dict.fromkeys(range(4, 14), 15), {5: 4, 9: 14}])
def test_times_that_are_nonsense_are_still_refused(tmp_path: Path, moved: dict[int, int]) -> None:
    _, path = stumbled(tmp_path, ".mkv", moved)
    with pytest.raises(UnreadableError, match=r"two are at pts \d+, and .*; is it damaged\?"):
        probe(path)


def test_damaged_pictures_of_which_two_share_a_time_are_refused(tmp_path: Path) -> None:
    _, path = stumbled(tmp_path, ".mp4", {5: 4})
    data = bytearray(path.read_bytes())
    largest = max((sample for _, sample in packets(path, "video")[1:]), key=len)
    at = data.index(largest)
    data[at + 5 : at + len(largest)] = bytes(len(largest) - 5)
    path.write_bytes(data)
    with pytest.raises(UnreadableError, match="damaged"):
        list(pictures(probe(path)))


def test_a_real_clip_of_a_converter_that_stumbled_is_read_whole(shared: Path) -> None:
    stream = probe(shared / "real" / "handheld" / "video-10.m4v")
    assert stream.frames == sum(1 for _ in pictures(stream)) == 249
