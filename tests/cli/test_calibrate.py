"""rsvideo calibrate, as a person uses it who measures their own camera."""

import json
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from rsvideo.cli import app
from rsvideo.cli.exit_codes import code_and_line
from rsvideo.physics import tone
from rsvideo.physics.tone import Transfer
from rsvideo.shooting import profiles
from tests.cli.conftest import Run

BOARD = "chessboard:6x5:25mm"
FOCAL, ROWS, COLS = 300.0, 240, 320
VIEWS = 7


def refused(code: int, line: str, *words: object) -> None:
    """The command ends with `code` and a line that holds `line`; called in this process, which is faster."""
    done = CliRunner().invoke(app, ["calibrate", *map(str, words)], standalone_mode=False)
    assert done.exception is not None
    got, said = code_and_line(done.exception)
    assert got == code, said
    assert line in said


@pytest.fixture(scope="module")
def printed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sheet at 10 px a mm, drawn by the command."""
    path = tmp_path_factory.mktemp("sheet") / "board.png"
    done = CliRunner().invoke(app, ["calibrate", "board", "--board", BOARD, "-o", str(path)])
    assert done.exit_code == 0, done.output
    return path


@pytest.fixture(scope="module")
def views(printed: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Photographs of the sheet by a camera whose lens is known."""
    folder, paper = tmp_path_factory.mktemp("views"), np.asarray(cv2.imread(str(printed), cv2.IMREAD_GRAYSCALE))
    rows, cols = paper.shape
    metres = np.array([[1e-4, 0, -0.5e-4 * cols], [0, 1e-4, -0.5e-4 * rows], [0, 0, 1]])
    camera = np.array([[FOCAL, 0, COLS / 2 - 0.5], [0, FOCAL, ROWS / 2 - 0.5], [0, 0, 1]])
    fine = np.array([[4, 0, 1.5], [0, 4, 1.5], [0, 0, 1]])
    rng = np.random.default_rng(1)
    for n in range(VIEWS):
        R = cv2.Rodrigues(rng.uniform(-0.5, 0.5, 3))[0]
        middle = (rng.uniform(-0.06, 0.06), rng.uniform(-0.03, 0.03), rng.uniform(0.33, 0.42))
        H = fine @ camera @ np.stack([R[:, 0], R[:, 1], np.array(middle)], axis=1) @ metres
        seen = cv2.warpPerspective(paper, H, (4 * COLS, 4 * ROWS), flags=cv2.INTER_LINEAR, borderValue=128)
        assert cv2.imwrite(str(folder / f"{n}.png"), cv2.resize(seen, (COLS, ROWS), interpolation=cv2.INTER_AREA))
    (folder / "empty.png").write_bytes(cv2.imencode(".png", np.full((ROWS, COLS), 90, np.uint8))[1].tobytes())
    return folder


