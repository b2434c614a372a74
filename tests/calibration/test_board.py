"""Boards: named, printed to scale, and found again."""

import contextlib
import re
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.boards import sheet
from calibration.boards.detect import find
from calibration.boards.target import Kind, parse
from tests.calibration.boards_in_view import picture

CHESSBOARD, CHARUCO, GRID = "chessboard:9x6:25mm", "charuco:5x7:DICT_6X6_250:30mm:22mm", "aprilgrid:6x6:22mm:0.3"
BOARDS = [CHESSBOARD, CHARUCO, GRID, "charuco:6x8:dict_4x4_50:3cm:0.02m", "aprilgrid:5x3:30mm:9mm", "chessboard:4x3:30mm"]
PX_PER_MM = 10


def printed(name: str) -> np.ndarray:
    """The sheet at 10 px a mm."""
    return np.asarray(cv2.imdecode(np.frombuffer(sheet.draw(parse(name), name, kind="png"), np.uint8), cv2.IMREAD_GRAYSCALE))


def test_a_board_is_what_its_name_says() -> None:
    board = parse(CHARUCO)
    assert (board.kind, board.cols, board.rows, board.side, board.inner) == (Kind.CHARUCO, 5, 7, pytest.approx(0.03), pytest.approx(0.022))
    assert parse("aprilgrid:6x6:88mm:0.3").inner == pytest.approx(parse("aprilgrid:6x6:0.088m:26.4mm").inner)
    assert len(parse(CHESSBOARD).object_points()) == 54
    first, last = parse(GRID).object_points()[[0, -1], :2]  # tags are counted from the bottom left, as kalibr does
    assert first[0] < last[0]
    assert first[1] > last[1]
    assert parse(CHESSBOARD).extent == pytest.approx((0.25, 0.175))


@pytest.mark.parametrize(
    ("name", "line"),
    [
        ("chessbord:9x6:25mm", "did you mean chessboard?"),
        ("chessboard:9x6:25", "25 must be a length with its unit, such as 25mm"),
        ("chessboard:9x6:25km", "must be a length with its unit"),
        ("chessboard:9x6", "chessboard takes 2 parts after its name"),
        ("chessboard:9:25mm", "9 must be columns x rows, such as 9x6"),
        ("chessboard:2x6:25mm", "columns and rows must lie in 3 to 100"),
        ("chessboard:9x6:99m", "must lie in 1 mm to 10 m"),
        ("charuco:5x7:DICT_6X6_25:30mm:22mm", "did you mean DICT_6X6_250?"),
        ("charuco:5x7:DICT_6X6_250:30mm:32mm", "markers are smaller than their squares"),
        ("charuco:20x20:DICT_6X6_50:30mm:22mm", "it takes 200 markers, DICT_6X6_50 has 50"),
        ("", "board must be one such as chessboard:9x6:25mm"),
    ],
)
def test_a_slip_in_a_boards_name_is_told(name: str, line: str) -> None:
    with pytest.raises(ValueError, match=re.escape(line)):
        parse(name)


@given(st.text(max_size=40) | st.from_regex(r"(chessboard|charuco|aprilgrid):[0-9x]{1,6}:[0-9A-Za-z._]{1,12}(:[0-9.mc]{1,8}){0,3}"))
def test_any_name_is_a_board_or_a_fault(name: str) -> None:
    with contextlib.suppress(ValueError):
        assert len(parse(name).object_points()) >= 1


@pytest.mark.parametrize("name", BOARDS)
def test_a_printed_board_is_found_to_scale(name: str) -> None:
    board = parse(name)
    corners = find(board, printed(name))
    assert corners is not None
    assert len(corners.numbers) == len(board.object_points())
    at = board.object_points()[corners.numbers, :2] * 1e3 * PX_PER_MM
    np.testing.assert_allclose(corners.points - corners.points[0], at - at[0], atol=0.02)


