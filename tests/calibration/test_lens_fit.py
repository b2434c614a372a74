"""Lenses found again from the views that they made."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from calibration.boards.detect import Corners, find
from calibration.boards.target import parse
from calibration.intrinsics.lens_fit import BENT, calibrate, fitted
from calibration.intrinsics.view_selection import select
from calibration.intrinsics.views import View, from_photographs
from calibration.projection import project
from tests.calibration.boards_in_view import FOCAL, picture

BOARD = parse("chessboard:9x6:25mm")
ROWS, COLS = 480, 640
TRUTH = {
    "brown-conrady": np.array([530.0, 532, 322, 237, -0.28, 0.09, 1e-3, -5e-4]),
    "brown-conrady, anamorphic": np.array([530.0, 705, 322, 237, -0.28, 0.09, 3e-3, -2e-3]),
    "fisheye": np.array([260.0, 261, 320, 240, 0.05, -0.02, 0.006, -0.001]),
}


def made(which: str, count: int, seed: int = 0, noise: float = 0.2, off: float = 0.0) -> list[View]:
    """Views of the board all over the picture, tilted to all sides; its corners lie `off` metres from their places, in each direction."""
    rng, numbers, corners = np.random.default_rng(seed), TRUTH[which], BOARD.object_points()
    model = which.partition(",")[0]
    bent = corners + off * np.random.default_rng(99).standard_normal(corners.shape)
    found = []
    while len(found) < count:
        far = rng.uniform(0.12, 0.5) if model == "fisheye" else rng.uniform(0.3, 0.7)
        turn = cv2.Rodrigues(rng.uniform(-0.7, 0.7, 3))[0]
        side = far * (1.6 if model == "fisheye" else 0.4)
        middle = np.array([rng.uniform(-side, side), rng.uniform(-side, side), far])
        shift = middle - turn @ corners.mean(axis=0)
        pose = np.concatenate([cv2.Rodrigues(turn)[0].ravel(), shift])
        points = project(model, numbers, bent, pose)[0]
        in_front = (corners @ turn.T + shift)[:, 2].min() > 0.02
        if not in_front or points.min() < 2 or (points > (COLS - 3, ROWS - 3)).any():
            continue
        observed = Corners(numbers=np.arange(len(points)), points=points + rng.normal(0, noise, points.shape))
        found.append(
            View(
                name=f"{len(found)}",
                corners=observed,
                object_points=corners,
                outline=((0, 0), (1, 1)),
                rows=ROWS,
                cols=COLS,
                edge_width=2.0,
            )
        )
    return found


@pytest.mark.parametrize("model", TRUTH)
def test_derivatives_match_differences(model: str) -> None:
    corners, numbers, pose = BOARD.object_points(), TRUTH[model], np.array([0.2, -0.3, 0.1, -0.1, -0.05, 0.5])
    model = model.partition(",")[0]
    _, by_pose, by_lens = project(model, numbers, corners, pose)
    h = 1e-6
    for k in range(6):
        step = h * np.eye(6)[k]
        difference = (project(model, numbers, corners, pose + step)[0] - project(model, numbers, corners, pose - step)[0]) / (2 * h)
        np.testing.assert_allclose(by_pose[:, k], difference.ravel(), rtol=1e-4, atol=1e-3)
    for k in range(len(numbers)):
        step = h * np.eye(len(numbers))[k]
        difference = (project(model, numbers + step, corners, pose)[0] - project(model, numbers - step, corners, pose)[0]) / (2 * h)
        np.testing.assert_allclose(by_lens[:, k], difference.ravel(), rtol=1e-4, atol=1e-3)


@pytest.mark.slow
@pytest.mark.parametrize("model", TRUTH)
def test_views_that_are_left_out_choose_the_lens_that_made_them(model: str) -> None:
    fit = calibrate(made(model, 14 if model == "fisheye" else 12))
    assert fit.lens.model == model.partition(",")[0]
    assert len(fit.lens.numbers) == 8
    assert (np.abs(fit.lens.numbers - TRUTH[model]) < 4 * fit.lens.std).all()
    assert fit.lens.numbers[:2] == pytest.approx(TRUTH[model][:2], rel=5e-3)
    assert fit.rms == pytest.approx(0.2 * np.sqrt(2), rel=0.1)


@pytest.mark.long
def test_errors_are_as_large_as_the_deviations_say() -> None:
    z = []
    for seed in range(5):
        fit = calibrate(made("brown-conrady", 8, seed), model="brown-conrady")
        z.append((fit.lens.numbers[:4] - TRUTH["brown-conrady"][:4]) / fit.lens.std[:4])
    assert 0.5 < np.sqrt(np.mean(np.square(z))) < 1.4


@pytest.mark.slow
def test_a_view_that_weighs_nothing_changes_nothing() -> None:
    good = made("brown-conrady", 7)
    bad = replace(good[0], corners=replace(good[0].corners, points=good[0].corners.points + np.linspace(0, 3, 54)[:, None]), weight=1e-9)
    one, other = calibrate(good[1:], model="brown-conrady"), calibrate([bad, *good[1:]], model="brown-conrady")
    if len(one.lens.numbers) == len(other.lens.numbers):
        np.testing.assert_allclose(one.lens.numbers, other.lens.numbers, rtol=1e-3, atol=1e-3)


@pytest.mark.long
def test_a_board_that_was_bent_is_refused_with_its_error() -> None:
    good = made("brown-conrady", 12)
    rows = np.linspace(-1, 1, 54) ** 2
    bent = replace(good[4], corners=replace(good[4].corners, points=good[4].corners.points + 4 * np.stack([rows, rows[::-1]], axis=1)))
    fit = calibrate([*good[:4], bent, *good[5:]])
    assert [one.name for one in fit.refused] == ["4"]
    assert "px, where half of the views have less than" in fit.refused[0].reason
    assert "4" not in [view.name for view in fit.views]
    assert fit.rms < 0.4


def test_two_views_are_too_few() -> None:
    with pytest.raises(ValueError, match="needs at least 3 views of the board, 2 can be used"):
        calibrate(made("brown-conrady", 2))


def test_three_views_will_do_without_any_left_out() -> None:
    fit = calibrate(made("brown-conrady", 3))
    assert fit.left_out == {}
    assert fit.lens.numbers[0] == pytest.approx(530, rel=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["aprilgrid:5x4:24mm:0.3", "charuco:7x5:DICT_4X4_50:30mm:22mm"])
def test_boards_of_tags_give_the_lens_though_parts_of_them_are_out_of_sight(name: str) -> None:
    board, found = parse(name), []
    rng = np.random.default_rng(3)
    for n in range(8):
        turn, middle = rng.uniform(-0.5, 0.5, 3).tolist(), (rng.uniform(-0.06, 0.06), rng.uniform(-0.04, 0.04), rng.uniform(0.22, 0.3))
        grey = picture(board, turn, middle)
        corners = find(board, grey)
        assert corners is not None
        at = board.object_points()[corners.numbers]
        found.append(View(name=str(n), corners=corners, object_points=at, outline=((0, 0), (1, 1)), rows=240, cols=320, edge_width=2.0))
    assert any(len(view.object_points) < len(board.object_points()) for view in found)
    fit = calibrate(found, model="brown-conrady")
    assert fit.lens.numbers[:2] == pytest.approx([FOCAL, FOCAL], rel=0.01)
    assert (np.abs(fit.lens.numbers[:4] - [FOCAL, FOCAL, 159.5, 119.5]) < 4 * fit.lens.std[:4]).all()


@pytest.mark.slow
def test_a_board_that_is_not_what_it_should_be_is_told_and_its_shape_found() -> None:
    views, truth = made("brown-conrady", 10, noise=0.1, off=1e-4), TRUTH["brown-conrady"]
    flat = calibrate(views, model="brown-conrady")
    assert flat.left_out_if_bent is not None
    assert flat.left_out_if_bent < BENT * min(flat.left_out.values())
    assert flat.displacement == 0
    assert (np.abs(flat.lens.numbers[:4] - truth[:4]) < 4 * flat.lens.std[:4]).all()
    free = calibrate(views, model="brown-conrady", bent=True)
    assert free.rms < 0.7 * flat.rms
    assert 1e-4 < free.displacement < 5e-4
    assert (np.abs(free.lens.numbers[:4] - truth[:4]) < 4 * free.lens.std[:4]).all()


@pytest.mark.slow
def test_a_board_that_is_what_it_should_be_is_not_called_bent() -> None:
    fit = calibrate(made("brown-conrady", 9), model="brown-conrady")
    assert fit.left_out_if_bent is not None
    assert fit.left_out_if_bent > min(fit.left_out.values())
    with pytest.raises(ValueError, match="a lens and the board's shape needs at least 8 views of the board, 7 can be used"):
        calibrate(made("brown-conrady", 7), bent=True)


def opencvs(folder: Path) -> list[View]:
    """The left camera's photographs."""
    taken = select(list(from_photographs(sorted(folder.glob("left??.jpg")), BOARD)), clip=False, readout=None)
    assert len(taken.views) == 13
    return list(taken.views)


