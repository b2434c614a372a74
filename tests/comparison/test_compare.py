"""What a comparison reads, and how it names what it has read."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rsvideo.comparison import compare
from rsvideo.comparison.method_run import MethodRun
from rsvideo.config.request import Request
from rsvideo.progress import ignore
from rsvideo.stills import still


def test_each_photograph_is_read_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names = ("blurred", "uniform", "stitch", "truth")
    for name in names:
        cv2.imwrite(str(tmp_path / f"{name}.png"), np.random.default_rng(0).integers(0, 255, (64, 96, 3), np.uint8))
    files = {name: tmp_path / f"{name}.png" for name in names}
    runs = [MethodRun(method=name, output=files[name], seconds=1.0, peak_bytes=0) for name in ("uniform", "stitch")]
    read, opened = still.read, list[Path]()
    monkeypatch.setattr(still, "read", lambda path, *how: [opened.append(path), read(path, *how)][1])
    request = Request(source=files["blurred"], output=tmp_path / "out.png")
    found = compare.compared(request, runs, truth=files["truth"], crops=(), observe=ignore)
    assert [entry.name for entry in found.entries] == ["recorded", "uniform", "stitch", "truth"]
    assert sorted(opened) == sorted(files.values())


def test_a_path_is_shown_without_steps_up_and_down_again_unless_a_link_is_on_it(tmp_path: Path) -> None:
    for folder in ("jobs", "clips", "elsewhere/deep"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / "link").symlink_to(tmp_path / "elsewhere" / "deep")
    assert compare._plainly(tmp_path / "jobs" / ".." / "clips" / "a.mp4") == str(tmp_path / "clips" / "a.mp4")
    through = tmp_path / "link" / ".." / "a.mp4"
    assert compare._plainly(through) == str(through)
    assert compare._plainly(Path("clips/####.png")) == "clips/####.png"
