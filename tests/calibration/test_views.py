"""Views chosen: the sharp, still and varied ones, and of each other one why not."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration import sources
from calibration.boards.target import parse
from calibration.intrinsics import views
from calibration.intrinsics.lens_fit import calibrate
from calibration.intrinsics.view_selection import Selection, select
from rsvideo.config.files import UnreadableError
from rsvideo.video import decode
from tests.calibration.boards_in_view import COLS, FOCAL, ROWS, clip, picture

BOARD = parse("chessboard:6x5:25mm")
POSES = [  # turn, middle
    ((0.3, 0.0, 0.0), (-0.05, -0.03, 0.35)),
    ((0.0, 0.4, 0.1), (0.06, 0.02, 0.36)),
    ((-0.4, 0.2, 0.0), (0.05, -0.03, 0.38)),
    ((0.1, -0.5, -0.1), (-0.05, 0.03, 0.36)),
    ((0.4, 0.4, 0.2), (0.0, 0.0, 0.30)),
    ((-0.3, -0.4, 0.0), (0.02, 0.03, 0.40)),
]


def saved(folder: Path, name: str, pixels: np.ndarray) -> Path:
    assert cv2.imwrite(str(folder / name), pixels)
    return folder / name


def reasons(selection: Selection) -> dict[str, str]:
    return {one.name: one.reason for one in selection.refused}


def test_each_photograph_that_is_not_used_is_told_why(tmp_path: Path) -> None:
    files = [saved(tmp_path, f"{n}.png", picture(BOARD, *pose)) for n, pose in enumerate(POSES)]
    files.append(saved(tmp_path, "again.png", picture(BOARD, *POSES[0])))
    files.append(saved(tmp_path, "blurred.png", picture(BOARD, (0.2, 0.1, 0), (0, 0.02, 0.33), blur=2.5)))
    files.append(saved(tmp_path, "empty.png", np.full((ROWS, COLS), 90, np.uint8)))
    files.append(saved(tmp_path, "small.png", cv2.resize(picture(BOARD, *POSES[1]), (COLS - 20, ROWS - 15))))
    (tmp_path / "letter.png").write_text("not a picture")
    files.append(tmp_path / "letter.png")
    selection = select(list(views.from_photographs(files, BOARD)), clip=False, readout=None)
    assert [view.name for view in selection.views] == [f"{n}.png" for n in range(6)]
    refused = reasons(selection)
    assert refused["again.png"] == "much like 0.png, which is sharper"
    assert refused["blurred.png"].startswith("blurred: its edges are")
    assert "must be a PNG, TIFF, JPEG or raw photograph" in refused["letter.png"]
    assert refused["empty.png"] == "the board was not found"
    assert refused["small.png"] == "it is 300 x 225, the others 320 x 240; another size is another mode"


def test_a_folder_stands_for_its_photographs(tmp_path: Path) -> None:
    saved(tmp_path, "b.png", np.zeros((4, 4), np.uint8))
    saved(tmp_path, "a.jpg", np.zeros((4, 4), np.uint8))
    (tmp_path / "notes.txt").write_text("none")
    assert [path.name for path in sources.photographs([tmp_path])] == ["a.jpg", "b.png"]


def test_files_of_one_name_in_two_folders_are_told_apart(tmp_path: Path) -> None:
    paths = [tmp_path / "a" / "1.png", tmp_path / "b" / "1.png", tmp_path / "2.png"]
    assert list(sources.by_name(paths)) == [str(paths[0]), str(paths[1]), "2.png"]


def test_pictures_without_the_board_are_refused_together(tmp_path: Path) -> None:
    files = [saved(tmp_path, "empty.png", np.full((ROWS, COLS), 90, np.uint8))]
    with pytest.raises(UnreadableError, match="the board was found in none of 1 pictures; is --board what was filmed"):
        select(list(views.from_photographs(files, BOARD)), clip=False, readout=None)


@pytest.fixture(scope="module")
def filmed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Each pose held for two frames; then the board is pulled aside at 4 px a frame, and at last slowly."""
    held = [picture(BOARD, *pose) for pose in POSES for _ in range(2)]
    fast = [picture(BOARD, (0.3, -0.3, 0), (-0.07 + 4 * k * 0.3 / FOCAL, -0.02, 0.3)) for k in range(4)]
    slow = [picture(BOARD, (-0.2, 0.4, 0), (0.02 + 2.5 * k * 0.4 / FOCAL, -0.02, 0.4)) for k in range(2)]
    return clip(tmp_path_factory.mktemp("filmed") / "board.mkv", [*held, *fast, *slow])


def test_frames_in_motion_are_refused_or_count_for_less_where_the_shutter_rolls(filmed: Path) -> None:
    stream = decode.probe(filmed)
    found = list(views.from_clip(stream, BOARD))
    selection = select(found, clip=True, readout=0.03)
    refused = reasons(selection)
    assert all(refused[f"frame {n}"].startswith("in motion: the rolling shutter shifted its last row by") for n in range(12, 15))
    weights = {view.name: view.weight for view in selection.views}
    assert weights["frame 0"] == 1
    assert 0.2 < weights["frame 16"] < 1
    assert any("count for less: frame 16" in note for note in selection.notes)
    held = select(found, clip=True, readout=0.0)
    assert not any("in motion" in line for line in reasons(held).values())


def test_speed_is_told_in_pixels_a_second(filmed: Path) -> None:
    speeds = {one.name: one.speed for one in views.from_clip(decode.probe(filmed), BOARD) if isinstance(one, views.View)}
    assert speeds["frame 0"] == pytest.approx(0, abs=2)
    assert speeds["frame 12"] == pytest.approx(4 * 25, rel=0.2)


def test_of_frames_that_look_alike_one_is_used(filmed: Path) -> None:
    selection = select(list(views.from_clip(decode.probe(filmed), BOARD)), clip=True, readout=None)
    pairs = [sum(f"frame {2 * n + k}" in {view.name for view in selection.views} for k in (0, 1)) for n in range(len(POSES))]
    assert pairs == [1] * len(POSES)
    assert any("which is sharper" in line for line in reasons(selection).values())
    assert any("hold it still, or give the readout" in note for note in selection.notes)


def test_the_lens_is_found_from_the_clip(filmed: Path) -> None:
    selection = select(list(views.from_clip(decode.probe(filmed), BOARD)), clip=True, readout=0.03)
    fit = calibrate(selection.views, model="brown-conrady")
    assert fit.lens.numbers[:2] == pytest.approx([FOCAL, FOCAL], rel=0.02)
    assert (np.abs(fit.lens.numbers[:4] - [FOCAL, FOCAL, COLS / 2 - 0.5, ROWS / 2 - 0.5]) < 5 * fit.lens.std[:4]).all()