@pytest.fixture(scope="module")
def bracket(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """A wall of grey patches at five exposures."""
    folder, rng = tmp_path_factory.mktemp("bracket"), np.random.default_rng(0)
    radiance = np.kron(3 * np.exp(rng.uniform(-3, 4.5, (15, 20))), np.ones((16, 16)))
    paths = []
    for n, time in enumerate((1 / 500, 1 / 250, 1 / 125, 1 / 60, 1 / 30)):
        light = radiance * time
        light = np.clip(light + rng.normal(0, 1, light.shape) * np.sqrt(0.003**2 + 2e-4 * light), 0, 1).astype(np.float32)
        paths.append(folder / f"{n}.png")
        assert cv2.imwrite(str(paths[-1]), np.rint(255 * tone.encode(Transfer.BT709, light)).astype(np.uint8))
    return paths


def test_a_person_measures_their_camera_and_gets_one_profile(rsvideo: Run, views: Path, bracket: list[Path], tmp_path: Path) -> None:
    mine, figure = tmp_path / "mine.yaml", tmp_path / "left.png"
    done = rsvideo("calibrate", "lens", views, "--board", BOARD, "-o", mine, "--figure", figure, "--name", "Mine")
    assert done.returncode == 0, done.stderr
    assert done.stdout == ""
    assert "not used: empty.png: the board was not found" in done.stderr
    assert figure.read_bytes().startswith(b"\x89PNG")
    lens = profiles.find(str(mine)).intrinsics
    assert lens is not None
    assert lens.fx.value == pytest.approx(FOCAL, rel=0.01)
    assert lens.fx.std is not None
    assert abs(lens.fx.value - FOCAL) < 4 * lens.fx.std
    assert lens.found is not None
    assert set(lens.found.files) == {f"{n}.png" for n in range(VIEWS)}
    done = rsvideo("calibrate", "response", *bracket, "--exposures", "1/500,1/250,1/125,1/60,1/30", "-o", mine, "--add")
    assert done.returncode == 0, done.stderr
    both = profiles.find(str(mine))
    assert (both.name, both.intrinsics) == ("Mine", lens)
    assert both.tone is not None
    assert both.tone.transfer is Transfer.BT709
    assert both.noise is not None
    assert both.noise.read.value == pytest.approx(0.003, rel=0.2)
    page = tmp_path / "page.pdf"
    assert rsvideo("calibrate", "show", mine, "-o", page).returncode == 0
    assert page.read_bytes().startswith(b"%PDF")
    done = rsvideo("calibrate", "convert", mine, "--to", "opencv")
    assert done.returncode == 0
    assert done.stdout.startswith("%YAML:1.0")
    assert "holds no tone, noise, standard deviations" in done.stderr


def test_without_an_output_the_profile_is_printed(rsvideo: Run, views: Path, tmp_path: Path) -> None:
    few = [*(views / f"{n}.png" for n in range(4)), views / "empty.png"]
    done = rsvideo("calibrate", "lens", *few, "--board", BOARD)
    assert done.returncode == 0
    path = tmp_path / "printed.yaml"
    path.write_text(done.stdout)
    assert profiles.find(str(path)).intrinsics is not None
    facts = json.loads(rsvideo("calibrate", "lens", *few, "--board", BOARD, "--json").stdout)
    assert [one["name"] for one in facts["refused"]] == ["empty.png"]
    assert len(facts["views"]) == 4
    assert facts["profile"]["intrinsics"]["fx"]["value"] == pytest.approx(FOCAL, rel=0.05)


def test_the_schema_names_every_part_of_a_profile(rsvideo: Run) -> None:
    schema = json.loads(rsvideo("calibrate", "schema").stdout)
    assert {"name", "mode", "intrinsics", "timing", "tone", "noise"} <= set(schema["properties"])


@pytest.mark.parametrize("to", ["gyroflow", "kalibr", "opencv", "ros", "rsvideo"])
def test_other_programs_profiles_serve_as_cameras(tmp_path: Path, to: str) -> None:
    theirs = tmp_path / ("theirs.json" if to == "gyroflow" else "theirs.yaml")
    words = ["calibrate", "convert", "iphone_17_pro_wide_2160p24", "--to", to, "-o", str(theirs)]
    assert CliRunner().invoke(app, words).exit_code == 0
    lens = profiles.find(str(theirs)).intrinsics
    assert lens is not None
    assert lens.fx.value == 2839.4
    refused(4, "exists already", *words[1:])


def test_what_cannot_be_meant_is_refused_in_one_line(rsvideo: Run, views: Path, bracket: list[Path], tmp_path: Path) -> None:
    done = rsvideo("calibrate", "lens", views, "--board", "chessbord:6x5:25mm")
    assert (done.returncode, done.stdout, done.stderr.count("\n")) == (2, "", 1)
    assert "did you mean chessboard?" in done.stderr
    board = ("--board", BOARD)
    refused(3, "was found in none of 2 pictures", "lens", views / "0.png", views / "1.png", "--board", "chessboard:7x5:25mm")
    refused(2, "at least 3 views of the board, 1 can be used", "lens", views / "0.png", *board)
    done = CliRunner().invoke(app, ["calibrate", "lens", str(views / "0.png"), str(views / "empty.png"), *board])
    assert "not used: empty.png: the board was not found" in done.stderr
    refused(3, "does not exist", "lens", tmp_path / "no.png", *board)
    refused(3, "no.mp4", "lens", tmp_path / "no.mp4", *board)
    refused(2, "holds no photograph", "lens", tmp_path, *board)
    refused(2, "must not be negative", "lens", views, *board, "--readout", "-20ms")
    refused(2, "--add needs -o PROFILE", "lens", views, *board, "--add")
    refused(2, "must end in .yaml, .yml", "lens", views, *board, "-o", tmp_path / "x.json")
    refused(2, "must fit into 281 x 180 mm of A4", "board", "--board", "chessboard:9x6:60mm", "-o", tmp_path / "b.pdf")
    refused(2, "0.png must say its exposure in EXIF, it does not; give all with --exposures", "response", *bracket)
    refused(2, "one time for each of 5 photographs, it names 2", "response", *bracket, "--exposures", "1/500,1/250")
    refused(2, "did you mean nikon_1_j1_1080p30?", "show", "nikon_1_j1", "-o", tmp_path / "p.png")
    assert not list(tmp_path.iterdir())


def test_a_profile_of_another_mode_is_not_added_to(views: Path, tmp_path: Path) -> None:
    path = tmp_path / "mine.yaml"
    path.write_text("name: Mine\nmode: {rows: 480, cols: 640}\n")
    before = path.read_bytes()
    few = [views / f"{n}.png" for n in range(3)]
    refused(2, "the profile is of 640 x 480, what was measured of 320", "lens", *few, "--board", BOARD, "-o", path, "--add")
    assert path.read_bytes() == before


@pytest.mark.slow
@settings(max_examples=60, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_no_damage_to_views_or_profiles_raises_what_is_not_told(views: Path, tmp_path: Path, data: st.DataObject) -> None:
    kind = data.draw(st.sampled_from(["png", "yaml", "json", "yml"]))
    whole = (views / "0.png").read_bytes() if kind == "png" else b"name: Mine\nmode: {rows: 48, cols: 64}\nnoise: {read: 1e-3, shot: 0}\n"
    start = data.draw(st.integers(0, len(whole)))
    path = tmp_path / f"damaged.{kind}"
    path.write_bytes(whole[:start] + data.draw(st.binary(max_size=30)) + whole[start + data.draw(st.integers(0, 200)) :])
    figure = tmp_path / "figure.svg"
    words = ["lens", str(path), "--board", BOARD] if kind == "png" else ["show", str(path), "-o", str(figure), "--overwrite"]
    done = CliRunner().invoke(app, ["calibrate", *words], standalone_mode=False)
    if done.exception is not None:
        code, line = code_and_line(done.exception)
        assert code in (2, 3), line
        assert str(path) in line or "the board was found in none" in line or "a lens needs at least" in line