PUBLISHED = np.array([535.91573396163199, 535.91573396163199, 342.28315473308373, 235.57082909788173])


@pytest.mark.slow
def test_opencvs_left_camera_is_found_as_opencv_finds_it(shared: Path) -> None:
    fit = calibrate(opencvs(shared / "real" / "boards" / "opencv_stereo_chessboard"))
    np.testing.assert_allclose(fit.lens.numbers[:3], PUBLISHED[:3], rtol=5e-3)
    assert abs(fit.lens.numbers[3] - PUBLISHED[3]) < 2 * fit.lens.std[3]  # 0.65 %; the next test tells why
    points = [view.corners.points.astype(np.float32) for view in fit.views]
    at = [view.object_points.astype(np.float32) for view in fit.views]
    theirs = cv2.calibrateCamera(at, points, (COLS, ROWS), np.eye(3), np.zeros(5))[0]
    assert fit.rms < 1.05 * theirs


def test_with_the_corners_of_the_published_calibration_its_numbers_are_met(shared: Path) -> None:
    """Its windows of 11 px reach the next corners where the board is far away, and pull those of one view 1.2 px aside."""
    folder, until = shared / "real" / "boards" / "opencv_stereo_chessboard", (cv2.TERM_CRITERIA_EPS | cv2.TERM_CRITERIA_MAX_ITER, 60, 1e-4)
    theirs = []
    for view in opencvs(folder):
        grey = np.asarray(cv2.imread(str(folder / view.name), cv2.IMREAD_GRAYSCALE))
        found, points = cv2.findChessboardCorners(grey, (9, 6))
        assert found
        points = cv2.cornerSubPix(grey, points, (11, 11), (-1, -1), until).reshape(-1, 2).astype(float)
        theirs.append(replace(view, corners=Corners(numbers=view.corners.numbers, points=points)))
    numbers = fitted(theirs, "brown-conrady", 5)
    np.testing.assert_allclose(numbers[:4], PUBLISHED, rtol=3e-4)


@pytest.mark.slow
def test_both_of_opencvs_cameras_find_the_same_bent_board(shared: Path) -> None:
    folder = shared / "real" / "boards" / "opencv_stereo_chessboard"
    shapes = []
    for side in ("left", "right"):
        taken = select(list(from_photographs(sorted(folder.glob(f"{side}??.jpg")), BOARD)), clip=False, readout=None)
        fit = calibrate(taken.views, model="brown-conrady", bent=True)
        assert fit.left_out_if_bent is not None
        assert fit.left_out_if_bent < 0.7 * min(fit.left_out.values())
        moved = fit.views[0].object_points - BOARD.object_points()
        c = BOARD.object_points() - BOARD.object_points().mean(axis=0)
        poses = [np.tile(axis, len(c)) for axis in np.eye(3)] + [np.cross(axis, c).ravel() for axis in np.eye(3)] + [c.ravel()]
        G = np.stack(poses, axis=1)  # what turning, shifting and scaling the whole board would do
        shapes.append(moved.ravel() - G @ np.linalg.lstsq(G, moved.ravel(), rcond=None)[0])
    assert np.corrcoef(*shapes)[0, 1] > 0.9
