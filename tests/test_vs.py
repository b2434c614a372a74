"""Clips of VapourSynth restored along a sidecar: the command's pixels, in whatever order frames are wanted."""

from pathlib import Path

import numpy as np
import pytest

from rsvideo.config.files import UnreadableError
from rsvideo.video import decode
from tests.cli.forked import call
from tests.pipeline.moving import Moving

vs = pytest.importorskip("vapoursynth", reason="VapourSynth has wheels for Python 3.12 and later")

MOVING = Moving(frames=3)
GOOD = ("--exposure", "1/50", "--readout", "20ms", "--focal-px", str(MOVING.lens.fx), "--force")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return MOVING.clip(tmp_path_factory.mktemp("clip") / "in.mp4")


@pytest.fixture(scope="module")
def motion(source: Path) -> Path:
    done = call("track", source, "-o", source.with_name("a.rsvideo.json"), *GOOD)
    assert done.returncode == 0, done.stderr
    return source.with_name("a.rsvideo.json")


def node(pictures: list[tuple[np.ndarray, ...]], fps: int = 24):
    """The pictures as a clip of VapourSynth, tagged as BT.709."""

    def filled(n: int, f):
        out = f.copy()
        for k, plane in enumerate(pictures[n]):
            np.asarray(out[k])[:] = plane
        return out

    rows, cols = pictures[0][0].shape
    blank = vs.core.std.BlankClip(width=cols, height=rows, format=vs.YUV420P8, length=len(pictures), fpsnum=fps, fpsden=1)
    return blank.std.ModifyFrame(clips=blank, selector=filled).std.SetFrameProps(_Matrix=1, _Range=vs.RANGE_LIMITED)


def planes(path: Path) -> list[tuple[np.ndarray, ...]]:
    return [picture.planes for picture in decode.pictures(decode.probe(path))]


def test_a_clip_gets_the_commands_pixels_in_any_order(source: Path, motion: Path, tmp_path: Path) -> None:
    import rsvideo
    import rsvideo.vs

    how = ("--trajectory", motion, "--prior", "tv", "--codec", "ffv1")
    done = call("deblur", source, "-o", tmp_path / "out.mkv", *how)
    assert done.returncode == 0, done.stderr
    clip = rsvideo.vs.deblur(node(planes(source)), sidecar=motion, settings=rsvideo.Settings(prior="tv"))
    wanted = planes(tmp_path / "out.mkv")
    assert any((a[0] != b[0]).any() for a, b in zip(wanted, planes(source), strict=True))
    assert (clip.num_frames, clip.format.id) == (3, vs.YUV420P8)
    for n in (2, 0, 1, 0):
        with clip.get_frame(n) as frame:
            assert frame.props["_Matrix"] == 1
            for k, plane in enumerate(wanted[n]):
                np.testing.assert_array_equal(np.asarray(frame[k]), plane)


def test_another_clips_motion_is_refused(source: Path, motion: Path) -> None:
    import rsvideo.vs

    given = planes(source)
    with pytest.raises(UnreadableError, match="must hold the motion of frame 3"):
        rsvideo.vs.deblur(node([*given, given[0]]), sidecar=motion)
    with pytest.raises(UnreadableError, match="pictures of 160 x 96 px, the clip has 158 x"):
        rsvideo.vs.deblur(node(given).std.Crop(left=2), sidecar=motion)
    with pytest.raises(vs.Error, match=r"begins at 0.0416667 s, in the clip at 0.04 s"):
        rsvideo.vs.deblur(node(given, fps=25), sidecar=motion).get_frame(0)
    with pytest.raises(ValueError, match="one format of whole numbers"):
        rsvideo.vs.deblur(node(given).resize.Bicubic(format=vs.YUV444PS), sidecar=motion)
    with pytest.raises(ValueError, match=r"matrix 8 of H.273"):
        rsvideo.vs.deblur(node(given).std.SetFrameProps(_Matrix=8), sidecar=motion)
