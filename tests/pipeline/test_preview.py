"""A preview is one frame, quickly: the middle one of a clip's range, at half size where the picture is large."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from rsvideo.config.request import Request, Sections
from rsvideo.frame import Verdict
from rsvideo.pipeline import deblur, measuring, preview
from rsvideo.pipeline.prepare import prepare
from rsvideo.progress import ignore
from rsvideo.restoration import exposure
from tests.pipeline.moving import Moving, luma

CLIP = Moving(frames=5, rows=192, cols=320, reach=32)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return CLIP.clip(tmp_path_factory.mktemp("clip") / "in.mp4")


def request(source: Path, output: Path) -> Request:
    camera = {"exposure": CLIP.exposure, "readout": CLIP.readout, "focal_px": CLIP.lens.fx}
    return Request.of(source, output, Sections.model_validate({"camera": camera})).replaced(preview=True)


def decibels(codes: np.ndarray, truth: np.ndarray, margin: int = 12) -> float:
    """PSNR of luma, the border left out, which no neighbour shows."""
    inner = np.s_[margin:-margin, margin:-margin]
    return float(10 * np.log10(219**2 / np.mean((codes[inner].astype(float) - truth[inner]) ** 2)))


def as_luma(picture: np.ndarray) -> np.ndarray:
    return 16 + picture.astype(float).mean(axis=2) * 219 / 255


@pytest.mark.slow
@pytest.mark.parametrize("times", [1, 2])
def test_the_middle_frame_of_a_clip_is_sharper(source: Path, tmp_path: Path, times: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """At half size it is compared with the halved truth."""
    monkeypatch.setattr(preview, "HALVED", CLIP.rows + 2 - times)
    output = tmp_path / "out.png"
    done = deblur.carry_out(prepare(request(source, output)), ignore)
    assert done.verdict is Verdict.RESTORED
    assert any("frame 2" in note for note in done.notes)
    assert [path.name for path in tmp_path.iterdir()] == ["out.png"]
    found = cv2.imread(str(output))
    assert found is not None
    assert found.shape == (CLIP.rows // times, CLIP.cols // times, 3)
    size = found.shape[1::-1]
    before, truth = (cv2.resize(each[2].astype(np.float32), size, interpolation=cv2.INTER_AREA) for each in (luma(source), CLIP.truth))
    assert decibels(as_luma(found), truth) > decibels(before, truth) + 2


def test_what_nobody_states_is_not_measured_for_a_preview(source: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(measuring, "measured", lambda *_: pytest.fail("that takes longer than the preview"))
    monkeypatch.setattr(exposure, "of_each", lambda run, _: run.exposed(np.full(len(run.begins), 0.015)))
    bare = Request.of(source, tmp_path / "out.png", Sections()).replaced(preview=True)
    done = deblur.carry_out(prepare(bare), ignore)
    words = "exposure 15 ms is what its blur shows, readout 10.4 ms is assumed: a preview is not measured as a job is, by forty frames"
    assert words in done.notes


def test_half_a_picture_is_that_of_half_a_camera(source: Path, tmp_path: Path) -> None:
    task = prepare(request(source, tmp_path / "out.png"))
    half = preview.halved(task)
    assert (half.rows, half.cols) == (CLIP.rows // 2, CLIP.cols // 2)
    assert half.camera.intrinsics.fx == pytest.approx(CLIP.lens.fx / 2)
    assert half.timing.exposure == task.timing.exposure
    assert half.timing.readout == pytest.approx(task.timing.readout)
    assert half.settings.quality == "draft"


def test_a_clip_is_no_preview(source: Path, tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="the ending names the format"):
        prepare(request(source, tmp_path / "out.mp4"))


def test_a_pipe_has_no_middle(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="is a pipe, which is read in order"):
        prepare(request(Path("-"), tmp_path / "out.png"))