@pytest.mark.parametrize("name", [CHARUCO, GRID])
@pytest.mark.parametrize("turns", [1, 2, 3])
def test_a_turned_and_partly_hidden_board_keeps_its_corners_numbers(name: str, turns: int) -> None:
    board, picture = parse(name), printed(name)
    picture[:, : picture.shape[1] * 2 // 5] = 255
    corners = find(board, np.ascontiguousarray(np.rot90(picture, turns)))
    assert corners is not None
    assert 6 <= len(corners.numbers) < len(board.object_points())
    at = board.object_points()[corners.numbers, :2] * 1e3 * PX_PER_MM
    turn = np.linalg.matrix_power(np.array([[0, -1], [1, 0]]), turns)  # of points (x, y), y down, when rows are turned counter-clockwise
    turned = at @ turn
    np.testing.assert_allclose(corners.points - corners.points[0], turned - turned[0], atol=0.05)


@pytest.mark.parametrize("name", ["chessboard:6x5:25mm", "charuco:7x5:DICT_4X4_50:30mm:22mm", "aprilgrid:4x3:36mm:0.3"])
def test_corners_of_a_tilted_board_lie_as_one_plane_is_corners(name: str) -> None:
    board, rng = parse(name), np.random.default_rng(3)
    for _ in range(8):
        turn, middle = rng.uniform(-0.5, 0.5, 3).tolist(), (rng.uniform(-0.03, 0.03), rng.uniform(-0.02, 0.02), rng.uniform(0.26, 0.34))
        corners = find(board, picture(board, turn, middle))
        assert corners is not None
        at = board.object_points()[corners.numbers, :2]
        plane, _ = cv2.findHomography(at, corners.points)
        assert np.abs(cv2.perspectiveTransform(at[None], plane)[0] - corners.points).max() < 0.4


@pytest.mark.slow
def test_a_picture_without_a_board_has_none() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (120, 160), dtype=np.uint8)
    for name in (CHESSBOARD, CHARUCO, GRID):
        assert find(parse(name), noise) is None
        assert find(parse(name), np.zeros((120, 160), np.uint8)) is None


@pytest.mark.parametrize("shape", [(1, 1), (2, 5), (1, 3000), (20_000, 30), (24, 24)])
def test_a_picture_of_any_shape_is_looked_at(shape: tuple[int, int]) -> None:
    checks = (np.indices(shape).sum(axis=0) // 3 % 2 * 255).astype(np.uint8)
    for name in (CHESSBOARD, CHARUCO, GRID):
        assert find(parse(name), checks) is None


def test_the_paper_is_to_scale() -> None:
    data = sheet.draw(parse(CHESSBOARD), CHESSBOARD)
    box = [float(x) for x in re.search(rb"/MediaBox \[ ?([^\]]*)\]", data)[1].split()]  # pyright: ignore[reportOptionalSubscript]
    assert box == pytest.approx([0, 0, 297 / 25.4 * 72, 210 / 25.4 * 72])
    page = b"".join(zlib.decompress(found[1]) for found in re.finditer(rb"stream\r?\n(x.*?)\r?\nendstream", data, re.DOTALL))
    number = rb"(-?[\d.]+)"
    corners = re.findall(rb"%s %s m\n%s %s l\n%s %s l\n%s %s l\n" % ((number,) * 8), page)
    squares = [np.array(corner, float).reshape(4, 2) / 72 * 25.4 for corner in corners]
    squares = [square for square in squares if np.ptp(square, axis=0) == pytest.approx([25, 25], abs=1e-3)]
    assert len(squares) == 35  # of 10 x 7, half are black
    assert np.ptp(np.concatenate(squares), axis=0) == pytest.approx([250, 175], abs=1e-3)


def test_a_board_that_does_not_fit_its_paper_is_refused() -> None:
    with pytest.raises(ValueError, match="must fit into 281 x 180 mm of A4, it is 300 x 210 mm; smaller squares, or a larger --paper"):
        sheet.draw(parse("chessboard:9x6:30mm"), "big")
    assert sheet.draw(parse("chessboard:9x6:30mm"), "big", paper="A3")


def test_the_charuco_photographs_are_recognised(shared: Path) -> None:
    folder = shared / "real" / "boards" / "opencv_aruco_photos"
    for name, board, least in (
        ("choriginal.jpg", CHARUCO, 24),
        ("charucoboard.jpg", CHARUCO, 24),
        ("screen_charuco.jpg", "charuco:6x8:DICT_4X4_50:30mm:22mm", 15),  # a screenshot with writing over it
    ):
        corners = find(parse(board), np.asarray(cv2.imread(str(folder / name), cv2.IMREAD_GRAYSCALE)))
        assert corners is not None
        assert len(corners.numbers) >= least
