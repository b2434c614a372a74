"""A camera measured on the page: board, views, lens, readout, and the profile of both, saved into the folder."""

import json
from collections.abc import Iterator
from pathlib import Path

import cv2
import numpy as np
import pytest
from playwright.sync_api import Browser

from calibration.boards.render import photographs
from rsvideo.physics import tone
from rsvideo.physics.tone import Transfer
from rsvideo.shooting import profiles
from tests.calibration.flickering import lit
from tests.view.servers import Server, serving
from tests.view.tabs import PATIENCE, tab

BOARD, FOCAL, READOUT = "chessboard:9x6:25mm", 330.0, 0.018


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """What a page may read and write."""
    return tmp_path_factory.mktemp("cameras")


@pytest.fixture(scope="module")
def server(folder: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    with serving(folder, state=tmp_path_factory.mktemp("state")) as running:
        yield running


@pytest.fixture(scope="module")
def views(tmp_path_factory: pytest.TempPathFactory) -> list[Path]:
    """Photographs of the board, one without it, and a wall under a light of 500 Hz."""
    dropped = tmp_path_factory.mktemp("dropped")
    pictures = dict(zip("abcdefgh", photographs(BOARD, 8, focal_px=FOCAL), strict=True)) | {"none": np.full((240, 320), 90, np.uint8)}
    pictures["wall"] = np.round(65535 * tone.encode(Transfer.SRGB, np.clip(lit(frames=1)[0], 0, 1).astype(np.float32))).astype(np.uint16)
    for name, picture in pictures.items():
        assert cv2.imwrite(str(dropped / f"{name}.png"), picture)
    return sorted(dropped.iterdir())


@pytest.mark.slow
def test_a_camera_is_measured_and_its_profile_saved(browser: Browser, server: Server, folder: Path, views: list[Path]) -> None:
    with tab(browser, f"{server.address}calibrate") as page:
        page.fill("#board", BOARD)
        page.click("#draw")
        page.wait_for_selector("#board-image:not([hidden])", timeout=PATIENCE)
        page.set_input_files("#files", views)
        page.wait_for_selector(f"#views li:nth-child({len(views)})", timeout=PATIENCE)
        page.click("[aria-label='Forget a.png']")
        page.wait_for_selector("#views:not(:has-text('a.png'))")
        assert page.is_disabled("#save")
        page.fill("#camera", "Simulated")
        page.click("#lens")
        page.wait_for_selector("#residuals:not([hidden])", timeout=PATIENCE)
        assert "7 used, 2 refused" in page.inner_text("#lens-facts")
        assert "not used: none.png" in page.inner_text("#refused")
        page.select_option("#flicker-clip", "dwall.png")
        page.fill("#hertz", "500Hz")
        page.click("#readout")
        page.wait_for_selector("#readout-facts dd", timeout=PATIENCE)
        page.fill("#profile-name", "simulated")
        page.click("#save")
        page.wait_for_selector("#saved >> text=Saved as simulated.yaml", timeout=PATIENCE)
        page.wait_for_selector("#profile:not([hidden])", timeout=PATIENCE)
        page.reload()
        page.wait_for_selector("html[data-ready]")
        assert "7 used" in page.inner_text("#lens-facts")
        session = page.evaluate("sessionStorage.getItem('rsvideo session')")
    again = server.tell("api/calibrate/save", session=session, name="simulated", at="0/")
    assert (again["status"], "simulated.yaml" in again["error"]) == (409, True)  # it is not replaced unasked
    profile = profiles.find(str(folder / "simulated.yaml"))
    assert profile.camera == "Simulated"
    assert profile.intrinsics is not None
    assert profile.timing is not None
    assert profile.intrinsics.fx.value == pytest.approx(FOCAL, rel=0.01)
    assert profile.timing.readout_s.value == pytest.approx(READOUT, rel=0.01)


def test_what_cannot_be_measured_is_said_in_a_sentence(server: Server) -> None:
    session = server.tell("api/calibrate/session")["session"]
    nothing = server.tell("api/calibrate/lens", session=session, board=BOARD)
    assert (nothing["status"], "there are no views" in nothing["error"]) == (422, True)
    flicker = server.tell("api/calibrate/readout", session=session, clip="0/gone.mp4", flicker="often")
    assert (flicker["status"], "written like 1000Hz" in flicker["error"]) == (422, True)
    unmeasured = server.tell("api/calibrate/save", session=session, name="early", at="0/")
    assert (unmeasured["status"], "nothing is measured yet" in unmeasured["error"]) == (422, True)
    assert json.loads(server.ask("api/calibrate/board?name=heptagon")[1])["error"].startswith("board must be one such as")
